"""Judging one try after another: the later ones by what they change in some of the pictures (encoder only).

From view to view PSNR differs by 5 to 10 dB, but what a change of lambda does to it differs by tenths: differences in
half of the views tell as much as all of them (docs/decisions/0031-encoder-time.md).
"""

from __future__ import annotations

from typing import Generic, TypeVar

from reference_encoder.judge.judge import Judge
from reference_encoder.judge.quality import Quality
from reference_encoder.tuning import FEWEST_COMPARED, MOST_MOVED_DB, VIEWS_A_COMPARED

S = TypeVar("S")


def compared(views: int) -> slice:
    """The views of a kind, of `count`, that show what a later attempt changes."""
    return slice(None, None, max(1, min(VIEWS_A_COMPARED, views // FEWEST_COMPARED)))


class Tries(Generic[S]):
    """Tries at one scene, of which the first is judged by all views.

    Attributes:
        judge: all views.
        by_mean: whether a mean was asked for, not a floor, which no difference tells.
    """

    def __init__(self, judge: Judge[S], by_mean: bool) -> None:
        self.judge, self.by_mean = judge, by_mean
        self._few = judge.thinned(compared)
        self._whole: Quality | None = None

    def found_db(self, scene: S) -> float:
        """The PSNR of an attempt, mean or low end, which is compared with the target, dB."""
        if self.by_mean and self._whole is not None and len(self._whole):
            moved = self._few.quality(scene).mean_db - self._whole.thinned(compared).mean_db
            if abs(moved) <= MOST_MOVED_DB:
                return self._whole.mean_db + moved
        self._whole = self.judge.quality(scene)
        return self._whole.mean_db if self.by_mean else self._whole.low_db
