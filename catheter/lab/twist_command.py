"""The command `twist`: a video, a folder of pictures or a recording in, twist against time out."""

import argparse
import csv
import json
import math
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from catheter.lab.dashboard import check_view, take, view_options
from catheter.lab.outcome import Outcome, progress, table
from data.errors import BadInput
from data.files import cannot_write, check_free, check_inputs, fresh
from data.recorder import Recorder
from data.recording import MEASURED, SIMULATED, UNSTATED
from data.topics import standard
from vision.frames import Frame, Source, open_source
from vision.pattern import QR, SQUARES, Marker
from vision.twist import MISSING, Row, Tracker, Twist, assemble, rows, smooth

if TYPE_CHECKING:
    from catheter.lab.views.twist import TwistView

MOST_LISTED = 20


def twist_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `twist`."""
    parser.add_argument("source", help="a video, a folder of pictures, or a recording (.mcap)")
    parser.add_argument("--out", metavar="FILE", help="twist as .csv or .mcap; an interrupted run is continued")
    parser.add_argument("--marker", choices=("squares", "qr"), default="squares", help="blobs, or a QR code's finders")
    parser.add_argument("--size", metavar="SHARE", type=float, help="a blob's side over the pitch (default 0.4)")
    parser.add_argument("--light", action="store_true", help="light blobs on a dark card")
    parser.add_argument("--topic", help="a recording's camera (default: its only one)")
    parser.add_argument("--rate", type=float, metavar="HZ", help="frames a second, where the source does not say")
    parser.add_argument("--zero", type=int, metavar="FRAME", help="the frame whose twist is zero (default: first seen)")
    parser.add_argument("--smooth", type=float, metavar="RAD_S2", help="fill gaps and smooth, up to this acceleration")
    parser.add_argument("--origin", choices=(MEASURED, SIMULATED), help="where a video's or folder's frames are from")
    view_options(parser, "overlay of marker, angle and region on the frames")
    parser.add_argument("--force", action="store_true", help="overwrite the outputs")


@dataclass
class Summary:
    """What is kept of the frames: a small row for each, where markers stand in a folder's pictures."""

    found: list[Row]
    places: dict[int, list[list[float]]]
    resumed: int = 0
    followed: int = 0

    def keep(self, row: Row, named: bool) -> None:
        """Remember a row without its picture's details: memory holds some hundred bytes a frame."""
        self.followed += row.followed
        if named and row.fit:
            self.places[row.number] = row.fit.blobs_px.tolist()
        self.found.append(replace(row, fit=None))


def twist_(options: argparse.Namespace) -> Outcome:
    """Measure twist; exit code 0 also when frames are missing, which are listed."""
    source = open_source(options.source, topic=options.topic, rate_hz=options.rate)
    out = Path(options.out) if options.out else None
    if out and out.suffix not in (".csv", ".mcap"):
        raise BadInput("--out", f"is {out}", "expected a name ending in .csv or .mcap")
    inputs = [source.path] if source.kind != "folder" else []
    check_view(options, *inputs)
    if out:
        check_inputs(out, *inputs)
        check_free(out, options.force)
    if options.origin and source.kind == "recording":
        raise BadInput("--origin", "given for a recording", "it says itself where its frames are from")
    source = replace(source, origin=options.origin) if options.origin else source
    if out and out.suffix == ".mcap" and source.origin == UNSTATED:
        raise BadInput(source.path, "does not say where its frames are from", "state --origin measured or simulated")
    unseen = options.picture and not options.view  # the dashboard that only a picture is taken of
    with TemporaryDirectory() if unseen else nullcontext("") as folder:
        shown = Path(folder) / "twist.rrd" if unseen else options.view
        kept, partial = _measure(source, _marker(options), out, Path(shown) if shown else None, options.force)
        outcome = Outcome({})
        if options.picture and shown:
            take(outcome, Path(shown), Path(options.picture), force=options.force)
    found = assemble(kept.found, options.zero)
    if options.smooth is not None:
        found = smooth(found, options.smooth)
    if out:
        save(found, out, source, replace_it=options.force)
    if partial:
        partial.unlink(missing_ok=True)
    if source.kind == "folder" and options.rate is None:
        outcome.parts.append("The folder has no clock and --rate was not given: time_s counts pictures.")
    values = _values(kept, found, source) | {"out": options.out, "view": options.view}
    outcome.values, outcome.parts = values | outcome.values, [*_parts(values), *outcome.parts]
    return outcome


def save(twist: Twist, out: Path, source: Source, *, replace_it: bool = False) -> None:
    """Write a twist as CSV (time_s, angle_rad, sigma_rad, status) or as topic /twist of a recording."""
    if out.suffix == ".mcap":
        origin = {"kind": source.origin, "title": f"Twist of {source.path.name}"}
        with Recorder(out, origin, flush_s=None, replace=replace_it) as recorder:
            recorder.add(replace(standard("/twist"), note=f"from {source.path.name} {source.topic}".strip()))
            for time_s, *values in zip(twist.time_s, twist.angle_rad, twist.sigma_rad, strict=True):
                recorder.write("/twist", float(time_s), values)
        return
    with fresh(out, replace_it) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", "angle_rad", "sigma_rad", "status"])
        columns = (twist.time_s, twist.angle_rad, twist.sigma_rad)
        for *numbers, status in zip(*columns, twist.status, strict=True):
            writer.writerow([*(repr(float(number)) for number in numbers), status])


