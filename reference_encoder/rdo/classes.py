"""Classes of anchors of like importance: an anchor's class says what it receives in each layer (SPEC §6.5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.tuning import IMPORTANCE_RATIO, NEIGHBOURS
from scarfmt.arrays import F64, I64
from scarfmt.container.morton import MAX_BITS, interleave
from scarfmt.scene.model import MAX_CLASSES


def classify(importance: F64, lambda_: float, bits: float, limit: int) -> tuple[I64, int]:
    """Class 0.. of each anchor, most important first, and how many there are; -1 for anchors not worth sending.

    Args:
        importance: (N,) squared picture error of leaving the anchor out.
        lambda_: of the last layer, squared picture error per bit.
        bits: what the cheapest anchor costs.
        limit: most classes.
    """
    bounds = find_class_bounds(importance, lambda_, bits, limit)
    return bounds.classify(importance), bounds.count


def find_class_bounds(importance: F64, lambda_: float, bits: float, limit: int) -> ClassBounds:
    """The bounds between classes of anchors. For the arguments see :func:`classify`."""
    least = lambda_ * bits
    sent = importance > least
    if not sent.any():
        least = float(np.nextafter(importance.max(), -np.inf))
        sent = importance > least
    bounds = ClassBounds(least, float(importance[sent].min()), 1, (0,))
    count = int(min(limit, MAX_CLASSES, np.floor(bounds.ranks(importance[sent]).max()) + 1))
    bounds = replace(bounds, ranked=count, used=tuple(range(count)))
    # Empty classes would waste rows of the layer table.
    return replace(bounds, used=tuple(np.unique(bounds.classify(importance[sent])).tolist()))


@dataclass(frozen=True)
class ClassBounds:
    """The bounds between classes of anchors.

    Attributes:
        least: an anchor of at most so much importance is not worth sending.
        floor: importance where the least important class begins; what is below, but worth sending, is in it.
        ranked: classes by rank, `IMPORTANCE_RATIO` apart.
        used: those that there are, ascending; of any other, anchors are in the next.
    """

    least: float
    floor: float
    ranked: int
    used: tuple[int, ...]

    @property
    def count(self) -> int:
        """Classes that there are."""
        return len(self.used)

    def ranks(self, importance: F64) -> F64:
        """(n,) how far above the floor anchors are, in classes."""
        rank = np.zeros(len(importance))
        positive = importance > 0
        rank[positive] = np.log(importance[positive] / max(self.floor, 1e-300)) / np.log(IMPORTANCE_RATIO)
        return rank

    def classify(self, importance: F64) -> I64:
        """(n,) class of each anchor, 0 the most important; -1 for those not worth sending."""
        whole = np.clip(np.floor(self.ranks(importance)), 0, self.ranked - 1).astype(np.int64)
        classes = np.minimum(np.searchsorted(self.used, self.ranked - 1 - whole), self.count - 1)
        return np.where(importance > self.least, classes, -1)


def rank_with_colour(absence: F64, colour: F64, share: float, least: float, shift: float | None = None) -> F64:
    """(N,) importance that ranks anchors by what errors of their colour show as well as by what their absence does.

    A class has one step for all its colours, so that what it gains depends on how alike their weights are; where most
    bits are colour, as with view-dependent colour, that counts more than how alike the weights of shapes are.

    Args:
        absence: (N,) squared picture error of leaving the anchor out.
        colour: (N,) squared picture error per squared unit of colour.
        share: of the colour in the logarithm: 0 ranks by absence alone.
        least: of absence; below, an anchor is not worth sending and stays so, above, it stays worth it.
        shift: :func:`measure_colour_shift` of all anchors; None where these are all.
    """
    sent = absence > least
    if share == 0 or not sent.any():
        return absence
    logs, tints = np.log(absence[sent]), np.log(np.maximum(colour[sent], 1e-300))
    ranked = absence.copy()
    shift = measure_colour_shift(absence, colour, least) if shift is None else shift
    ranked[sent] = np.exp((1 - share) * logs + share * (tints + shift))
    ranked[sent] = np.maximum(ranked[sent], np.nextafter(least, np.inf))
    return ranked


def measure_colour_shift(absence: F64, colour: F64, least: float) -> float:
    """How far above the logarithm of its colour's weight that of an anchor's absence is, on average; 0 of none."""
    sent = absence > least
    if not sent.any():
        return 0.0
    return float(np.log(absence[sent]).mean() - np.log(np.maximum(colour[sent], 1e-300)).mean())


@dataclass(frozen=True, kw_only=True)
class Classes:
    """Anchors of like importance.

    Attributes:
        of: (N,) class of each anchor, 0 the most important.
        count: how many classes.
        importance: (N,) squared picture error of leaving an anchor out.
        coverage_rank: (N,) 0 to below 1; where a part of a class is shown, it is the anchors below that part. None
            where classes are shown whole or not at all.
        presence_bits: lambda -> (count,) bits that being there costs a class.
    """

    of: I64
    count: int
    importance: F64
    coverage_rank: F64 | None
    presence_bits: Callable[[float], F64]

    def split(self, parts: Sequence[float]) -> Classes:
        """Classes numbered so that the given parts of the first ones are classes of their own and come first.

        Args:
            parts: of the first classes, above 0 to 1; the rest of a class shown in part comes after all of them.
        """
        assert self.coverage_rank is not None
        whole, share, number, later = split_numbers(self.count, parts)
        part_of = np.concatenate([parts, np.ones(self.count - len(parts))])
        of = np.where(self.coverage_rank < part_of[self.of], number[self.of], later[self.of])
        bits = self.presence_bits
        return replace(self, of=of, count=len(whole), presence_bits=lambda lambda_: share * bits(lambda_)[whole])


def split_numbers(count: int, parts: Sequence[float]) -> tuple[I64, F64, I64, I64]:
    """The classes that there are once the given parts of the first ones are classes of their own and come first.

    Args:
        count: classes before.
        parts: of the first classes, above 0 to 1; the rest of a class shown in part comes after all of them.

    Returns:
        Of each class then, (m,) the class that it is of and the share of that which it has; of each class before,
        (count,) the class that its part is then, and the class that its rest is.
    """
    shown, cut = len(parts), [klass for klass, part in enumerate(parts) if part < 1]
    number = np.concatenate([np.arange(shown), shown + len(cut) + np.arange(count - shown)])
    later = number.copy()
    later[cut] = shown + np.arange(len(cut))
    whole, share = np.zeros(count + len(cut), np.int64), np.ones(count + len(cut))
    whole[later] = np.arange(count)
    whole[number] = np.arange(count)
    share[later[cut]] = 1 - np.array(parts)[cut]
    share[number[cut]] = np.array(parts)[cut]
    return whole, share, number, later


def rank_by_coverage(positions: F64, classes: I64, extent: F64, box: tuple[F64, F64] | None = None) -> F64:
    """(N,) rank, 0 to below 1, of each anchor among its :data:`NEIGHBOURS` of the same class: who covers most is first.

    So any part of a class is spread evenly over the scene, and those that are shown hide that others are not.

    Args:
        positions: (N, 3).
        classes: (N,).
        extent: (N,) how much an anchor covers, in any unit.
        box: two corners, (3,) each, in which neighbours are found; None for where nearly all of these are.
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
