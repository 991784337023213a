"""Exported circuits run in other tools as they run here; FMUs from elsewhere drive, or are refused."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from catheter import fmu, fmu_source
from catheter.hydraulics import ConicalValve, Solver, SquareWave, simulate, thesis_circuit
from data.errors import BadInput, CannotWrite

CIRCUIT = thesis_circuit()
SQUARE = {"time": np.array([0.0, 1.0, 1.0, 2.0]), "u": np.array([83e3, 83e3, 0.0, 0.0])}
VOLUMES = ("V[1]", "V[2]", "V[3]")


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fmu.export(CIRCUIT, tmp_path_factory.mktemp("fmu") / "circuit.fmu")


def test_it_passes_fmpy_validation_and_comes_out_the_same_every_time(exported: Path, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(exported)) == []
    first, second = (fmu.export(CIRCUIT, tmp_path / f"{i}.fmu", binary=False) for i in (1, 2))
    assert first.read_bytes() == second.read_bytes()
    assert validate_fmu(str(first)) == []


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
def test_both_ways_of_running_agree_with_ours(exported: Path, kind: str) -> None:
    ours = simulate(CIRCUIT, SquareWave().drive(1), solver=Solver(tolerance=1e-11))
    names = (*VOLUMES, "P[2]", "Q[1]")
    found = fmu_source.run(exported, names, 2.0, step_s=0.01, kind=kind, inputs=SQUARE, tolerance=1e-9)
    assert len(found.time_s) >= 201
    volume = np.stack([found.values[name] for name in VOLUMES], axis=1)
    np.testing.assert_allclose(volume, ours.at(found.time_s), atol=1e-6, rtol=0)
    assert found.units == dict.fromkeys(VOLUMES, "1") | {"P[2]": "Pa", "Q[1]": "m3/s"}
    np.testing.assert_allclose(found.values["P[2]"], ours.pressure_pa(found.time_s)[:, 1], atol=1.0)
    smooth = np.abs(found.time_s - 1.0) > 1e-9  # at the switch the flow jumps
    np.testing.assert_allclose(found.values["Q[1]"][smooth], ours.flow_m3_s(found.time_s[smooth])[:, 0], atol=1e-6)


def test_a_chain_of_another_length_with_cracking_valves_agrees_too(tmp_path: Path) -> None:
    from dataclasses import replace

    valve = ConicalValve(coefficient=4e-7, forward=2e3, reverse=5e3)
    first, second, third = CIRCUIT.segments
    circuit = replace(CIRCUIT, segments=(first, replace(second, valve=valve), third, third))
    path = fmu.export(circuit, tmp_path / "four.fmu")
    ours = simulate(circuit, SquareWave().drive(1), solver=Solver(tolerance=1e-11))
    found = fmu_source.run(path, ("V[2]", "V[4]"), 2.0, step_s=0.05, kind="CoSimulation", inputs=SQUARE)
    np.testing.assert_allclose(found.values["V[2]"], ours.at(found.time_s)[:, 1], atol=1e-6)
    np.testing.assert_allclose(found.values["V[4]"], ours.at(found.time_s)[:, 3], atol=1e-6)


def test_directional_derivatives_states_and_refusals_of_the_c_interface(exported: Path, tmp_path: Path) -> None:
    import fmpy
    from fmpy.fmi2 import FMU2Model

    folder = fmpy.extract(str(exported), unzipdir=str(tmp_path / "unpacked"))
    description = fmpy.read_model_description(folder)
    model = FMU2Model(guid=description.guid, unzipDirectory=folder, modelIdentifier="circuit", instanceName="one")
    model.instantiate()
    model.setupExperiment(startTime=0.0)
    model.enterInitializationMode()
    model.setReal([0], [50e3])
    model.exitInitializationMode()
    reference = {variable.name: variable.valueReference for variable in description.modelVariables}
    x, rates = [reference[f"x[{k}]"] for k in (1, 2, 3)], [reference[f"der(x[{k}])"] for k in (1, 2, 3)]
    outputs = [*rates, *(reference[f"{name}[{k}]"] for name in "PQ" for k in (1, 2, 3))]
    at = np.array([0.2, 0.15, 0.1])
    for column, (known, step) in enumerate([(x[0], 1e-6), (x[1], 1e-6), (x[2], 1e-6), (0, 1.0)]):
        exact = model.getDirectionalDerivative(vUnknown_ref=outputs, vKnown_ref=[known], dvKnown=[1.0])
        sides = []
        for sign in (1, -1):
            states, source = at.copy(), 50e3
            if column < 3:
                states[column] += sign * step
            else:
                source += sign * step
            model.setReal([*x, 0], [*states, source])
            sides.append(np.array(model.getReal(outputs)))
        model.setReal([*x, 0], [*at, 50e3])
        exact = np.array(model.getDirectionalDerivative(vUnknown_ref=outputs, vKnown_ref=[known], dvKnown=[1.0]))
        difference = (sides[0] - sides[1]) / (2 * step)
        np.testing.assert_allclose(exact, difference, rtol=1e-5, atol=1e-6 * np.abs(difference).max())
    kept = model.getFMUstate()
    bytes_kept = model.serializeFMUstate(kept)
    model.setReal(x, [0.0, 0.1, 0.2])
    model.setFMUstate(model.deSerializeFMUstate(bytes_kept))
    assert model.getReal(x) == at.tolist()
    with pytest.raises(Exception, match="fmi2SetReal"):
        model.setReal([reference["K[1]"]], [1.0])  # a fixed parameter, while running
    with pytest.raises(Exception, match="fmi2GetReal"):
        model.getReal([10_000])
    model.freeFMUstate(kept)
    model.terminate()
    model.freeInstance()


DRIVER = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

class Pump(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.pressure = 0.0
        self.register_variable(Real("pressure", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        BODY
        return True
"""


