"""One run of an FMU in this process, for `catheter.fmu_source`; the last line printed is JSON: units, or an error."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np


def main(task: dict[str, Any]) -> dict[str, Any]:
    """Run the FMU in folder task["fmu"], write result.npz, and return the outputs' units, or what went wrong."""
    import fmpy

    try:
        description = fmpy.read_model_description(task["fmu"], validate=False)
    except Exception as error:  # whatever a file from elsewhere makes a parser raise
        return {
            "error": f"its model description cannot be read: {str(error).splitlines()[0] if str(error) else error!r}"
        }
    platforms = fmpy.supported_platforms(task["fmu"])
    if fmpy.platform not in platforms and fmpy.platform_tuple not in platforms:
        offered = ", ".join(platforms) or "none"
        return {"error": f"holds no binary for {fmpy.platform} (it has: {offered}); compile it with: fmpy compile FILE"}
    names = [variable.name for variable in description.modelVariables]
    if lost := [name for name in task["outputs"] if name not in names]:
        return {"error": f"has no variable {lost[0]!r}; it has {', '.join(names)[:200]}"}
    try:
        result = _simulate(task, description)
    except Exception as error:
        return {"error": f"failed: {str(error)[:200] or type(error).__name__}"}
    columns = {name: np.asarray(result[name], np.float64) for name in ("time", *task["outputs"])}
    if not all(np.isfinite(values).all() for values in columns.values()):
        return {"error": "gives values that are not finite"}
    np.savez(Path(task["folder"]) / "result.npz", allow_pickle=False, **columns)
    units = {variable.name: variable.unit or "" for variable in description.modelVariables}
    return {"units": {name: units[name] for name in task["outputs"]}}


def _simulate(task: dict[str, Any], description: Any) -> Any:
    import fmpy

    given = None
    if task["inputs"]:
        with np.load(Path(task["folder"]) / "inputs.npz") as columns:
            order = ["time", *(name for name in columns if name != "time")]
            given = np.array(list(zip(*(columns[name] for name in order), strict=True)), [(n, "f8") for n in order])
    return fmpy.simulate_fmu(
        task["fmu"],
        model_description=description,
        validate=False,
        stop_time=task["end"],
        step_size=task["step"],
        output_interval=task["step"],
        relative_tolerance=task["tolerance"],
        fmi_type=task["kind"] or None,
        input=given,
        output=list(task["outputs"]),
        record_events=False,
    )


if __name__ == "__main__":
    answer = main(json.loads(sys.argv[1]))
    print("\n" + json.dumps(answer), flush=True)
