"""What is written for a printer is what was designed: closed, of the right volume, voxel for voxel."""

import json
import struct
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

from catheter.lab import cli
from data.errors import BadInput, CannotWrite, CatheterError
from fem import print_files, slices
from fem.print_files import write_prints
from fem.readback import voxels_inside
from fem.slices import Layers, Resolution, write_slices
from fem.solid import EMPTY, Solid
from fem.voxel_map import Sizes, VoxelMap, load_map, palette, tube_positions, write_map

DRAW = np.random.default_rng(0)
MATERIALS = ("Agilus30", "FLX9740", "FLX9785")
CHECKERS = np.indices((16, 12)).sum(axis=0) % 2


def made(voxels: np.ndarray, **sizes: float) -> VoxelMap:
    return VoxelMap(title="t", sizes=Sizes(**sizes), materials=MATERIALS, voxels=voxels)  # type: ignore[arg-type]


def test_the_twisting_actuator_of_seven_materials_is_read_back_as_designed(tmp_path: Path) -> None:
    import lib3mf

    wrap = load_map("twist7")
    found = write_prints(wrap, tmp_path, "w")
    assert [w.material for w in found.stl] == [w.material for w in found.mf] == list(wrap.parts)
    assert len(wrap.parts) == 8  # seven of the map, and the caps
    total = 0.0
    for written in found.stl:
        mesh = trimesh.load_mesh(written.path)
        assert mesh.is_watertight
        assert mesh.is_volume
        assert abs(mesh.volume / written.design - 1) < 1e-9
        assert len(np.unique(np.sort(mesh.faces, axis=1), axis=0)) == len(mesh.faces)  # no face is there twice
        total += mesh.volume
    # the polygons' tube and discs in closed form; corners of four bytes are 6e-8 of their size off at most
    area = 16 * np.sin(2 * np.pi / 32) * 1.0
    hole = (2.02 / np.cos(np.pi / 32)) ** 2
    ideal = area * ((25 - 16) * 32 + (25 - hole) * 4)
    assert total == pytest.approx(ideal, rel=6e-8)
    assert abs(found.closure) < 1e-9
    assert sum(w.voxels for w in found.stl) == 1024
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(tmp_path / "w.3mf"))
    objects, names, colours = model.GetMeshObjects(), [], []
    bases, groups = model.GetBaseMaterialGroups(), model.GetColorGroups()
    assert bases.MoveNext()
    assert groups.MoveNext()
    base, group = bases.GetCurrentBaseMaterialGroup(), groups.GetCurrentColorGroup()
    while objects.MoveNext():
        mesh = objects.GetCurrentMeshObject()
        assert mesh.IsManifoldAndOriented()
        _, number, there = mesh.GetObjectLevelProperty()
        assert there
        names.append((mesh.GetName(), base.GetName(number)))
        properties = mesh.GetTriangleProperties(0)
        assert properties.ResourceID == group.GetResourceID()
        shade = group.GetColor(properties.PropertyIDs[0])
        colours.append((shade.Red, shade.Green, shade.Blue))
    assert reader.GetWarningCount() == 0
    assert names == [(part, part) for part in wrap.parts]
    assert colours == palette(wrap)


@pytest.mark.parametrize(
    "voxels",
    [CHECKERS, DRAW.integers(0, 3, (16, 12)), DRAW.integers(0, 2, (3, 2)), np.zeros((4, 1), dtype=int)],
    ids=["checkers", "random", "three around", "one material"],
)
@pytest.mark.parametrize("cap", [0.0, 2e-3])
def test_every_map_gives_closed_surfaces_and_is_read_back(voxels, cap) -> None:
    design = made(voxels, cap=cap, hole=1e-3)
    solid = design.solid()
    whole, total = solid.surface(range(len(design.parts))), 0.0
    for k, part in enumerate(design.parts):
        surface = solid.surface([k])
        mesh = trimesh.Trimesh(surface.points, surface.triangles)  # which joins equal corners, as readers of STL do
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        total += mesh.volume
        wanted = np.array([name == part for name in MATERIALS])[voxels]
        assert np.array_equal(voxels_inside(np.asarray(mesh.triangles) * 1e-3, design), wanted)
    assert total == pytest.approx(whole.volume, rel=1e-13)
    assert whole.volume == pytest.approx(print_files.unrounded(solid), rel=1e-7)


