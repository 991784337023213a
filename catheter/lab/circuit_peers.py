"""The circuit in other programs: FONSim, and SUNDIALS CVode through the exported FMU."""

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from catheter.circuit import Circuit, Orifice
from catheter.hydraulics import Run
from catheter.lab.report import Row
from data.errors import CatheterError
from data.signal import Array

GRID_S = np.linspace(0.0, 2.0, 201)  # where their answers are compared


def fonsim_rows(circuit: Circuit, start: Array, reference: Run, steps_s: tuple[float, ...]) -> list[Row]:
    """Return FONSim's error over one thesis cycle by its time step; backward Euler, its default."""
    from catheter.lab.peers import run_peer

    springs = [segment.accumulator for segment in circuit.segments]
    valves = [segment.valve for segment in circuit.segments]
    task = {
        "laws": [spring.coefficients for spring in springs],
        "low": [spring.linear_range[0] for spring in springs],
        "volume": [spring.rest_volume for spring in springs],
        "K": [valve.coefficient for valve in valves],
        "d": [valve.transition for valve in valves if isinstance(valve, Orifice)],
        "high": 83e3,
        "start": start.tolist(),
        "times": GRID_S.tolist(),
        "steps": steps_s,
    }
    method = "FONSim 0.6"
    try:
        found = run_peer("fonsim_cycle.py", ("fonsim==0.6.0",), task)
    except CatheterError as failure:
        return [Row(method=method, level="", error=np.nan, seconds=np.nan, failed=f"failed: {failure}"[:200])]
    rows = []
    for one in found:
        failed = one.get("failed", "")
        error = np.nan if failed else float(np.abs(np.array(one["V"]) - reference.at(GRID_S)).max())
        seconds = one.get("seconds", np.nan)
        rows.append(Row(method=method, level=f"{one['step']:g} s", error=error, seconds=seconds, failed=failed[:200]))
    return rows


def cvode_rows(circuit: Circuit, start: Array, reference: Run, tolerances: tuple[float, ...]) -> list[Row]:
    """Return CVode's error over one thesis cycle, through the FMU that `catheter.fmu` writes; fmpy's time included."""
    import fmpy

    from catheter import fmu

    rows = []
    with tempfile.TemporaryDirectory() as folder:
        fmpy.extract(str(fmu.export(circuit, Path(folder) / "circuit.fmu")), unzipdir=folder)
        description = fmpy.read_model_description(folder)
        square = [(0.0, 83e3), (1.0, 83e3), (1.0, 0.0), (2.0, 0.0)]
        names = [f"V[{k + 1}]" for k in range(len(start))]
        fixed: dict[str, Any] = {"model_description": description, "validate": False, "fmi_type": "ModelExchange"}
        fixed |= {"input": np.array(square, [("time", "f8"), ("u", "f8")]), "output": names, "record_events": False}
        fixed |= {"start_values": {f"x[{k + 1}]": float(v - 1.0) for k, v in enumerate(start)}}
        for tolerance in tolerances:
            spent = []
            for _ in range(3):
                started = time.perf_counter()
                found = fmpy.simulate_fmu(
                    folder, stop_time=2.0, output_interval=0.01, relative_tolerance=tolerance, **fixed
                )
                spent.append(time.perf_counter() - started)
            volume = np.stack([found[name] for name in names], axis=1)
            error = float(np.abs(volume - reference.at(np.clip(found["time"], 0.0, 2.0))).max())
            method = "CVode, exported FMU (fmpy)"
            rows.append(Row(method=method, level=f"{tolerance:.0e}", error=error, seconds=min(spent)))
    return rows
