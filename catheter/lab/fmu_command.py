"""The command that writes the circuit as an FMU and tries it."""

import argparse
from pathlib import Path
from typing import Any

from catheter.lab.outcome import Outcome, progress, table
from data.files import check_free


def fmu_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fmu`."""
    parser.add_argument("out", metavar="OUT.fmu", help="the FMU to write")
    parser.add_argument("--source-only", action="store_true", help="no binary for this machine (needs no C compiler)")
    parser.add_argument("--force", action="store_true", help="overwrite the output")


def fmu_(options: argparse.Namespace) -> Outcome:
    """Export the thesis's circuit as an FMU; run it both ways beside ours unless only its source is wanted."""
    from catheter import fmu
    from catheter.circuit import thesis_circuit

    out, circuit = Path(options.out), thesis_circuit()
    check_free(out, options.force)
    with progress("compiling"):
        fmu.export(circuit, out, binary=not options.source_only, replace=options.force)
    rows = [] if options.source_only else _tried(out, circuit)
    values = {"fmu": str(out), "binary": not options.source_only, "runs": rows}
    parts: list[Any] = [f"{out} written: FMI 2.0, model exchange and co-simulation; input u [Pa], outputs V, P, Q"]
    if rows:
        formats = {"kind": "s", "tolerance": "g", "difference": ".1e", "seconds": ".3f"}
        cells = [[format(row[name], form) for name, form in formats.items()] for row in rows]
        parts.append(table(["one cycle of the thesis", "tolerance", "max difference in V", "s"], cells))
        parts.append("Difference: to ours at 1e-11. s: with starting Python and fmpy. Simulated, both.")
    return Outcome(values, parts)


def _tried(path: Path, circuit: Any) -> list[dict[str, Any]]:
    import time

    import numpy as np

    from catheter.fmu_source import run
    from catheter.hydraulics import Solver, SquareWave, simulate

    wave = SquareWave()
    ours = simulate(circuit, wave.drive(1), solver=Solver(tolerance=1e-11))
    switch, end = wave.duty * wave.period, wave.period
    square = {"time": np.array([0.0, switch, switch, end]), "u": np.array([wave.high, wave.high, wave.low, wave.low])}
    names, rows = tuple(f"V[{k + 1}]" for k in range(len(circuit.segments))), []
    for kind, tolerance in (("ModelExchange", 1e-6), ("ModelExchange", 1e-9), ("CoSimulation", 1e-8)):
        started = time.perf_counter()
        found = run(path, names, end, step_s=0.01, kind=kind, inputs=square, tolerance=tolerance)
        seconds = time.perf_counter() - started
        volume = np.stack([found.values[name] for name in names], axis=1)
        difference = float(np.abs(volume - ours.at(found.time_s)).max())
        rows.append({"kind": kind, "tolerance": tolerance, "difference": difference, "seconds": seconds})
    return rows
