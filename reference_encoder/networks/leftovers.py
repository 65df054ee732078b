"""The cost of leaving a part of a latent to the refinements after the codewords (encoder side).

In a class without steps of the LATENT channel the rest stays: its squared error is the cost. With them, most of the
rest is repaired, and costs the bits of its repair: about the logarithm of what its square would cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from reference_encoder.decide.targets import Targets, joined_classes, latent_units
from reference_encoder.tuning import PREVIEW
from scarfmt.arrays import F32, F64, I64
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Stream


@dataclass(frozen=True)
class Repair:
    """The effect of the LATENT channel on the rests of a class.

    Attributes:
        unit: (d,) float32 lattice units of a step of its last value.
        low: (d,) int64 smallest value of the table.
        bits: (d, span) float32 bits of each value.
    """

    unit: torch.Tensor
    low: torch.Tensor
    bits: torch.Tensor

    @classmethod
    def of(cls, values: I64, unit: F64) -> Repair:
        """From (n, d) values of the class's anchors now."""
        low = values.min(axis=0) - 1
        span = int((values - low).max()) + 2
        # Values nobody has are dear, not impossible; those beyond the table are as dear as its ends.
        counts = np.stack([np.bincount(column, minlength=span) for column in (values - low).T])
        bits = np.log2((len(values) + 1) / (counts + 0.25))
        return cls(torch.from_numpy(unit.astype(np.float32)), torch.from_numpy(low), torch.from_numpy(bits).float())

    def costs(self, left: torch.Tensor, worth: torch.Tensor) -> torch.Tensor:
        """(m, d) bits of value and remaining error for (m, d) rests; `worth` (m,) as in `Leftovers.costs`."""
        nearest = torch.round(left / self.unit)
        place = (nearest.long() - self.low).clamp_(0, self.bits.shape[1] - 1)
        bits = torch.gather(self.bits, 1, place.T).T
        return bits + worth[:, None] * (left - nearest * self.unit) ** 2


@dataclass(frozen=True)
class Leftovers:
    """Cost of a class's rests, in bits.

    Attributes:
        slope: (d,) float32 cost of a dimension's squared error, 1 where it stays as it is. This quadratic form is for
            searching; `costs` are for deciding.
        repair: None where rests stay.
    """

    slope: torch.Tensor
    repair: Repair | None = None

    @classmethod
    def of(cls, left: F64, worth: F32, repair: Repair) -> Leftovers:
        """The leftovers of a class with (n, d) rests `left` that are repaired; `worth` is (n,) as in `costs`."""
        rests, weight = torch.from_numpy(left.astype(np.float32)), torch.from_numpy(worth.astype(np.float32))
        none = repair.costs(torch.zeros_like(rests), weight).mean(0)
        slope = (repair.costs(rests, weight).mean(0) - none) / (weight[:, None] * rests**2).mean(0).clamp_min(1e-20)
        return cls(slope.clamp(0.0, 1.0) + PREVIEW, repair)

    def costs(self, left: torch.Tensor, worth: torch.Tensor) -> torch.Tensor:
        """(m,) bits that (m, d) rests cost, given (m,) bits that a squared lattice unit of error is worth."""
        if self.repair is None:
            return worth * (left * left).sum(1)
        return self.repair.costs(left, worth).sum(1) + PREVIEW * worth * (left * left).sum(1)


def leftovers(scene: QuantisedScene, targets: Targets) -> list[Leftovers]:
    """The leftovers of every class of a scene, computed from the rests of its present codewords."""
    classes, left = joined_classes(scene), targets.left(scene)
    units, index = latent_units(scene.model, classes), scene.model.channel_index(Stream.LATENT)
    out = []
    for klass in range(scene.model.layers[-1].class_count):
        here = np.flatnonzero(classes == klass)
        if units is None or index is None or not len(here) or units[here[0], 0] == 0:
            out.append(Leftovers(torch.ones(left.shape[1])))
            continue
        values = np.concatenate([content.values[index][content.classes == klass] for content in scene.contents])
        repair = Repair.of(values.astype(np.int64), units[here[0]])
        out.append(Leftovers.of(left[here], targets.weight[here] / targets.lambda_, repair))
    return out
