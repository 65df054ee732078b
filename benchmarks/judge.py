"""How good a scene looks from the fixed views (`benchmarks.views`), and how many bytes equal quality takes.

A file is as good as a rival's if the mean, the 5th percentile and the worst of its views are at least the rival's.
Several `.scar` files of a scene, encoded for several qualities, tell how many bytes that takes: the logarithm of the
bytes is interpolated linearly between the largest file that is not as good and the next larger one that is. Nothing is
extrapolated: where no file is as good the answer is None, and where all are it is the smallest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.scenes import Scene
from benchmarks.views import KINDS, View
from scarfmt.cli.scenes import Subject
from scarfmt.render.compare import compare, compare_with_photos

EQUAL_DB = 100.0
"""PSNR that equal pictures count as, dB."""
LOSSLESS_DB = 90.0
"""A file with this mean PSNR or more counts as lossless, not as a lossy rival."""
PERCENTILE = 5
LEVELS = ("psnr_db", "p5_psnr_db", "worst_psnr_db")
"""Mean, 5th percentile and worst view: what equal quality compares."""

Row = dict[str, Any]
"""Figures of one file: ``bytes`` and `LEVELS`, among others."""


def judge(original: Subject, other: Subject, views: Sequence[View]) -> Row:
    """Compare pictures of `other` with pictures of `original`.

    Returns:
        See :func:`summarise`, and ``ssim``, the mean.
    """
    found = compare(original.view, other.view, [view.camera for view in views])
    levels = np.minimum(found.psnr_db, EQUAL_DB)
    return {**summarise([view.kind for view in views], levels.tolist()), "ssim": round(found.mean_ssim, 5)}


def summarise(kinds: Sequence[str], levels: Sequence[float]) -> Row:
    """Summarise the PSNR of views, dB.

    Returns:
        `LEVELS` over all views, and ``kinds``: mean and least of each kind that there is.
    """
    by_kind = {kind: [level for k, level in zip(kinds, levels, strict=True) if k == kind] for kind in KINDS}
    return {
        "psnr_db": round(float(np.mean(levels)), 3),
        "p5_psnr_db": round(float(np.percentile(levels, PERCENTILE)), 3),
        "worst_psnr_db": round(min(levels), 3),
        "kinds": {
            kind: [round(float(np.mean(mine)), 3), round(min(mine), 3)] for kind, mine in by_kind.items() if mine
        },
    }


def measure_photos_psnr(scene: Scene, subject: Subject) -> float | None:
    """Mean PSNR against the held-out photos of the capture, dB; None where there are none."""
    if scene.photos is None:
        return None
    return round(compare_with_photos(subject.view, scene.photos, ssim=False).mean_psnr_db, 3)


def format_levels(row: Row) -> str:
    """Mean, 5th percentile and worst, as tables show them."""
    if row["worst_psnr_db"] >= EQUAL_DB:
        return "equal"
    return " / ".join(f"{row[name]:.1f}" for name in LEVELS)


def worst_kind(row: Row) -> tuple[str, float]:
    """The kind with the least mean, and that mean, dB."""
    kind = min(row["kinds"], key=lambda kind: float(row["kinds"][kind][0]))
    return kind, float(row["kinds"][kind][0])


def margin(ours: Row, theirs: Row, levels: Sequence[str] = LEVELS) -> float:
    """How much better `ours` is where it is least so: dB, negative where it lacks something."""
    return min(float(ours[level]) - float(theirs[level]) for level in levels)


def bytes_at(curve: Sequence[tuple[float, float]], at: float) -> float | None:
    """Bytes at a PSNR on a curve through (dB, bytes) points, ascending; None where it does not reach."""
    for low, high in pairwise(curve):
        if low[0] <= at <= high[0]:
            return interpolate_bytes(low, high, at)
    return curve[0][1] if len(curve) == 1 and curve[0][0] == at else None


def interpolate_bytes(low: tuple[float, float], high: tuple[float, float], at: float) -> float:
    """Bytes at a PSNR between two (dB, bytes) points: their logarithm lies on the line through both."""
    share = (at - low[0]) / (high[0] - low[0]) if high[0] > low[0] else 0.0
    return math.exp((1 - share) * math.log(low[1]) + share * math.log(high[1]))


def equal_bytes(files: Sequence[Row], rival: Row, levels: Sequence[str] = LEVELS) -> float | None:
    """Bytes of a file as good as `rival`, from some files of one scene; None if none is as good."""
    last: Row | None = None
    for file in sorted(files, key=lambda file: int(file["bytes"])):
        here = margin(file, rival, levels)
        if here < 0:
            last = file
        elif last is None:
            return float(file["bytes"])
        else:
            before = margin(last, rival, levels)
            return interpolate_bytes((before, last["bytes"]), (here, file["bytes"]), 0.0)
    return None


def smallest(rows: Sequence[Row], goal: float) -> Row | None:
    """The smallest file with a mean of at least `goal` dB; None if there is none."""
    return min((row for row in rows if row["psnr_db"] >= goal), key=lambda row: int(row["bytes"]), default=None)
