"""Circuits as FMUs for other tools: FMI 2.0, model exchange and co-simulation in one.

An exported FMU holds C source, the circuit's numbers, and a binary for this machine.
"""

import os
import subprocess
import sys
import sysconfig
import tempfile
import uuid
import zipfile
from itertools import count
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from catheter import circuit_kernel as kernel
from catheter.circuit import Circuit
from data.errors import CannotWrite
from data.files import fresh
from data.signal import Array

TOLERANCE = 1e-8  # of co-simulation: local error of V/V_rest
NAMESPACE = uuid.UUID("5d0cbcd5-64c5-4b5f-8b8e-0f1e1b0a7c11")
_SOURCE = Path(__file__).with_name("circuit.c")
_PARAMETERS = {
    "volume": (kernel.PER_VOLUME, "m3", "volume at rest"),
    "K": (kernel.FLOW, "m3/(s.Pa0.5)", "flow coefficient of the valve before the segment"),
    "transition": (kernel.TRANSITION, "Pa", "pressure drop at which the flow turns turbulent, or over which it opens"),
    "forward": (kernel.FORWARD, "Pa", "forward cracking pressure"),
    "reverse": (kernel.REVERSE, "Pa", "reverse cracking pressure"),
    "cracking": (kernel.CRACKING, "1", "1: a valve that cracks, 0: an orifice"),
    "stiffness": (kernel.STIFFNESS, "1", "factor on the accumulator's pressure"),
}
_UNITS = {"Pa": {"kg": 1, "m": -1, "s": -2}, "m3": {"m": 3}, "m3/s": {"m": 3, "s": -1}, "s-1": {"s": -1}, "1": {}}


def export(circuit: Circuit, path: Path, *, binary: bool = True, replace: bool = False) -> Path:
    """Write a circuit as an FMU and return its path; input u [Pa], outputs V, P [Pa] and Q [m^3/s] by segment.

    binary: compile for this machine too, which needs a C compiler; other machines, and other tools,
    compile the source. Raises CannotWrite for the file, and where nothing here compiles.
    """
    header = _header(circuit)
    guid = "{" + str(uuid.uuid5(NAMESPACE, header + _SOURCE.read_text("utf-8"))) + "}"
    with tempfile.TemporaryDirectory() as folder, fresh(path, replace) as temporary:
        tree = Path(folder)
        (tree / "sources").mkdir()
        (tree / "sources" / "circuit.c").write_text(_SOURCE.read_text("utf-8"), "utf-8")
        (tree / "sources" / "circuit_table.h").write_text(header + f'#define GUID "{guid}"\n', "utf-8")
        description = _description(circuit, guid)
        (tree / "modelDescription.xml").write_bytes(ElementTree.tostring(description, "utf-8", xml_declaration=True))
        if binary:
            _compile(tree, path)
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(tree.rglob("*")):
                entry = zipfile.ZipInfo(file.relative_to(tree).as_posix())  # dated 1980: the same bytes every time
                if file.is_file():
                    archive.writestr(entry, file.read_bytes(), zipfile.ZIP_DEFLATED)
    return path


def _header(circuit: Circuit) -> str:
    """Return circuit_table.h: the circuit and the Rosenbrock method, every digit of every number."""
    table = circuit.table()
    start = circuit.volume() - 1.0
    parameters = _values(circuit)
    arrays = {
        "STATES_AT_START[SEGMENTS]": start,
        f"PARAMETERS[{len(parameters)}][SEGMENTS]": parameters,
        "LOW[SEGMENTS]": table[:, kernel.LOW],
        "HIGH[SEGMENTS]": table[:, kernel.HIGH],
        "POLYNOMIAL[SEGMENTS][COEFFICIENTS]": table[:, kernel.FIRST :],
        "A[STAGES][STAGES]": kernel.A,
        "C[STAGES][STAGES]": kernel.C,
    }
    numbers = {"SEGMENTS": len(table), "COEFFICIENTS": table.shape[1] - kernel.FIRST, "STAGES": kernel.STAGES}
    numbers |= {"METHOD_ORDER": kernel.ORDER, "GAMMA": float(kernel.GAMMA), "TOLERANCE": TOLERANCE}
    lines = ["#include <math.h>", *(f"#define {name} {value!r}" for name, value in numbers.items())]
    lines += [f"static const double {name} = {_braces(values)};" for name, values in arrays.items()]
    return "\n".join(lines) + "\n"


def _values(circuit: Circuit) -> Array:
    """Return the parameters' values, one row each (k, N)."""
    values = circuit.table()[:, [column for column, _, _ in _PARAMETERS.values()]].T
    values[0] = [segment.accumulator.rest_volume for segment in circuit.segments]  # the table holds 1/volume
    return np.asarray(values)


