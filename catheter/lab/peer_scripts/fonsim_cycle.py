"""One cycle of a hydraulic chain in FONSim, in an environment of its own; not part of the packages.

argv[1]: JSON with laws (N, k) [Pa], low (N,), volume (N,) [m^3], K (N,), d (N,) [Pa], high [Pa],
start (N,) volume ratios, times (m,) [s] and steps [s]. Prints JSON: for each step seconds and V (m, N).
"""

import json
import sys
import time

import fonsim as fons
import numpy as np
from fonsim.components.terminals import terminal_fluidic
from fonsim.core.component import Component
from fonsim.core.terminal import Terminal
from fonsim.core.variable import Variable

TASK = json.loads(sys.argv[1])
DENSITY = fons.water.rho


class Spring(Component):
    """An accumulator whose pressure is a polynomial of its volume ratio, straight below `low`."""

    def __init__(self, label, law, low, volume, start):
        super().__init__(label)
        self.set_terminals(Terminal("a", terminal_fluidic, {"pressure": "p", "massflow": "mf"}))
        self.set_states(Variable("mass", "local", label="m"))
        self.states[0].initial_value = DENSITY * volume * start
        poly = np.polynomial.Polynomial([0.0, *law])
        rise = poly.deriv()

        @self.auto_state
        def update_state(dt, mf, m):
            return {"m": m + dt * mf}, {"m/p": 0, "m/mf": dt}

        @self.auto
        def evaluate(t, p, m):
            x = m / (DENSITY * volume) - 1.0
            inside = max(x, low)
            slope = rise(inside)
            return np.array([p - poly(inside) - slope * (x - inside)]), [{"p": 1, "m": -slope / (DENSITY * volume)}]

        self.update_state, self.evaluate = update_state, evaluate


class Orifice(Component):
    """A sharp orifice, laminar below the transition."""

    def __init__(self, label, factor, d):
        super().__init__(label)
        self.set_terminals(
            Terminal("a", terminal_fluidic, {"pressure": "p0", "massflow": "mf0"}),
            Terminal("b", terminal_fluidic, {"pressure": "p1", "massflow": "mf1"}),
        )

        @self.auto
        def evaluate(p0, p1, mf0, mf1):
            drop = p0 - p1
            w = drop * drop + d * d
            rate = DENSITY * factor * (0.5 * drop * drop + d * d) / w**1.25
            values = np.array([mf0 - DENSITY * factor * drop / w**0.25, mf0 + mf1])
            return values, [{"mf0": 1, "p0": -rate, "p1": rate}, {"mf0": 1, "mf1": 1}]

        self.evaluate = evaluate


def run(step):
    """Return seconds and V (m, N) of one cycle at one time step."""
    system = fons.System()
    wave = fons.wave.Custom([(0, TASK["high"]), (1, 0.0)]) if hasattr(fons.wave, "Custom") else None
    pressure = wave or (lambda t: TASK["high"] if t < 1.0 else 0.0)
    system.add(fons.PressureSource("source", pressure=pressure))
    before, count = "source", len(TASK["volume"])
    for k in range(count):
        system.add(Orifice(f"valve{k}", TASK["K"][k], TASK["d"][k]))
        system.add(Spring(f"spring{k}", TASK["laws"][k], TASK["low"][k], TASK["volume"][k], TASK["start"][k]))
        system.connect(before, (f"valve{k}", "a"))
        system.connect((f"valve{k}", "b"), f"spring{k}")
        before = (f"valve{k}", "b")
    started = time.perf_counter()
    simulation = fons.Simulation(system, duration=2.0, step=step, discretization="backward", verbose=-1)
    simulation.run()
    seconds = time.perf_counter() - started
    at = np.asarray(simulation.times)
    columns = []
    for k in range(count):
        mass = np.asarray(system.get(f"spring{k}").get_state("mass")).ravel()
        columns.append(np.interp(TASK["times"], at[: len(mass)], mass) / (DENSITY * TASK["volume"][k]))
    return {"step": step, "seconds": seconds, "V": np.stack(columns, axis=1).tolist()}


found = []
for step in TASK["steps"]:
    try:
        found.append(run(step))
    except Exception as error:  # whatever a peer raises is its row
        found.append({"step": step, "failed": repr(error)[:200]})
print(json.dumps(found))
