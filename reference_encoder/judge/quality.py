"""How good pictures are, by the kind of place they are seen from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from reference_encoder.tuning import KIND_BELOW_DB, LOW_BELOW_DB, MOST_ABOVE_DB, MOST_DB
from scarfmt.arrays import F64

LOW_PART = 0.05
"""Share of the views that come out worst; the best of these is the 5th percentile."""


def most_db(asked_db: float) -> float:
    """Maximum PSNR that one picture counts for, dB, at this target.

    Where next to nothing differs, more is no merit; and one picture without any error would make a mean infinite.
    """
    return max(MOST_DB, asked_db + MOST_ABOVE_DB)


@dataclass(frozen=True)
class Quality:
    """PSNR of pictures of a result against pictures of the source, from views of several kinds.

    Attributes:
        psnr_db: kind -> (n,) float64 of its views, each at most :func:`most_db`; kinds that show nothing are left out.
        shares: how much each kind counts, of whatever sum.
    """

    psnr_db: Mapping[str, F64]
    shares: Mapping[str, float]

    def __len__(self) -> int:
        """Views of all kinds."""
        return sum(map(len, self.psnr_db.values()))

    @property
    def mean_db(self) -> float:
        """Over all views, kinds by their shares; infinite where there is none."""
        weights, values = self._weighted()
        return float(weights @ values) if len(values) else math.inf

    @property
    def low_db(self) -> float:
        """5th percentile of all views, kinds by their shares; infinite where there is none."""
        weights, values = self._weighted()
        if not len(values):
            return math.inf
        order = np.argsort(values)
        reached = np.cumsum(weights[order]) >= LOW_PART - 1e-9
        return float(values[order][int(np.argmax(reached))])

    @property
    def worst_db(self) -> float:
        """PSNR of the worst of all views, dB; infinite if there is no view."""
        return float(self._weighted()[1].min(initial=math.inf))

    def thinned(self, some: Callable[[int], slice]) -> Quality:
        """The quality of `some` of the views of each kind."""
        return Quality({kind: found[some(len(found))] for kind, found in self.psnr_db.items()}, self.shares)

    def by_kind(self) -> dict[str, Quality]:
        """The quality of the views of each kind."""
        return {kind: Quality({kind: values}, {kind: 1.0}) for kind, values in self.psnr_db.items()}

    def shortfalls(self, asked_db: float) -> list[str]:
        """The figures that are far below the target, in one sentence each."""
        said = [
            f"{kind} is {asked_db - found.mean_db:.1f} dB below what was asked for"
            for kind, found in self.by_kind().items()
            if found.mean_db < asked_db - KIND_BELOW_DB
        ]
        if self.low_db < asked_db - LOW_BELOW_DB:
            below = f"{asked_db - self.low_db:.1f} dB below what was asked for"
            said.append(f"one view in twenty is {below} or worse; --worst asks for a floor")
        return said

    def figures(self) -> dict[str, Any]:
        """JSON-able: number of views; mean, 5th percentile and worst in dB, two decimals; the same of each kind."""
        return {**self._figures(), "kinds": {kind: found._figures() for kind, found in self.by_kind().items()}}

    def _figures(self) -> dict[str, Any]:
        if not len(self):
            return {"views": 0}
        said = {"mean_db": self.mean_db, "p5_db": self.low_db, "worst_db": self.worst_db}
        return {"views": len(self), **{name: round(value, 2) for name, value in said.items()}}

    def _weighted(self) -> tuple[F64, F64]:
        """(n,) weights that add up to 1, and (n,) dB, of all views."""
        kinds = list(self.psnr_db)
        values = [self.psnr_db[kind] for kind in kinds]
        weights = [np.full(len(self.psnr_db[kind]), self.shares[kind] / len(self.psnr_db[kind])) for kind in kinds]
        joined = np.concatenate([np.zeros(0), *weights])
        return joined / max(float(joined.sum()), 1e-300), np.concatenate([np.zeros(0), *values])
