"""The problem of deciding about a scene at one lambda. Each profile states it; both profiles share the stages after
it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from reference_encoder.decide.lattice import Placement
from reference_encoder.latent.fit import FittedLatent
from reference_encoder.tuning import NEIGHBOURS
from scarfmt.arrays import F64, I64
from scarfmt.container.morton import MAX_BITS, interleave
from scarfmt.container.schema import Profile, Stream


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """The places of the N anchors, and the header fields about them.

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
        standing: (N,) 0 to below 1; where a part of a class is shown, it is the anchors below that part.
        presence_bits: lambda -> (count,) bits that being there costs a class.
    """

    of: I64
    count: int
    importance: F64
    standing: F64
    presence_bits: Callable[[float], F64]

    def split(self, parts: Sequence[float]) -> Classes:
        """Classes numbered so that the given parts of the first ones are classes of their own and come first.

        Args:
            parts: of the first classes, above 0 to 1; the rest of a class shown in part comes after all of them.
        """
        shown, cut = len(parts), [klass for klass, part in enumerate(parts) if part < 1]
        part_of = np.concatenate([parts, np.ones(self.count - shown)])
        number = np.concatenate([np.arange(shown), shown + len(cut) + np.arange(self.count - shown)])
        later = number.copy()
        later[cut] = shown + np.arange(len(cut))
        of = np.where(self.standing < part_of[self.of], number[self.of], later[self.of])

        def presence(lambda_: float) -> F64:
            bits, split = self.presence_bits(lambda_), np.zeros(self.count + len(cut))
            split[later] = (1 - part_of) * bits
            split[number] = part_of * bits
            return split

        return replace(self, of=of, count=self.count + len(cut), presence_bits=presence)

    def shown(self, parts: Sequence[float]) -> NDArray[np.bool_]:
        """(N,) whether an anchor is among the given parts of the first classes."""
        return self.standing < np.concatenate([parts, np.zeros(self.count - len(parts))])[self.of]


def standing(positions: F64, classes: I64, extent: F64, box: tuple[F64, F64] | None = None) -> F64:
    """(N,) rank, 0 to below 1, of each anchor among its :data:`NEIGHBOURS` of the same class: who covers most is first.

    So any part of a class is spread evenly over the scene, and those that are shown hide that others are not.

    Args:
        positions: (N, 3).
        classes: (N,).
        extent: (N,) how much an anchor covers, in any unit.
        box: two corners, (3,) each, of where neighbours are told apart; None for where nearly all of these are.
    """
    low, high = np.percentile(positions, (1, 99), axis=0) if box is None else box
    cells = np.clip((positions - low) / np.maximum(high - low, 1e-300), 0, 1) * ((1 << MAX_BITS) - 1)
    order = np.lexsort((interleave(cells), classes))
    sizes = np.bincount(classes)
    within = np.arange(len(order)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    runs = np.zeros(len(order), np.int64)
    runs[order] = within // NEIGHBOURS
    ranked = np.lexsort((-extent, runs, classes))
    rank = np.zeros(len(order))
    rank[ranked] = (within % NEIGHBOURS) / NEIGHBOURS
    return rank


@dataclass(frozen=True, kw_only=True)
class Budget:
    """The worth of bits.

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
        geometry, channels, classes, budget: as their names say; what presence costs and what is lost is of all
            anchors that these stand for.
        fitted: latent and codewords, or None.
        repeat: how many anchors each stands for.
    """

    geometry: Geometry
    channels: Channels
    classes: Classes
    fitted: FittedLatent | None
    budget: Budget
    repeat: float = 1.0

    def split(self, parts: Sequence[float]) -> Problem:
        """The problem with the given parts of the first classes as classes of their own, before the rest of those."""
        return replace(self, classes=self.classes.split(parts))
