"""Reaching the target quality: pictures of the result show how far off the prediction was (encoder only).

The model of errors (docs/decisions/0003) is fitted to scenes that fill the picture. A scene on a black background, or
one with fewer overlaps, comes out several dB better than asked, in more bytes. So lambda is corrected by what pictures
of the result show. After a small step nobody looks again: what it does is known better than the views tell
(docs/decisions/0025-quality-everywhere.md, 0057-encode-in-seconds.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.tuning import (
    FIRST_SLOPE,
    GREATEST_SLOPE,
    LEAST_SLOPE,
    MOST_DOWN_DB,
    MOST_UP_DB,
    SURE_DB,
    TOLERANCE_DB,
    WORST_BELOW_DB,
)

T = TypeVar("T")


def converge(options: EncodeOptions, make: Callable[[float], T], measure: Callable[[T], float]) -> T:
    """The first trial that is close enough to what is asked, or that is a small step from one that was looked at.

    Where none is, the closest of those looked at.

    Args:
        options: what is asked; as many corrections as asked for, or as the effort has.
        make: quality to predict for, dB -> trial.
        measure: trial -> dB of its pictures.
    """
    corrections = EFFORTS[options.effort].corrections if options.corrections is None else options.corrections
    # A percentile jumps: every step is looked at.
    asked, start, sure = options.asked_db, options.quality, SURE_DB
    if options.worst is not None:
        start, sure = options.worst + WORST_BELOW_DB, 0.0
    trial = make(start)
    if not corrections:
        return trial
    tried = [(start, measure(trial))]
    for _ in range(corrections):
        target = next_target(asked, tried, start)
        if target is None:
            break
        if abs(asked - tried[-1][1]) <= sure:
            del trial  # as large as the scene, and not needed any more
            return make(target)
        other = make(target)
        tried.append((target, measure(other)))
        if np.argmin([abs(found - asked) for _, found in tried]) == len(tried) - 1:
            trial = other
    return trial


def next_target(asked: float, tried: Sequence[tuple[float, float]], start: float) -> float | None:
    """The quality to predict for next, so that pictures have `asked` dB; None when the last try was close enough.

    What pictures have does not rise evenly with the target: thresholds change with lambda. So the line goes between
    tries on both sides of what is asked, or as far as tries reach.

    Args:
        asked: dB.
        tried: (target, found) so far, dB.
        start: the first target, dB: no other is far from it.
    """
    target, found = tried[-1]
    if not math.isfinite(found) or abs(asked - found) <= TOLERANCE_DB:
        return None
    below = max((pair for pair in tried if pair[1] < asked), key=lambda pair: pair[1], default=None)
    above = min((pair for pair in tried if pair[1] > asked), key=lambda pair: pair[1], default=None)
    if below is not None and above is not None and below[0] < above[0]:
        return below[0] + (above[0] - below[0]) * (asked - below[1]) / (above[1] - below[1])
    slope = FIRST_SLOPE
    if len(tried) > 1 and target != tried[0][0]:
        slope = (found - tried[0][1]) / (target - tried[0][0])
    slope = min(max(slope, LEAST_SLOPE), GREATEST_SLOPE)
    return min(max(target + (asked - found) / slope, start - MOST_DOWN_DB), start + MOST_UP_DB)
