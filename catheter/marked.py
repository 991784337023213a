"""What a recording of surface markers tells at several pressures: where each stood at rest, and how far it moved.

Stretches of nearly one pressure are looked for, on a staircase its levels, on a ramp pieces of it; in each a
marker's place is its mean, at the mean pressure. The noise is the markers' own scatter at rest.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catheter.inflatable import Shape
from data.errors import BadInput
from data.recording import SIMULATED, Recording
from data.signal import Array, Signal
from fem.attached import attached
from fem.observation import Seen
from fem.voxels import Voxels

TOPIC = "/markers"
STILL = 0.02  # of the highest pressure: what a stretch spans at most
LEAST = 5  # samples of a stretch
LEVELS = 6  # stretches above rest that are used at most
FEWEST = 6  # markers
OFF = 0.25  # of the wall: how far from the surface a marker may be
MOVED = 5.0  # standard deviations beside the wall's share, of a marker that is back at rest


@dataclass(frozen=True, eq=False)
class Stand:
    """A stretch at nearly one pressure: when [s], the mean pressure and its standard deviation [Pa].

    place (m, 3): the markers' means [m], NaN where one was not seen; samples (m,): that each mean is of.
    """

    start_s: float
    end_s: float
    pressure: float
    pressure_sd: float
    place: Array
    samples: Array

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which markers were (m,)."""
        return np.array(np.isfinite(self.place).all(axis=1), dtype=np.bool_)


@dataclass(frozen=True, eq=False)
class Marked:
    """A recording's markers (m) at rest and at other pressures, each coordinate's noise [m], and whose they are.

    truth (v,): the moduli [Pa] of a simulated recording that holds them, else empty. left_out: what was, and why.
    """

    path: Path
    names: tuple[str, ...]
    rest: Stand
    stands: tuple[Stand, ...]
    noise: float
    kind: str
    truth: Array
    left_out: tuple[str, ...]

    def observations(self, voxels: Voxels, shape: Shape) -> list[Seen]:
        """Return the markers' displacements at each pressure as what is seen of a tube.

        Raises BadInput for markers that are not on its surface, naming the one that is farthest off.
        """
        mesh = voxels.mesh
        on = attached(mesh, self.rest.place)
        flat = shape.outer_radius * (1 - np.cos(np.pi / shape.divisions[0]))  # the mesh's faces, inside of the round
        limit = OFF * shape.wall + flat
        out = np.flatnonzero(on.off > limit)
        if len(out):
            worst = int(on.off.argmax())
            where = ", ".join(f"{1e3 * value:.2f}" for value in self.rest.place[worst])
            raise BadInput(
                f"{self.path}, {TOPIC}: {self.names[worst]}",
                f"stands {1e3 * on.off[worst]:.3f} mm off the tube's surface, at ({where}) mm;"
                f" {len(out)} of {len(self.names)} markers are off",
                f"expected at most {1e3 * limit:.3f} mm, z along the tube from its held ring: is it another tube,"
                " or a moved frame?",
            )
        rows = on.rows.tocsr()
        found = []
        for stand in self.stands:
            moved = (stand.place - self.rest.place).ravel()
            known = np.flatnonzero(np.isfinite(moved))
            size = float(np.sqrt((moved[known] ** 2).mean()))
            few = np.median(1 / np.maximum(stand.samples, 1) + 1 / self.rest.samples)
            sd = float(np.hypot(self.noise * np.sqrt(few), size * stand.pressure_sd / stand.pressure))
            found.append(Seen(rows=rows[known], rest=mesh.nodes, target=moved[known], pressure=stand.pressure, sd=sd))
        return found


def is_marked(path: Path) -> bool:
    """Return whether a recording holds markers."""
    with Recording(path) as recording:
        return TOPIC in recording.channels


def marked(path: Path) -> Marked:
    """Return what a recording's /pressure and /markers tell.

    Raises BadInput for coordinates that are no markers', another frame than the base's, too few markers, no
    rest, no other pressure, or markers that come back to rest elsewhere.
    """
    with Recording(path) as recording:
        pressure, seen = recording.signal("/pressure", "pressure"), recording.signal(TOPIC)
        kind = recording.kind
        text = recording.metadata.get("truth", {}).get("map.moduli_pa", "") if kind == SIMULATED else ""
    names, place = _markers(seen, path)
    load = pressure.at(seen.time_s)
    if not np.isfinite(load).any() or not np.nanmax(load) > 0:
        raise BadInput(f"{path}, /pressure", "is never above 0 while markers are seen", "expected a rise from rest")
    stretches = _stretches(seen.time_s, load)
    stands = [_stand(seen.time_s[one], load[one], place[one]) for one in stretches]
    still = STILL * float(np.nanmax(load))
    rests = [stand for stand in stands if abs(stand.pressure) <= still]
    if not rests:
        raise BadInput(
            f"{path}, /pressure", f"no stretch within {still:.3g} Pa of 0", "begin at rest, without pressure"
        )
    rest, left_out = rests[0], list[str]()
    kept = rest.seen
    if not kept.all():
        left_out.append(f"not seen at rest: {_listed(names, ~kept)}")
    if kept.sum() < FEWEST:
        raise BadInput(
            f"{path}, {TOPIC}",
            f"{kept.sum()} of {len(names)} markers are seen at rest, {rest.start_s:.2f} to {rest.end_s:.2f} s",
            f"expected {FEWEST} at least",
        )
    noise = _scatter(place[stretches[stands.index(rest)]][:, kept])
    rest, *others = (_only(stand, kept) for stand in (rest, *_chosen(stands, still)))
    stands = []
    for stand in others:
        if not stand.seen.all():
            what = f"at {stand.pressure / 1e3:.4g} kPa, {stand.start_s:.2f} to {stand.end_s:.2f} s"
            left_out.append(f"not seen {what}: {_listed(names[kept], ~stand.seen)}")
        stands += [stand] if stand.seen.sum() >= FEWEST else []
    if not stands:
        raise BadInput(
            f"{path}, {TOPIC}", f"no pressure but rest at which {FEWEST} markers are seen", "; ".join(left_out)
        )
    truth = np.array([float(one) for one in text.split()])
    result = Marked(path, tuple(names[kept]), rest, tuple(stands), noise, kind, truth, tuple(left_out))
    return _unmoved(result, [_only(one, kept) for one in rests[1:]])


