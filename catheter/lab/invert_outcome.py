"""What an inversion found, for scripts and for people."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.outcome import Outcome, table

if TYPE_CHECKING:
    from catheter.lab.views.inverse import InverseView
    from data.signal import Array
    from fem.inverse import Inversion, Problem, Reconstruction
    from fem.uncertainty import Determined

MOST_DENSE = 4096  # voxels whose dense curvature is made


def sure_of(
    problem: "Problem", found: "Reconstruction", variation: Any, inversion: "Inversion", view: "InverseView | None"
) -> "Determined | None":
    """Return what the data determine of a map, on the dashboard too; None: more voxels than a dense matrix is for."""
    from fem.uncertainty import determined

    if problem.voxels.count > MOST_DENSE:
        return None
    known = determined(problem, found, variation, inversion)
    if view:
        view.sure(known.sd)
    return known


def outcome_of(  # noqa: PLR0917
    title: str,
    kind: str,
    problem: "Problem",
    found: "Reconstruction",
    truth: "Array",
    known: "Determined | None",
    grid: tuple[int, ...],
) -> Outcome:
    """Return what is said of a map: its history, errors beside the truth if it is known, and what the data determine.

    kind: of the data; truth (v,) [Pa], empty: not known; known: see `sure_of`.
    """
    from catheter.reconstruction import Quality

    quality = Quality.of(found.moduli, truth) if len(truth) else None
    unit = "noises" if problem.noisy else "of the largest value"
    history = [
        {"iteration": i.number, "seconds": i.seconds, "misfit": i.misfit, "weight": i.weight} for i in found.history
    ]
    values = {
        "simulated": kind == "simulated",
        "title": title,
        "seconds": found.seconds,
        "ended": found.why,
        "peak_memory_bytes": peak_memory(),
        "misfit": found.misfit,
        "weight": found.weight,
        "strengthened": found.strengthened,
        "at_bounds": {"least": int((found.bounded < 0).sum()), "most": int((found.bounded > 0).sum())},
        "error": asdict(quality) if quality else None,
        "determined": {
            "singular_values": known.singular.tolist(),
            "posterior_sd_log": known.sd.tolist(),
            "undetermined_voxels": int((~known.seen).sum()),
        }
        if known
        else None,
        "history": history,
        "moduli_pa": found.moduli.reshape(grid).tolist(),
    }
    rows = [[str(h["iteration"]), f"{h['seconds']:.2f}", f"{h['misfit']:.2e}", f"{h['weight']:.1e}"] for h in history]
    beside = (
        f"; modulus errors: largest {quality.largest:.2e}, median {quality.median:.2e};"
        f" {100 * quality.right:.1f} % on the right side of stiff/soft."
        if quality
        else "; nobody knows the true moduli."
    )
    parts = [
        table(["iteration", "s", f"misfit, {unit}", "weight"], rows, f"{title} ({kind})", words=0),
        f"{found.why} after {found.seconds:.1f} s{beside}",
        f"At the least modulus {(found.bounded < 0).sum()}, at the most {(found.bounded > 0).sum()} of"
        f" {len(found.moduli)}; the seed was doubled {found.strengthened} times.",
        f"More than {MOST_DENSE} voxels: what the data determine is not worked out."
        if known is None
        else f"Singular values {known.singular[0]:.2e} to {known.singular[-1]:.2e}; posterior sd of log modulus: median"
        f" {np.median(known.sd):.1e}, most {known.sd.max():.1e}; in {(~known.seen).sum()} voxels"
        " what is believed of neighbours weighs more than the data.",
    ]
    return Outcome(values, parts)


def peak_memory() -> int | None:
    """Return the most memory this process has held [bytes], where the system says."""
    try:
        import resource
    except ImportError:
        return None
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