def test_neighbours_of_two_materials_share_their_triangles_also_where_faces_are_not_flat() -> None:
    z, angle = np.linspace(0, 4.0, 5), 2 * np.pi * np.arange(6) / 6
    positions = tube_positions(angle, z, np.array([1.0, 1.5])) + DRAW.uniform(-0.1, 0.1, (6, 5, 2, 3))
    solid = Solid(positions, DRAW.integers(0, 3, (6, 4, 1)))
    parts = [solid.surface([k]) for k in range(3)]
    assert sum(p.volume for p in parts) == pytest.approx(solid.surface([0, 1, 2]).volume, rel=1e-13)
    inner = np.vstack([p.triangles for p in parts])
    ordered = np.sort(inner, axis=1)
    _, count = np.unique(ordered, axis=0, return_counts=True)
    outside = len(solid.surface([0, 1, 2]).triangles)
    assert (count == 1).sum() == outside
    assert (count == 2).sum() == (len(inner) - outside) / 2


def test_a_map_of_128_by_128_is_written_and_read_back_in_10_s(tmp_path: Path) -> None:
    voxels = DRAW.integers(0, 3, (128, 128))
    started = time.process_time()  # work: other tests run at the same time
    found = write_prints(made(voxels), tmp_path, "m")
    assert time.process_time() - started < 10
    assert [w.voxels for w in found.stl] == [*np.bincount(voxels.ravel()), 0]


def test_a_writer_that_errs_is_found_out(tmp_path: Path, monkeypatch) -> None:
    design = made(CHECKERS)
    plain = print_files.read_stl

    def moved(path: Path):
        content = bytearray(path.read_bytes())
        (x,) = struct.unpack_from("<f", content, 96)
        struct.pack_into("<f", content, 96, x * 1.001)
        path.write_bytes(content)
        return plain(path)

    def torn(path: Path):
        mesh = plain(path)
        faces = mesh.faces.copy()
        faces[0, 0] = len(mesh.vertices)
        return trimesh.Trimesh(np.vstack([mesh.vertices, mesh.vertices[mesh.faces[0, 0]]]), faces, process=False)

    for fault in (moved, torn):
        monkeypatch.setattr(print_files, "read_stl", fault)
        with pytest.raises(CatheterError, match="reads back open"):
            write_prints(design, tmp_path, "x", force=True)
    turned = VoxelMap(title="t", sizes=design.sizes, materials=MATERIALS, voxels=1 - CHECKERS)
    surface = turned.solid().surface([0])
    monkeypatch.setattr(print_files, "read_stl", lambda _: trimesh.Trimesh(surface.points, surface.triangles))
    with pytest.raises(CatheterError, match="192 voxels that differ"):
        write_prints(design, tmp_path / "..", "y", force=True)


def test_slices_hold_every_voxel_and_the_wall_s_area(tmp_path: Path, monkeypatch) -> None:
    design = made(DRAW.integers(0, 3, (16, 12)))
    resolution = Resolution(pixel=1e-4, layer=5e-4)
    found = write_slices(design, tmp_path / "s", resolution)
    assert found.layers == 72
    assert [found.voxels[part] for part in MATERIALS] == list(np.bincount(design.voxels.ravel()))
    layers = Layers(design, resolution)
    inside = layers.numbers(3) != EMPTY
    assert inside.sum() * 1e-8 == pytest.approx(np.pi * (25 - 16) * 1e-6, rel=1e-2)  # pixels of a tenth of the wall
    lid = layers.numbers(-1) != EMPTY
    assert lid.sum() * 1e-8 == pytest.approx(np.pi * (25 - 2.02**2) * 1e-6, rel=1e-2)
    half = Layers(made(np.repeat([[0], [1]], 8, axis=0)), resolution).numbers(0)  # y > 0, the upper rows, and y < 0
    assert set(half[:50].ravel()) == {EMPTY, 0}
    assert set(half[50:].ravel()) == {EMPTY, 1}
    with pytest.raises(CannotWrite, match="exists"):
        write_slices(design, tmp_path / "s", resolution)
    with pytest.raises(CatheterError, match="no pixel of its own"):
        write_slices(design, tmp_path / "t", Resolution(pixel=1e-3, layer=4e-3))
    monkeypatch.setattr(slices, "palette", lambda m: palette(m)[::-1])
    plain = Layers.numbers
    monkeypatch.setattr(Layers, "numbers", lambda self, row: plain(self, (row + 1) % 12))
    with pytest.raises(CatheterError, match="another map"):
        write_slices(design, tmp_path / "u", resolution)