def _markers(seen: Signal, path: Path) -> tuple[NDArray[np.str_], Array]:
    """Return the names (m,) and places (n, m, 3) [m] of a topic's coordinates."""
    place = f"{path}, {TOPIC}"
    if seen.unit != "m" or seen.frame not in ("base", ""):
        raise BadInput(place, f"is in {seen.unit} of frame {seen.frame!r}", "expected m in the frame 'base'")
    columns = {name: k for k, name in enumerate(seen.components)}
    names = list(dict.fromkeys(re.sub(r"_[xyz]$", "", name) for name in columns))
    for name in (f"{marker}_{axis}" for marker in names for axis in "xyz"):
        if name not in columns:
            raise BadInput(place, f"has no component {name}", "expected m1_x, m1_y, m1_z and so on")
    order = [columns[f"{name}_{axis}"] for name in names for axis in "xyz"]
    return np.array(names), seen.value[:, order].reshape(len(seen), len(names), 3)


def _stretches(time_s: Array, load: Array) -> list[slice]:
    """Return stretches in which the pressure, smoothed over a few samples, spans at most STILL of its highest."""
    known = np.array(np.isfinite(load), dtype=np.bool_)
    smooth = np.convolve(np.where(known, load, 0.0), np.ones(LEAST), "same") / np.maximum(
        np.convolve(known, np.ones(LEAST), "same"), 1
    )
    span, found, first = STILL * float(np.nanmax(load)), list[slice](), 0
    low = high = smooth[0]
    for k in range(1, len(time_s) + 1):
        end = k == len(time_s) or not known[k]
        if not end:
            low, high = min(low, smooth[k]), max(high, smooth[k])
        if end or high - low > span:
            if k - first >= LEAST:
                found.append(slice(first, k))
            first = k
            if k < len(time_s):
                low = high = smooth[k]
    return found


def _stand(time_s: Array, load: Array, place: Array) -> Stand:
    good = np.isfinite(place.sum(axis=2))
    counts = good.sum(axis=0)
    total = np.where(good[..., None], place, 0.0).sum(axis=0)
    mean = np.where(counts[:, None] >= min(LEAST, len(time_s)), total / np.maximum(counts, 1)[:, None], np.nan)
    sd = float(load.std(ddof=1) / np.sqrt(len(load)))
    return Stand(float(time_s[0]), float(time_s[-1]), float(load.mean()), sd, mean, counts.astype(np.float64))


def _chosen(stands: list[Stand], still: float) -> list[Stand]:
    """Return the longest stretches above rest, at pressures apart from each other, ascending."""
    above = [stand for stand in stands if stand.pressure > still]
    most = max((stand.pressure for stand in above), default=0.0)
    found = list[Stand]()
    for stand in sorted(above, key=lambda one: -one.samples.max()):
        apart = all(abs(stand.pressure - one.pressure) > most / (2 * LEVELS) for one in found)
        if apart and len(found) < LEVELS:
            found.append(stand)
    return sorted(found, key=lambda one: one.pressure)


def _only(stand: Stand, kept: NDArray[np.bool_]) -> Stand:
    return replace(stand, place=stand.place[kept], samples=stand.samples[kept])


def _scatter(place: Array) -> float:
    """Return the standard deviation of a coordinate about its mean, over markers at rest (n, m, 3) [m]."""
    spread = np.nanvar(place, axis=0, ddof=1)
    return float(np.sqrt(np.nanmean(spread)))


def _unmoved(found: Marked, rests: list[Stand]) -> Marked:
    """Refuse markers that come back to rest elsewhere."""
    most = max(float(np.nanmax(np.abs(one.place - found.rest.place))) for one in found.stands)
    for again in rests:
        off = np.linalg.norm(again.place - found.rest.place, axis=1)
        worst = int(np.nanargmax(np.append(off, 0.0)))
        usual = MOVED * found.noise * float(np.sqrt(1 / max(again.samples.min(), 1) + 1 / found.rest.samples.min()))
        limit = usual + STILL * 2 * most
        if worst < len(off) and off[worst] > limit:
            raise BadInput(
                f"{found.path}, {TOPIC}: {found.names[worst]}",
                f"rests {1e3 * off[worst]:.3f} mm away from where it rested at {found.rest.start_s:.2f} s,"
                f" from {again.start_s:.2f} s on",
                f"expected at most {1e3 * limit:.3f} mm: was the frame or the base moved?",
            )
    return found


def _listed(names: NDArray[np.str_], which: NDArray[np.bool_]) -> str:
    chosen = names[which].tolist()
    more = f" and {len(chosen) - 8} more" if len(chosen) > 8 else ""
    return ", ".join(chosen[:8]) + more
