"""What there is to decide about a scene at one lambda: what a profile hands to the stages that both profiles share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from reference_encoder.decide.lattice import Placement
from reference_encoder.latent.fit import FittedLatent
from scarfmt.arrays import F64, I64
from scarfmt.container.schema import Profile, Stream


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """Where the N anchors lie, and what the header says of them.

    Attributes:
        profile, slots, sh_degree: of the file.
        source_count: Gaussians or anchors of the source, those that were dropped included.
        positions: (N, 3) float64 true positions.
        placement: their cells and tiles.
    """

    profile: Profile
    slots: int
    sh_degree: int
    source_count: int
    positions: F64
    placement: Placement


@dataclass(frozen=True, kw_only=True)
class Channels:
    """Attributes and what errors in them show.

    Attributes:
        values: (N, components) float64 per channel, in coding order, units of SPEC §9.
        weights: (N, components) float64 squared picture error per squared unit.
        coarsest: coarsest useful first step per channel.
    """

    values: Mapping[Stream, F64]
    weights: Mapping[Stream, F64]
    coarsest: Mapping[Stream, tuple[float, ...]]


@dataclass(frozen=True, kw_only=True)
class Classes:
    """Anchors of like importance.

    Attributes:
        of: (N,) class of each anchor, 0 the most important.
        count: how many classes.
        importance: (N,) squared picture error of leaving an anchor out.
        presence_bits: lambda -> (count,) bits that being there costs a class.
    """

    of: I64
    count: int
    importance: F64
    presence_bits: Callable[[float], F64]

    def split(self, klass: int, part: float) -> Classes:
        """Classes with `klass` made two: the most important `part` of its anchors, and the others."""
        late = (self.of > klass) | ((self.of == klass) & ~self.leading(klass, part))

        def presence(lambda_: float) -> F64:
            bits = self.presence_bits(lambda_)
            parts = np.insert(bits, klass + 1, (1 - part) * bits[klass])
            parts[klass] = part * bits[klass]
            return parts

        return replace(self, of=self.of + late, count=self.count + 1, presence_bits=presence)

    def leading(self, klass: int, part: float) -> NDArray[np.bool_]:
        """(N,) whether an anchor is among the most important `part` of `klass`; of equals, the first are."""
        members = np.flatnonzero(self.of == klass)
        ranked = members[np.argsort(-self.importance[members], kind="stable")]
        found = np.zeros(len(self.of), bool)
        found[ranked[: max(1, round(part * len(ranked)))]] = True
        return found


@dataclass(frozen=True, kw_only=True)
class Budget:
    """What bits are worth.

    Attributes:
        lambda_: of the last layer, squared picture error per bit.
        lost: squared picture error of what was dropped for good.
        base_share: share of the bits that the first layer takes.
    """

    lambda_: float
    lost: float
    base_share: float


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A scene without what is not worth sending, its latent fitted, nothing else decided.

    Attributes:
        geometry, channels, classes, budget: as their names say.
        fitted: latent and codewords, or None.
    """

    geometry: Geometry
    channels: Channels
    classes: Classes
    fitted: FittedLatent | None
    budget: Budget

    def split(self, klass: int, part: float) -> Problem:
        """The problem with class `klass` made two: the most important `part` of its anchors, and the others."""
        return replace(self, classes=self.classes.split(klass, part))
