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
from functools import partial
from typing import TypeVar

from reference_encoder.tuning import (
    BELOW_WEIGHT,
    GREATEST_SLOPE,
    LEAST_SLOPE,
    MOST_DOWN_DB,
    MOST_UP_DB,
    PROMISED_DB,
    TOLERANCE_DB,
)

T = TypeVar("T")


@dataclass
class Search:
    """The search for the quality to predict for, so that pictures have what was asked.

    A search outlives the stages of encoding: what is decided after a correction moves pictures a little, and the next
    stage goes on from there.

    Attributes:
        asked: dB.
        left: corrections that may still be made.
        start: what is predicted for first, dB.
        aim: what is predicted for now, dB.
    """

    asked: float
    left: int
    start: float
    aim: float = field(init=False)

    def __post_init__(self) -> None:
        self.aim = self.start

    def settled(
        self,
        made: T,
        make: Callable[[float], T],
        judged: Callable[[T], float],
        spare: int = 0,
        tolerance: float = TOLERANCE_DB,
    ) -> T:
        """The attempt that misses the target by least, among `made` and its corrections. All are judged.

        Args:
            made: for the present aim.
            make: aim, dB -> result.
            judged: result -> dB found.
            spare: corrections to leave to later stages.
            tolerance: close enough, dB.
        """
        if self.left <= spare:
            return made
        missed = partial(missed_db, self.asked, tolerance)
        tried: list[tuple[float, float]] = [(self.aim, judged(made))]
        closest, aim = made, self.aim
        while self.left > spare:
            better = next_aim(self.asked, tried, self.start, tolerance)
            if better is None:
                break
            self.left -= 1
            made = make(better)
            tried.append((better, judged(made)))
            if missed(tried[-1][1]) <= min(missed(found) for _, found in tried):
                closest, aim = made, better
        self.aim = aim
        return closest


def missed_db(asked: float, tolerance: float, found: float) -> float:
    """By how much pictures miss what was asked, dB; what is a little beyond it counts less, but more than `tolerance`.

    Where what is found jumps over what was asked, as codebooks and steps do, the file on the good side is wanted.
    """
    beyond = found - asked
    return max(tolerance, beyond / BELOW_WEIGHT) if tolerance < beyond <= PROMISED_DB else abs(beyond)


def next_aim(
    asked: float, tried: Sequence[tuple[float, float]], start: float, tolerance: float = TOLERANCE_DB
) -> float | None:
    """The quality to predict for next, so that pictures have `asked` dB; None when the last try was close enough.

    What pictures have does not rise evenly with what is aimed at: thresholds and codebooks change with lambda. So the
    line goes between tries on both sides of what is asked, or as far as tries reach.

    Args:
        asked: dB.
        tried: (aimed at, found) so far, dB.
        start: the first aim, dB: no other is far from it.
        tolerance: close enough, dB.
    """
    aim, found = tried[-1]
    if not math.isfinite(found) or abs(asked - found) <= tolerance:
        return None
    below = max((pair for pair in tried if pair[1] < asked), key=lambda pair: pair[1], default=None)
    above = min((pair for pair in tried if pair[1] > asked), key=lambda pair: pair[1], default=None)
    if below is not None and above is not None and below[0] < above[0]:
        return below[0] + (above[0] - below[0]) * (asked - below[1]) / (above[1] - below[1])
    slope = 1.0
    if len(tried) > 1 and aim != tried[0][0]:
        slope = (found - tried[0][1]) / (aim - tried[0][0])
    slope = min(max(slope, LEAST_SLOPE), GREATEST_SLOPE)
    return min(max(aim + (asked - found) / slope, start - MOST_DOWN_DB), start + MOST_UP_DB)
