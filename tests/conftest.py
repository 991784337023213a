"""Shared by all tests: small recordings, and the real measurements where they are."""

import os
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT, SIMULATED

from data.recorder import Recorder
from data.signal import Signal
from data.topics import Topic


@pytest.fixture(scope="session")
def real() -> Path:
    """The folder of real measurements made by others."""
    folder = Path(os.environ.get("CATHETER_REAL_DATA", ROOT.parent / "shared" / "data" / "real"))
    if not folder.is_dir():
        pytest.skip(f"real measurements are not at {folder}; set CATHETER_REAL_DATA")
    return folder


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """A recording of 20,000 random forces and pressures at 83 Hz, several chunks long."""
    path = tmp_path / "small.mcap"
    draw = np.random.default_rng(1)
    time_s = np.arange(20_000) / 83
    with Recorder(path, SIMULATED, flush_s=None) as recorder:
        for name, unit in (("/force", "N"), ("/pressure", "Pa")):
            recorder.add(Topic(name=name, components=("value",), units=(unit,)))
        recorder.write_signals(
            {
                "/force": Signal(time_s, draw.normal(size=20_000), "N"),
                "/pressure": Signal(time_s, draw.normal(size=20_000), "Pa"),
            }
        )
    return path


@pytest.fixture(scope="session")
def reference() -> dict[str, np.ndarray]:
    """TWIST's mesh, 32 x 32 x 1, as six codes solved it."""
    with np.load(ROOT / "tests" / "reference" / "twist_32x32x1.npz") as file:
        return dict(file)
