"""The side view: tip, outline and stroke between pixels, from exact pictures."""

import numpy as np
import pytest

from data.errors import BadInput
from vision.fit import NoMarker
from vision.render import Shot, render
from vision.side import side, stroke_m


def box(left: float, top: float, right: float, bottom: float) -> np.ndarray:
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def picture(*boxes: np.ndarray, noise: float = 1.0, seed: int = 0) -> np.ndarray:
    away = ((box(-99, -99, -98, -98), 1.0),)
    patches = tuple((corners, -150.0) for corners in boxes)
    shot = Shot(width_px=320, height_px=240, layout=away, patches=patches, noise_grey=noise, blur_px=0.8)
    return render(shot, seed)


@pytest.mark.parametrize(("base", "turns"), [("top", 0), ("left", 1), ("bottom", 2), ("right", 3)])
def test_tip_and_outline(base: str, turns: int) -> None:
    errors = []
    for seed in range(8):
        tip = 150.0 + seed / 7
        seen = np.ascontiguousarray(np.rot90(picture(box(140.3, -9, 180.6, tip), seed=seed), turns))
        found = side(seen, base)
        errors.append((found.extension_px - tip) / found.sigma_px)
        across = (140.3, 180.6) if base in ("top", "right") else (319 - 180.6, 319 - 140.3)
        assert found.edges_px[20:120].mean(axis=0) == pytest.approx(across, abs=0.05)
        assert found.along_px[[0, -1]] == pytest.approx([0, tip], abs=1)
    assert np.abs(errors).max() < 6  # the linear edge's own error, to 0.02 px, is more than the noise
    light = side(255 - picture(box(140.3, -9, 180.6, 150.0)), "top", light=True)
    assert light.extension_px == pytest.approx(150.0, abs=0.05)


def test_stroke_past_a_scale() -> None:
    lines = [box(20 * i + 10.2, 200, 20 * i + 13.2, 260) for i in range(15)]
    for edge in (60.3, 163.7, 240.9):
        seen = picture(*lines, box(-9, 80, edge, 120))
        assert stroke_m(seen, 220, 100, 1e-3) == pytest.approx((edge - 11.7) / 20 * 1e-3, abs=5e-6)
    with pytest.raises(NoMarker, match="beyond"):
        stroke_m(picture(*lines, box(-9, 80, 5, 120)), 220, 100, 1e-3)
    with pytest.raises(NoMarker, match="contrast"):
        stroke_m(picture(*lines), 220, 100, 1e-3)
    with pytest.raises(NoMarker, match="1 lines"):
        stroke_m(picture(lines[4], box(-9, 80, 50, 120)), 220, 100, 1e-3)
    for rows, spacing in (((220, 239), 1e-3), ((220, 100), 0.0)):
        with pytest.raises(BadInput):
            stroke_m(picture(*lines), *rows, spacing)


def test_what_is_no_actuator_is_missing() -> None:
    for boxes in ((), (box(100, 50, 150, 150),), (box(140, -9, 180, 300),)):
        with pytest.raises(NoMarker):
            side(picture(*boxes))
    with pytest.raises(BadInput, match="base"):
        side(picture(), "up")