def driver(folder: Path, body: str) -> Path:
    """Build an FMU with pythonfmu, a tool of others."""
    from pythonfmu.builder import FmuBuilder

    script = folder / "pump.py"
    script.write_text(DRIVER.replace("BODY", body))
    FmuBuilder.build_FMU(script, dest=folder)
    return folder / "Pump.fmu"


def test_an_fmu_of_another_tool_drives_the_circuit(tmp_path: Path) -> None:
    path = driver(tmp_path, "self.pressure = 40 * (current_time + step_size)")
    source = fmu_source.FmuSource(path=str(path), output="pressure", unit="kPa", step=0.05)
    drive = source.drive(1.0)
    np.testing.assert_allclose(drive.at(np.array([0.0, 0.5, 0.975])), [0.0, 20e3, 39e3], atol=1e-6)
    with pytest.raises(BadInput, match="states no unit"):
        fmu_source.FmuSource(path=str(path), output="pressure", step=0.05).drive(1.0)
    with pytest.raises(BadInput, match="Pa"):
        fmu_source.FmuSource(path=str(path), output="pressure", unit="mL", step=0.05).drive(1.0)
    run = simulate(CIRCUIT, drive)
    assert run.volume[-1, 0] > 1.1


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("while True: pass", "did not finish 1 s of its time in 3 s"),
        ("import os; os.abort()", "crashed"),
        ("raise ValueError('the pump is dry')", "failed"),
        ("self.pressure = float('nan')", "not finite"),
    ],
)
def test_a_model_that_hangs_crashes_or_fails_is_stopped_and_said(tmp_path: Path, body: str, said: str) -> None:
    path = driver(tmp_path, body)
    with pytest.raises(BadInput, match=said):
        fmu_source.FmuSource(path=str(path), output="pressure", step=0.5, timeout=3.0).drive(1.0)


def rezipped(source: Path, path: Path, change) -> Path:
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(path, "w") as new:
        for entry in old.infolist():
            for name, content in change(entry.filename, old.read(entry)):
                new.writestr(name, content)
    return path


def test_archives_that_are_none_lie_or_climb_out_are_refused(exported: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.fmu"
    content = exported.read_bytes()
    changed = bytearray(content)
    changed[len(content) // 2] ^= 0xFF

    def refused(said: str, path: Path = bad, output: str = "V[1]") -> None:
        with pytest.raises(BadInput, match=said):
            fmu_source.run(path, (output,), 1.0, step_s=0.1)

    refused("No such file")
    bad.write_bytes(b"not a zip")
    refused("is no FMU")
    bad.write_bytes(content[: len(content) // 2])
    refused("is no FMU")
    bad.write_bytes(bytes(changed))
    refused("cannot be unpacked|is no FMU|crashed|failed|cannot be read")
    for name in ("../../climbed.txt", "/climbed.txt", "a\\..\\climbed.txt", "C:climbed.txt"):
        rezipped(exported, bad, lambda n, c, name=name: [(n, c)] + ([(name, b"x")] if n.endswith("xml") else []))
        refused("leads out of its folder")
    assert not list(tmp_path.parent.glob("**/climbed.txt"))
    rezipped(exported, bad, lambda n, c: [] if n.endswith("xml") else [(n, c)])
    refused("holds no modelDescription.xml")
    rezipped(exported, bad, lambda n, c: [(n, c[:200] if n.endswith("xml") else c)])
    refused("model description cannot be read")
    rezipped(exported, bad, lambda n, c: [] if n.startswith("binaries") else [(n, c)])
    refused("holds no binary for")
    refused("has no variable 'W'", exported, "W")
    rezipped(exported, bad, lambda n, c: [(n, b"\0" * len(c) if n.startswith("binaries") else c)])
    refused("failed")


def test_an_archive_that_unpacks_to_a_mountain_is_refused(exported: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(fmu_source, "MOST_BYTES", 10_000)
    with pytest.raises(BadInput, match="unpacks to"):
        fmu_source.run(exported, ("V[1]",), 1.0, step_s=0.1)


def test_without_a_compiler_the_binary_is_refused_and_the_source_still_comes(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("CC", str(tmp_path / "no-such-compiler"))
    with pytest.raises(CannotWrite, match="cannot be compiled.*install a C compiler"):
        fmu.export(CIRCUIT, tmp_path / "a.fmu")
    assert not (tmp_path / "a.fmu").exists()
    assert fmu.export(CIRCUIT, tmp_path / "a.fmu", binary=False).is_file()
    with pytest.raises(CannotWrite):
        fmu.export(CIRCUIT, tmp_path / "a.fmu", binary=False)  # there is one already
