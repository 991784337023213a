"""What several test files use."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
DRIVERS = [path for folder in ("/usr/share", "/etc") for path in Path(folder, "vulkan/icd.d").glob("*.json")]
NO_DRIVER = "no Vulkan driver: install mesa-vulkan-drivers and libvulkan1"
SIMULATED = {"kind": "simulated", "title": "test"}

# mapping -> (log, rows, what its import must say)
REAL = {
    "zillen": ("soft_actuators/zillen/friction_O-ring257_1bar.csv", 5827, "the first 1 row(s) dropped"),
    "motor_rotation": ("hydraulic_rig/MotorRotation.csv", 15246, "unit undocumented, recorded as 1: /input, /speed"),
    "starfish": ("soft_actuators/starfish/soft_starfish_3d_data_cyclic1.csv", 3516, "30 leading rows of NaN"),
    "faster_rig": ("soft_actuators/faster_rig/faster.csv", 21275, "1882 of 21275 printed stamps do not increase"),
}


def catheter(*arguments: object, cwd: Path, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command line in a fresh process, from another folder."""
    command = [sys.executable, "-m", "catheter", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300, env=env, check=False)


def view_names(rrd: Path) -> list[str]:
    """Return the names of every view in a dashboard's blueprint."""
    from rerun.chunk import RrdReader

    reader, found = RrdReader(rrd), []
    for chunk in reader.stream(store=reader.blueprints()[0]):
        if str(chunk.entity_path).startswith("/view/"):
            batch = chunk.to_record_batch()
            columns = [batch.column(i) for i, one in enumerate(batch.schema) if one.name.endswith("display_name")]
            found += [name for column in columns for row in column.to_pylist() for name in row or []]
    return found
