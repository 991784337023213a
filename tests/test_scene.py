"""A scene is checked when it is read: unknown keys, wrong units and impossible values are named."""

from pathlib import Path

import pytest

from catheter.lab.scene import Scene, names
from data.errors import BadInput

TEXT = '[scene]\nkind = "bender"\ntitle = "t"\n'


def test_quantities_are_converted_and_the_rest_takes_its_defaults() -> None:
    scene = Scene.parse(TEXT + '[drive]\namplitude = "2 V"\nlevels = 3\n[bench]\nstroke_volume = "10 mL"\n', "here")
    drive = scene.tables["drive"]
    assert (drive.amplitude, drive.levels, drive.fill) == (2.0, 3, 12.0)
    assert scene.tables["bench"].stroke_volume == pytest.approx(1e-5, rel=1e-15)


@pytest.mark.parametrize("name", names())
def test_every_shipped_scene_is_sound(name: str) -> None:
    assert Scene.load(name).heading.title


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (TEXT + '[drive]\namplitud = "2 V"\n', r"\[drive\], amplitud: is no such key; did you mean 'amplitude'"),
        (TEXT + '[drive]\namplitude = "2 m"\n', r"\[drive\], amplitude: '2 m' has the wrong dimension; expected.*V"),
        (TEXT + "[drive]\namplitude = 2.0\n", "2.0 is not a number with a unit"),
        (TEXT + '[drive]\nlevels = "3"\n', "levels: is '3'; expected int"),
        (TEXT + "[drive]\nlevels = true\n", "levels: is True; expected int"),
        (TEXT + "[drive]\nlevels = -1\n", "levels: is -1; expected at least 0"),
        (TEXT + '[bench]\nrate = "1 MHz"\n', "rate: is 1e.06 Hz; expected at most 100000 Hz"),
        (TEXT + "[plant]\nslip_ml = 3.0\n", "slip_ml: is 3.0; expected a list"),
        (TEXT + '[plant]\nslip_ml = ["a"]\n', r"slip_ml\[0\]: is 'a'; expected float"),
        (TEXT + "[plant]\ncubic = nan\n", "cubic: is nan; expected a finite number"),
        (TEXT + "[tube]\n", r"\[tube\]: is no table of a bender scene"),
        (TEXT + '[ask]\nsplit = "halves"\n', "split: is 'halves'; did you mean 'half'"),
        ('[scene]\nkind = "bendr"\ntitle = "t"\n', "kind: is 'bendr'; did you mean 'bender'"),
        ('[scene]\nkind = "bender"\n', "title: is missing"),
        ("scene = 3\n", r"\[scene\]: is 3; expected a table"),
        ("[scene\n", "is not TOML.*line 1"),
        ("a = " + "[" * 5000, "is not TOML"),
    ],
)
def test_what_is_wrong_is_named(text: str, found: str) -> None:
    with pytest.raises(BadInput, match=found):
        Scene.parse(text, "here")


def test_a_missing_scene_is_named_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="did you mean 'bender'"):
        Scene.load("bendr")
    with pytest.raises(BadInput, match="cannot be read"):
        Scene.load(tmp_path / "none.toml")
