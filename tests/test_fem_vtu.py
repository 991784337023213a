"""What ParaView is given is what was computed."""

import base64
from xml.etree import ElementTree

import numpy as np
import pytest

from data.errors import CannotWrite
from fem.material import NeoHooke
from fem.tube import Tube
from fem.vtu import write_vtu

KINDS = {"Float64": "<f8", "Int32": "<i4", "Int64": "<i8", "UInt8": "<u1"}


@pytest.mark.parametrize("order", [1, 2])
def test_a_written_mesh_reads_back(tmp_path, order: int) -> None:
    material = np.full((8, 4), NeoHooke(c1=2e5), dtype=object)
    tube = Tube(
        length=8e-3, outer_radius=5e-3, wall=1e-3, divisions=(8, 4, 1), material=material, cap=1e-3, order=order
    )
    run, path = tube.inflate([10e3]), tmp_path / "tube.vtu"
    write_vtu(run, path)
    read = {}
    for array in ElementTree.parse(path).iter("DataArray"):
        content = base64.b64decode(array.text)
        assert int(np.frombuffer(content[:8], "<u8")[0]) == len(content) - 8
        read[array.get("Name")] = np.frombuffer(content[8:], KINDS[array.get("type")])
    mesh = run.system.body.mesh
    assert (read["position"].reshape(-1, 3) + read["displacement"].reshape(-1, 3) == run.points[0].x).mean() > 0.9
    assert (read["connectivity"].reshape(-1, read["offsets"][0]) == mesh.hexes).all()
    assert set(read["types"]) == {12 if order == 1 else 25}
    assert read["stretch"][mesh.part >= 0].max() == pytest.approx(run.stretch().max())
    assert not read["overstretched"].any()
    with pytest.raises(CannotWrite):
        write_vtu(run, path)
