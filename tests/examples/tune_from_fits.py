"""Put fitted accumulators and valves into the robot's circuit, then go up to the nearest better valves.

    python tests/examples/tune_from_fits.py 1=accumulator.toml 3=valve.toml

The files are what `python -m catheter fit RECORDING --model accumulator|valve --out FILE` writes;
1 is the segment next to the source. Without any, the thesis's circuit is tuned. `python -m catheter tune`
maps all valves first and finds the best of them.
"""

import sys
from pathlib import Path

from catheter.circuit import thesis_circuit, with_fit
from catheter.drive import SquareWave
from catheter.optimum import optimum
from catheter.tuning import NAMES, Marks, evaluate


def main(*fits: str) -> None:
    """Print the events of a cycle and the objective, before and after tuning."""
    circuit = thesis_circuit()
    for each in fits:
        segment, _, path = each.partition("=")
        circuit = with_fit(circuit, int(segment) - 1, Path(path))
    before = evaluate(circuit, SquareWave(), Marks())
    best = optimum(circuit, SquareWave(), Marks())
    after = evaluate(best.circuit, best.source, Marks())
    for name, score in (("as built", before), ("tuned", after)):
        events = "  ".join(f"{what} {when:.3f} s" for what, when in zip(NAMES, score.events_s[0], strict=True))
        print(f"{name:9s} {events}   J {score.objective[0]:.4f}")
    for number, segment in enumerate(best.circuit.segments, start=1):
        print(f"valve {number}: K = {segment.valve.coefficient:.3e} m^3 Pa^-0.5 s^-1")


if __name__ == "__main__":
    main(*sys.argv[1:])