def _marker(options: argparse.Namespace) -> Marker:
    marker = replace(QR if options.marker == "qr" else SQUARES, light=options.light)
    if options.size is None:
        return marker
    if not 0.03 < options.size < 0.85:
        raise BadInput("--size", f"is {options.size}", "expected a blob's side over the pitch, 0.03 to 0.85")
    return replace(marker, least_size=0.9 * options.size, most_size=1.1 * options.size)


def _measure(
    source: Source, marker: Marker, out: Path | None, view: Path | None, force: bool
) -> tuple[Summary, Path | None]:
    """Return what the frames gave, and the file that keeps it until the output is written."""
    partial = out.with_name(f".{out.name}.frames") if out else None
    head: dict[str, Any] = {"source": str(source.path.resolve()), "topic": source.topic, "marker": asdict(marker)}
    head |= {"modified": source.path.stat().st_mtime_ns, "rate_hz": source.rate_hz}
    kept = Summary(_resume(partial, head), {})
    kept.resumed = len(kept.found)
    with ExitStack() as stack:
        advance = stack.enter_context(progress("twist"))
        overlay: TwistView | None = None
        if view:
            from catheter.lab.views import twist as shown

            overlay = stack.enter_context(shown.TwistView(view, source, replace=force))
        file = None
        if partial:
            try:
                file = stack.enter_context(partial.open("a" if kept.found else "w", encoding="utf-8"))
            except OSError as error:
                raise cannot_write(partial, error) from error
            if not kept.found:
                file.write(json.dumps(head) + "\n")
        frames = _shown(source.frames(kept.resumed), overlay)
        for row in rows(frames, Tracker(marker)):
            kept.keep(row, source.kind == "folder")
            if overlay:
                overlay.mark(row)
            if file:
                file.write(
                    json.dumps([row.number, row.time_s, row.angle_rad, row.sigma_rad, row.reason, row.name]) + "\n"
                )
                file.flush()
            advance((row.number + 1) / max(source.count, row.number + 1))
    return kept, partial


def _resume(partial: Path | None, head: dict[str, Any]) -> list[Row]:
    """Return the rows that an interrupted run of the same question left, up to its last whole line."""
    if partial is None or not partial.is_file():
        return []
    lines = partial.read_text("utf-8").splitlines(keepends=True)
    found: list[Row] = []
    try:
        if json.loads(lines[0]) != head:
            return []
        for line in lines[1:]:
            row = Row(*json.loads(line))
            if not line.endswith("\n") or row.number != len(found):
                break
            found.append(row)
    except (ValueError, IndexError, TypeError):  # cut in the middle of a line: what came before it counts
        pass
    whole = "".join(lines[: len(found) + 1])
    if found:
        partial.write_text(whole, "utf-8")
    return found


def _shown(frames: Iterable[Frame], overlay: "TwistView | None") -> Iterator[Frame]:
    for frame in frames:
        if overlay:
            overlay.picture(frame)
        yield frame


def _values(kept: Summary, twist: Twist, source: Source) -> dict[str, Any]:
    angle = twist.angle_rad[np.array([row.status != MISSING for row in kept.found], dtype=bool)]
    values: dict[str, Any] = {
        "source": str(source.path),
        "kind": source.origin,
        "topic": source.topic,
        "frames": len(kept.found),
        "measured": len(angle),
        "followed": kept.followed,
        "resumed_at": kept.resumed,
        "reference": twist.reference,
        "least_rad": float(angle.min()) if len(angle) else math.nan,
        "most_rad": float(angle.max()) if len(angle) else math.nan,
        "median_sigma_rad": float(np.median(twist.sigma_rad[~np.isnan(twist.sigma_rad)])) if len(angle) else math.nan,
        "doubtful_turns": list(twist.doubtful),
        "failed": [
            {"frame": row.number, "time_s": row.time_s, "name": row.name, "reason": row.reason}
            for row in kept.found
            if row.status == MISSING
        ],
    }
    if source.kind == "folder":
        values["pictures"] = [_picture(row, kept.places.get(row.number)) for row in kept.found]
    return values


def _picture(row: Row, places: list[list[float]] | None) -> dict[str, Any]:
    corner, second, third = places or (None, None, None)
    return {
        "name": row.name,
        "status": row.status,
        "reason": row.reason,
        "angle_rad": row.angle_rad,
        "sigma_rad": row.sigma_rad,
        "corner_px": corner,
        "second_px": second,
        "third_px": third,
    }


def _parts(values: dict[str, Any]) -> Iterator[Any]:
    yield f"{values['source']} ({values['kind']}): {values['measured']} of {values['frames']} frames with a marker"
    if values["resumed_at"]:
        yield f"Continued at frame {values['resumed_at']}, where an earlier run was interrupted"
    if values["measured"]:
        low, high = math.degrees(values["least_rad"]), math.degrees(values["most_rad"])
        sigma = math.degrees(values["median_sigma_rad"])
        yield f"Twist {low:.4f} to {high:.4f} deg from frame {values['reference']}, sigma {sigma:.2g} deg (median)"
    if values["doubtful_turns"]:
        yield f"Turns may be miscounted before frames {', '.join(map(str, values['doubtful_turns'][:MOST_LISTED]))}"
    failed = values["failed"]
    if failed:
        cells = [[str(f["frame"]), f"{f['time_s']:.3f}", f["name"], f["reason"]] for f in failed[:MOST_LISTED]]
        yield table(["frame", "time s", "file", "why it has no twist"], cells, words=4)
    if len(failed) > MOST_LISTED:
        yield f"and {len(failed) - MOST_LISTED} further frames; --json lists all"
    yield from (f"{values[key]} written" for key in ("out", "view") if values[key])
