"""The study of pictures under stress: what is missed, and whether anything is wrong."""

import math
import time

import numpy as np

from catheter.lab.report import Progress, Report, Row
from catheter.lab.vision_shots import STRESSES, Stress, plain, qr_shot
from catheter.lab.vision_tally import Tally, ours
from vision.fit import NoMarker
from vision.marker import find
from vision.pattern import QR
from vision.render import render


def twist_stress(quick: bool, progress: Progress) -> Report:
    """One disturbance at a time at its extreme, all at half strength, cut and absent markers, QR codes."""
    count = 8 if quick else 1000
    rows, notes = [], []
    for at, case in enumerate(STRESSES):
        tally = _stressed(case, count, np.random.default_rng(100 + at))
        rows.append(Row(method=case.name, level=f"{count}", error=float(tally.wrong), seconds=tally.seconds / count))
        must = "must all be missed" if case.missing else "at most 1 % may be missed"
        worst = f"; rms {tally.rms:.4f}, worst {max(map(abs, tally.errors)):.4f} deg" if tally.errors else ""
        notes.append(f"{case.name}: missed {len(tally.missed)} of {count} ({must}), wrong {tally.wrong}{worst}.")
        progress((at + 1) / (len(STRESSES) + 1))
    row, note = _codes(8 if quick else 500)
    progress(1.0)
    return Report(
        name="twist-stress",
        title="Pictures under stress: wrong answers (over 0.1 deg and 5 sigma), simulated",
        level="pictures",
        error="wrong",
        rows=[*rows, row],
        notes=[*notes, note],
    )


def _stressed(case: Stress, count: int, draw: np.random.Generator) -> Tally:
    tally = Tally()
    for _ in range(count):
        shot = case.disturb(plain(draw), draw, 1.0)
        tally.take(ours, render(shot, draw), shot.angle_rad)
    if case.missing:  # any answer is a guess
        tally.sigmas = [0.0] * len(tally.errors)
        tally.errors = [max(0.2, abs(error)) for error in tally.errors]
    return tally


def _codes(count: int) -> tuple[Row, str]:
    """Find the three finders of rendered QR codes; wrong is a centre off by over 1 px or by another name."""
    draw, seconds = np.random.default_rng(7), 0.0
    off: list[float] = []
    for _ in range(count):
        shot = qr_shot(draw)
        picture = render(shot, draw)
        started = time.perf_counter()
        try:
            found = find(picture, QR)
        except NoMarker:
            pass
        else:
            off.append(float(np.hypot(*(found.blobs_px - shot.blobs_px()).T).max()))
        seconds += time.perf_counter() - started
    wrong, worst = sum(error > 1 for error in off), max(off, default=math.nan)
    name = "QR codes, rendered: perspective, blur, noise, uneven light"
    note = (
        f"{name}: {len(off) - wrong} of {count} right, {count - len(off)} missed, {wrong} wrong, worst {worst:.3f} px."
    )
    return Row(method=name, level=f"{count}", error=float(wrong), seconds=seconds / count), note
