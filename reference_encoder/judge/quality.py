"""How good pictures are, by the kind of place they are seen from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from reference_encoder.tuning import MOST_ABOVE_DB, MOST_DB
from scarfmt.arrays import F64

LOW_PERCENT = 5.0
"""Percentile that stands for views that come out badly."""


def most_db(asked_db: float) -> float:
    """What one picture counts for at most where so much was asked for.

    Where next to nothing differs, more is no merit; and one picture without any error would make a mean infinite.
    """
    return max(MOST_DB, asked_db + MOST_ABOVE_DB)


@dataclass(frozen=True)
class Quality:
    """PSNR of pictures of a result against pictures of the source, from views of several kinds.

    Attributes:
        kinds: of each of n views, what it is one of.
        psnr_db: (n,) float64, each at most :func:`most_db`.
    """

    kinds: tuple[str, ...]
    psnr_db: F64

    @property
    def mean_db(self) -> float:
        """Of all views; infinite where there is none."""
        return float(self.psnr_db.mean()) if len(self.psnr_db) else math.inf

    @property
    def low_db(self) -> float:
        """5th percentile of all views."""
        return float(np.percentile(self.psnr_db, LOW_PERCENT)) if len(self.psnr_db) else math.inf

    @property
    def worst_db(self) -> float:
        """Of all views."""
        return float(self.psnr_db.min(initial=math.inf))

    def by_kind(self) -> dict[str, Quality]:
        """The same of each kind, in the order of the views."""
        return {kind: self._of(kind) for kind in dict.fromkeys(self.kinds)}

    def _of(self, kind: str) -> Quality:
        here = np.array([each == kind for each in self.kinds])
        return Quality((kind,) * int(here.sum()), self.psnr_db[here])

    def figures(self) -> dict[str, Any]:
        """JSON-able: number of views; mean, 5th percentile and worst in dB, two decimals; the same of each kind."""
        every = self._figures()
        return {**every, "kinds": {kind: quality._figures() for kind, quality in self.by_kind().items()}}

    def _figures(self) -> dict[str, Any]:
        count = len(self.psnr_db)
        if not count:
            return {"views": 0}
        said = {"mean_db": self.mean_db, "p5_db": self.low_db, "worst_db": self.worst_db}
        return {"views": count, **{name: round(value, 2) for name, value in said.items()}}
