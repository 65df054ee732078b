"""Bytes at equal quality: what a `.scar` file needs to be as good as a rival's, in its mean and in its worst view.

A `.scar` file is as good as a rival's if the mean, the 5th percentile and the worst of its views are at least the
rival's. Files of one scene, encoded for several qualities, tell how many bytes that takes: bytes are interpolated,
their logarithm linearly, between the largest file that is not as good and the smallest larger one that is, at the
point where what lacks most is made up for. Nothing is extrapolated: where no file is as good, the answer is None, and
where all are, it is the smallest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

Row = dict[str, Any]

LEVELS = ("psnr_db", "p5_psnr_db", "worst_psnr_db")
LOSSLESS_DB = 90.0
"""Files with this mean and more are as good as lossless: no rivals of lossy ones."""
AIMS = (0.6, 0.6, 0.5, 0.5)
"""Target of this project by degree of spherical harmonics: bytes at equal quality, relative to a rival's."""


def lead(ours: Row, theirs: Row, levels: Sequence[str] = LEVELS) -> float:
    """How much better `ours` is where it is least so: dB, negative where it lacks something."""
    return min(float(ours[level]) - float(theirs[level]) for level in levels)


def equal_bytes(files: Sequence[Row], rival: Row, levels: Sequence[str] = LEVELS) -> float | None:
    """Bytes of a file as good as `rival`, from some of one scene with ``bytes`` and `levels`; None if none is."""
    last: Row | None = None
    for file in sorted(files, key=lambda file: int(file["bytes"])):
        here = lead(file, rival, levels)
        if here < 0:
            last = file
        elif last is None:
            return float(file["bytes"])
        else:
            before = lead(last, rival, levels)
            part = before / (before - here)
            return math.exp(math.log(last["bytes"]) * (1 - part) + math.log(file["bytes"]) * part)
    return None


def smallest(rivals: Sequence[Row], goal: float) -> Row | None:
    """The smallest rival's file with a mean of at least `goal` dB; None if there is none."""
    return min((r for r in rivals if r["psnr_db"] >= goal), key=lambda r: int(r["bytes"]), default=None)


def best(rivals: Sequence[Row], goal: float) -> list[Row]:
    """From `goal` dB, the lossy files that no other beats in size and in all of :data:`LEVELS`; the smallest first."""
    good = [r for r in rivals if goal <= r["psnr_db"] < LOSSLESS_DB]
    return sorted((r for r in good if not any(_beats(other, r) for other in good)), key=lambda r: int(r["bytes"]))


def _beats(a: Row, b: Row) -> bool:
    return a is not b and a["bytes"] <= b["bytes"] and lead(a, b) >= 0 and (a["bytes"] < b["bytes"] or lead(b, a) < 0)