def test_maps_round_trip_as_files(tmp_path: Path) -> None:
    for name in ("twist", "twist7"):
        shipped = load_map(name)
        write_map(shipped, tmp_path / f"{name}.toml")
        back = load_map(tmp_path / f"{name}.toml")
        assert (back.title, back.sizes, back.materials) == (shipped.title, shipped.sizes, shipped.materials)
        assert np.array_equal(back.voxels, shipped.voxels)
    i, j = np.indices((32, 32))
    assert np.array_equal(load_map("twist").voxels == 1, (i - j) % 16 < 4)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"aba"', '"ab"', r"rows\[1\]: has 2 voxels; the first has 3"),
        ('"aba"', '"abz"', r"rows\[1\]: has 'z'; \[materials\] has a, b"),
        ("Agilus30", "Agilus31", "did you mean 'Agilus30'"),
        ("Agilus30", "Dragon Skin 10", "no fit is given"),
        ('"1 mm"', '"6 mm"', "wall: is 0.006 m; expected less than 0.005 m"),
        ('"1 mm"', '"-1 mm"', "wall: is -0.001 m; expected at least"),
        (
            'hole = "3 mm"',
            'hole = "9 mm"',
            "hole: is 0.009 m: its polygon of 3 sides reaches 0.009 m from the axis; expected less than the bore",
        ),
        ('a = "', 'aa = "', "'aa': is no single letter"),
        ('["aab", "aba"]', "[]", "rows: are empty"),
        ('"aab", "aba"', '"ab", "ba"', r"has \(2, 2\) voxels; expected 3"),
        ("title", "titel", "titel: is no such key; did you mean 'title'"),
        ("[materials]", "[material]", r"\[materials\]: is no table of names"),
    ],
)
def test_what_is_wrong_in_a_map_is_named(tmp_path: Path, old, new, said) -> None:
    text = (
        'title = "t"\nwall = "1 mm"\nhole = "3 mm"\nrows = ["aab", "aba"]\n[materials]\na = "Agilus30"\nb = "FLX9785"\n'
    )
    path = tmp_path / "m.toml"
    path.write_text(text)
    assert load_map(path).voxels.shape == (3, 2)
    path.write_text(text.replace(old, new))
    with pytest.raises(BadInput, match=said):
        load_map(path)


def test_cells_that_no_closed_surface_parts_are_refused() -> None:
    positions = tube_positions(2 * np.pi * np.arange(4) / 4, np.arange(3.0), np.array([1.0, 2.0, 3.0]))
    cells = np.zeros((4, 2, 2), dtype=int)
    cells[:, 0, 0] = cells[:, 1, 1] = 1
    with pytest.raises(BadInput, match="meets its like along an edge only"):
        _ = Solid(positions, cells).points
    both = np.zeros((4, 2, 2), dtype=int)
    both[1, 1, 0] = both[2, 0, 0] = both[1, 0, 1] = both[2, 1, 1] = 1
    with pytest.raises(BadInput, match=r"both ways|along an edge only"):
        _ = Solid(positions, both).points
    with pytest.raises(BadInput, match="not finite"):
        Solid(positions * np.nan, cells)


def test_print_and_shape_on_the_command_line(tmp_path: Path, capsys) -> None:
    out = tmp_path / "p"
    assert cli.run(["print", "twist", "--out", str(out), "--slices", "--layer", "0.5 mm", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [f["voxels"] for f in found["files"][:3]] == [768, 256, 0]
    assert found["slices"]["voxels"] == {"Agilus30": 768, "FLX9785": 256, "Vero": 0}
    assert cli.run(["print", "twist", "--out", str(out)]) == 2
    assert "not overwritten" in capsys.readouterr().err
    nodes = tmp_path / "t.npz"
    options = ["--q", "1", "--voxel", "3,7", "--map", "twist7", "--target", str(nodes)]
    assert cli.run(["shape", "twisting", *options]) == 0
    printed = capsys.readouterr().out
    assert "simulated" in printed
    assert "does not bend there" in printed
    assert max(map(len, printed.splitlines())) <= 100
    with np.load(nodes) as file:
        assert file["deformed"].shape == file["undeformed"].shape == (32 * 33 * 3, 3)
        assert "simulated" in str(file["about"])
    for arguments, said in (
        (["shape", "bender"], "a shape scene has a [vessel]"),
        (["shape", "--q", "2"], "expected 0 to 1"),
        (["shape", "--voxel", "a"], "expected two numbers"),
        (["shape", "--unit", "mm"], "given without --vessel"),
        (["shape", "--vessel", "none.csv"], "cannot be read"),
        (["print", "twist", "--out", str(nodes)], "is no folder"),
        (["print", "twist", "--out", str(out), "--layer", "1 mm"], "add --slices"),
        (["print", "twst", "--out", str(out)], "did you mean 'twist'"),
    ):
        assert cli.run(arguments) == 2
        assert said in capsys.readouterr().err
