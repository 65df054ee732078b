"""Reaching the target quality: pictures of the result show how far off the prediction was (encoder only).

The model of errors (docs/decisions/0003) is fitted to scenes that fill the picture. A scene on a black background, or
one with fewer overlaps, comes out several dB better than asked, in more bytes. So lambda is corrected by what pictures
of the result show, until they are close enough or the effort is spent (docs/decisions/0017-quality-loop.md,
0025-quality-everywhere.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.tuning import (
    BELOW_WEIGHT,
    GREATEST_SLOPE,
    LEAST_SLOPE,
    MOST_DOWN_DB,
    MOST_UP_DB,
    PROMISED_DB,
    TOLERANCE_DB,
    WORST_BELOW_DB,
)

T = TypeVar("T")


@dataclass
class RateControl:
    """The search for the quality to predict for, so that pictures have what was asked.

    It outlives the stages of encoding: layers chosen from pictures move the quality a little, and the search goes on
    from there.

    Attributes:
        asked: dB.
        left: corrections that may still be made.
        start: what is predicted for first, dB.
        target: what is predicted for now, dB.
    """

    asked: float
    left: int
    start: float
    target: float = field(init=False)

    def __post_init__(self) -> None:
        self.target = self.start

    @classmethod
    def for_options(cls, options: EncodeOptions) -> RateControl:
        """With as many corrections as asked for, or as the effort has."""
        left = EFFORTS[options.effort].corrections if options.corrections is None else options.corrections
        start = options.quality if options.worst is None else options.worst + WORST_BELOW_DB
        return cls(options.asked_db, left, start)

    def converge(
        self, trial: T, make: Callable[[float], T], measure: Callable[[T], float], reserve: int = 0
    ) -> T:
        """The trial that misses the target by least, among `trial` and its corrections. All are measured.

        Args:
            trial: for the present target.
            make: target, dB -> trial.
            measure: trial -> dB of its pictures.
            reserve: corrections to leave to later stages.
        """
        if self.left <= reserve:
            return trial
        tried: list[tuple[float, float]] = [(self.target, measure(trial))]
        closest, target = trial, self.target
        while self.left > reserve:
            better = next_target(self.asked, tried, self.start)
            if better is None:
                break
            self.left -= 1
            trial = make(better)
            tried.append((better, measure(trial)))
            if missed_db(self.asked, tried[-1][1]) <= min(missed_db(self.asked, found) for _, found in tried):
                closest, target = trial, better
        self.target = target
        return closest


def missed_db(asked: float, found: float) -> float:
    """By how much pictures miss what was asked, dB; a little beyond counts less, but more than the tolerance.

    Where what is found jumps over what was asked, as steps do, the file on the good side is wanted.
    """
    beyond = found - asked
    return max(TOLERANCE_DB, beyond / BELOW_WEIGHT) if TOLERANCE_DB < beyond <= PROMISED_DB else abs(beyond)


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
    slope = 1.0
    if len(tried) > 1 and target != tried[0][0]:
        slope = (found - tried[0][1]) / (target - tried[0][0])
    slope = min(max(slope, LEAST_SLOPE), GREATEST_SLOPE)
    return min(max(target + (asked - found) / slope, start - MOST_DOWN_DB), start + MOST_UP_DB)