def _braces(values: Array) -> str:
    if values.ndim:
        return "{" + ", ".join(_braces(value) for value in values) + "}"
    number = float(values)
    return number.hex() if np.isfinite(number) else "HUGE_VAL" if number > 0 else "-HUGE_VAL"


def _description(circuit: Circuit, guid: str) -> ElementTree.Element:
    """Return modelDescription.xml; value references as circuit.c counts them."""
    about = {"fmiVersion": "2.0", "modelName": "circuit", "guid": guid, "numberOfEventIndicators": "0"}
    about |= {"description": "Hydraulic chain of soft segments (simulated)", "variableNamingConvention": "structured"}
    root = ElementTree.Element("fmiModelDescription", about | {"generationTool": "catheter robot toolkit"})
    for kind in ("ModelExchange", "CoSimulation"):
        able = {"modelIdentifier": "circuit", "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
        able |= {"providesDirectionalDerivative": "true"}
        able |= {"canHandleVariableCommunicationStepSize": "true"} if kind == "CoSimulation" else {}
        files = ElementTree.SubElement(ElementTree.SubElement(root, kind, able), "SourceFiles")
        ElementTree.SubElement(files, "File", name="circuit.c")
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for name in (*_UNITS, "m3/(s.Pa0.5)"):  # the last has a half exponent, which FMI cannot say
        unit = ElementTree.SubElement(units, "Unit", name=name)
        if name in _UNITS:
            ElementTree.SubElement(unit, "BaseUnit", {key: str(power) for key, power in _UNITS[name].items()})
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0", stopTime="2", tolerance="1e-6")
    _variables(circuit, root)
    return root


def _variables(circuit: Circuit, root: ElementTree.Element) -> None:
    variables = ElementTree.SubElement(root, "ModelVariables")
    start, reference, size = circuit.volume() - 1.0, count(), len(circuit.segments)

    def add(name: str, what: str, kind: dict[str, str], unit: str, **more: str) -> None:
        attributes = {"name": name, "valueReference": str(next(reference)), "description": what, **kind}
        ElementTree.SubElement(
            ElementTree.SubElement(variables, "ScalarVariable", attributes), "Real", {"unit": unit, **more}
        )

    output = {"causality": "output", "variability": "continuous", "initial": "calculated"}
    local = output | {"causality": "local"}
    exact = {"causality": "local", "variability": "continuous", "initial": "exact"}
    add("u", "source pressure", {"causality": "input", "variability": "continuous"}, "Pa", start="0")
    for k in range(size):
        add(f"x[{k + 1}]", "V/V_rest - 1", exact, "1", start=repr(float(start[k])), nominal="1")
    for k in range(size):
        add(f"der(x[{k + 1}])", "rate of x", local, "s-1", derivative=str(k + 2))
    for name, what, unit in (("V", "V/V_rest", "1"), ("P", "pressure", "Pa"), ("Q", "flow into the segment", "m3/s")):
        for k in range(size):
            add(f"{name}[{k + 1}]", what, output, unit)
    fixed = {"causality": "parameter", "variability": "fixed", "initial": "exact"}
    for row, (name, (_, unit, what)) in zip(_values(circuit), _PARAMETERS.items(), strict=True):
        for k in range(size):
            add(f"{name}[{k + 1}]", what, fixed, unit, start=repr(float(row[k])))
    structure = ElementTree.SubElement(root, "ModelStructure")
    derivatives, outputs = range(size + 2, 2 * size + 2), range(2 * size + 2, 5 * size + 2)
    groups = {"Outputs": [*outputs], "Derivatives": [*derivatives], "InitialUnknowns": [*derivatives, *outputs]}
    for group, members in groups.items():
        found = ElementTree.SubElement(structure, group)
        for index in members:
            ElementTree.SubElement(found, "Unknown", index=str(index))


_COMPILE = "import sys; from fmpy.build import build_platform_binary; build_platform_binary(sys.argv[1])"


def _compile(tree: Path, path: Path) -> None:
    scripts = os.pathsep.join([sysconfig.get_path("scripts"), os.environ.get("PATH", "")])  # cmake, from its wheel
    command = [sys.executable, "-c", _COMPILE, str(tree)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"PATH": scripts})
    if done.returncode:
        said = [line.strip() for line in (done.stdout + done.stderr).splitlines() if "error" in line.lower()]
        why = said[0][:120] if said else f"cmake ended with {done.returncode}"
        raise CannotWrite(
            path, f"its binary cannot be compiled ({why}); install a C compiler, or export the source only"
        )
