"""Rate-distortion allocation: classes of like importance, and what each receives in each layer.

Every increment a file can send, one more ternary step of one channel, one more RVQ stage, or the class
itself, has a price in bits and a gain in squared picture error, both measured on the data. For a given
lambda (error per bit) the best choice of each is independent; a falling lambda gives the layers. Increments
are taken along the lower convex hull, so that a smaller lambda never takes anything back (SPEC §6.5).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numba import get_num_threads

from reference_encoder.jit import compiled
from reference_encoder.tuning import (
    COARSEST_COLOUR,
    FINEST_STEP,
    IMPORTANCE_RATIO,
    PLANNED_ANCHORS,
    STAGGER,
    TABLE_ENTRY_BITS,
)
from scarfmt.arrays import F64, I64
from scarfmt.container.schema import Stream
from scarfmt.scene.model import MAX_CLASSES, MAX_STEPS

PositionBits = Callable[[float], F64]

_LOGARITHMS = (Stream.SCALE, Stream.OPACITY)
_MOST_BINS = 1 << 20
"""Histograms with more possible entries are made by sorting."""


@dataclass(frozen=True)
class ChannelPlan:
    """One channel's cost tables, per class.

    Attributes:
        stream: which.
        step: first-cell width per component.
        bits: (classes, steps + 1) cumulative bits of the class's anchors with 0.. steps.
        error: (classes, steps + 1) squared picture error left.
    """

    stream: Stream
    step: tuple[float, ...]
    bits: F64
    error: F64


def classify(importance: F64, lambda_: float, bits: float, limit: int) -> tuple[I64, int]:
    """Class 0.. of each anchor, most important first, and how many there are; -1 for anchors not worth sending.

    Args:
        importance: (N,) squared picture error of leaving the anchor out.
        lambda_: of the last layer, squared picture error per bit.
        bits: what the cheapest anchor costs.
        limit: most classes.
    """
    found = bounds_of_classes(importance, lambda_, bits, limit)
    return found.classes(importance), found.count


def bounds_of_classes(importance: F64, lambda_: float, bits: float, limit: int) -> ClassBounds:
    """The bounds between classes of anchors. For the arguments see :func:`classify`."""
    least = lambda_ * bits
    worth = importance > least
    if not worth.any():
        least = float(np.nextafter(importance.max(), -np.inf))
        worth = importance > least
    found = ClassBounds(least, float(importance[worth].min()), 1, (0,))
    if found.floor <= 0:
        return found
    count = int(min(limit, MAX_CLASSES, np.floor(found.ranks(importance[worth]).max()) + 1))
    found = replace(found, ranked=count, used=tuple(range(count)))
    # Empty classes would waste rows of the layer table.
    return replace(found, used=tuple(np.unique(found.classes(importance[worth])).tolist()))


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

    def classes(self, importance: F64) -> I64:
        """(n,) class of each anchor, 0 the most important; -1 for those not worth sending."""
        whole = np.clip(np.floor(self.ranks(importance)), 0, self.ranked - 1).astype(np.int64)
        found = np.minimum(np.searchsorted(self.used, self.ranked - 1 - whole), self.count - 1)
        return np.where(importance > self.least, found, -1)


def ranked_with_colour(absence: F64, colour: F64, share: float, least: float, shift: float | None = None) -> F64:
    """(N,) importance that ranks anchors by what errors of their colour show as well as by what their absence does.

    A class has one step for all its colours, so that what it gains depends on how alike their weights are; where most
    bits are colour, as with view-dependent colour, that counts more than how alike the weights of shapes are.

    Args:
        absence: (N,) squared picture error of leaving the anchor out.
        colour: (N,) squared picture error per squared unit of colour.
        share: of the colour in the logarithm: 0 ranks by absence alone.
        least: of absence; below, an anchor is not worth sending and stays so, above, it stays worth it.
        shift: :func:`colour_shift` of all anchors; None where these are all.
    """
    worth = absence > least
    if share == 0 or not worth.any():
        return absence
    logs, tints = np.log(absence[worth]), _log_colour(colour[worth])
    ranked = absence.copy()
    shift = colour_shift(absence, colour, least) if shift is None else shift
    ranked[worth] = np.exp((1 - share) * logs + share * (tints + shift))
    ranked[worth] = np.maximum(ranked[worth], np.nextafter(least, np.inf))
    return ranked


def colour_shift(absence: F64, colour: F64, least: float) -> float:
    """How far above the logarithm of its colour's weight that of an anchor's absence is, on average; 0 of none."""
    worth = absence > least
    if not worth.any():
        return 0.0
    return float(np.log(absence[worth]).mean() - _log_colour(colour[worth]).mean())


def _log_colour(colour: F64) -> F64:
    return np.asarray(np.log(np.maximum(colour, 1e-300)))


@compiled
def entropy_bits(symbols: I64, contexts: I64, scale: float = 1.0) -> float:
    """Bits of `scale` times `symbols` under ideal static tables per context, plus about a byte per table entry."""
    if len(symbols) == 0:
        return 0.0
    low = symbols.min()
    span, kinds = symbols.max() - low + 1, contexts.max() + 1
    totals, bits = np.zeros(kinds), 0.0
    for context in contexts:
        totals[context] += 1
    for context, amount in _counted(contexts * span + (symbols - low), kinds * span):
        total = totals[context // span]
        bits += scale * amount * np.log2(total / amount) + TABLE_ENTRY_BITS
    return bits


@compiled
def _counted(numbers: I64, below: int) -> I64:
    """(m, 2) of the different ones among some numbers, and how often each is there."""
    counted = np.empty((len(numbers), 2), np.int64)
    fill = 0
    if below <= _MOST_BINS:
        counts = np.zeros(below, np.int64)
        for number in numbers:
            counts[number] += 1
        for number in range(below):
            if counts[number] > 0:
                counted[fill, 0], counted[fill, 1] = number, counts[number]
                fill += 1
        return counted[:fill]
    for number in np.sort(numbers):
        if fill == 0 or counted[fill - 1, 0] != number:
            counted[fill, 0], counted[fill, 1] = number, 0
            fill += 1
        counted[fill - 1, 1] += 1
    return counted[:fill]


def aligned_steps(
    caps: tuple[float, ...], sensitivity: F64, classes: I64, count: int, lambda_: float
) -> tuple[float, ...]:
    """First-cell widths, near `caps`, whose ternary refinements hit the step that pays at `lambda_`.

    At high rate the best step of a value of sensitivity S is sqrt(6 * lambda_ / (ln 2 * S)). Classes lie one
    ternary step apart, so one phase serves them all; a wrong phase costs up to 1.6 times the error or
    0.7 bits a value.

    Args:
        caps: coarsest useful width per component; the result is within a factor sqrt(3) of it.
        sensitivity: (N, components).
    """
    sizes = np.bincount(classes, minlength=count).astype(np.float64)
    steps = []
    for component, cap in enumerate(caps):
        mean = np.bincount(classes, sensitivity[:, component], count) / np.maximum(sizes, 1)
        useful = (mean > 0) & (sizes > 0)
        if not useful.any():
            steps.append(cap)
            continue
        best = np.log(np.sqrt(6 * lambda_ / np.log(2) / mean[useful])) / np.log(3)
        turn = np.average(np.exp(2j * np.pi * best), weights=sizes[useful])
        phase = float(np.angle(turn)) / (2 * np.pi)
        whole = np.round(np.log(cap) / np.log(3) - phase)
        steps.append(float(3.0 ** (whole + phase)))
    return tuple(steps)


def plan_channel(
    stream: Stream,
    values: F64,
    step: tuple[float, ...],
    sensitivity: F64,
    classes: I64,
    count: int,
    repeat: float = 1.0,
) -> ChannelPlan:
    """Cost tables of a channel for every class and every number of steps up to `FINEST_STEP`.

    Large classes are judged by a sample.

    Args:
        values: (N, components) in units of the attribute.
        sensitivity: (N, components) or (N, 1) squared picture error per squared unit.
        repeat: how many anchors each stands for.
    """
    bits, error = np.zeros((count, FINEST_STEP + 1)), np.zeros((count, FINEST_STEP + 1))
    order, widths = np.argsort(classes, kind="stable"), np.array(step) / 3.0 ** (FINEST_STEP - 1)
    edges = np.cumsum([0, *np.bincount(classes, minlength=count)])
    logarithm, heavy = stream in _LOGARITHMS, np.broadcast_to(sensitivity, values.shape)

    def fill(klass: int) -> None:
        here = order[edges[klass] : edges[klass + 1]]
        sampled = here[:: max(1, len(here) // PLANNED_ANCHORS)]
        scale = repeat * len(here) / max(len(sampled), 1)
        _price_steps(values[sampled], heavy[sampled], widths, logarithm, scale, bits[klass], error[klass])

    with ThreadPoolExecutor(get_num_threads()) as pool:
        list(pool.map(fill, range(count)))
    return ChannelPlan(stream, step, bits, error)


@compiled
def _price_steps(values: F64, weight: F64, finest: F64, logarithm: bool, scale: float, bits: F64, error: F64) -> None:
    """Fill cumulative `bits` and `error` left with 0 .. `FINEST_STEP` steps of one class.

    Of a logarithm, errors are as pictures show them: the part by which the value is off. For small errors that is the
    same. A splat of the coarsest scales is up to e^0.8 times too long, which shows much more than one that is as much
    too short.

    Args:
        values, weight: (n, components).
        finest: (components,) widths of cells after all steps.
        scale: how many anchors each stands for.
    """
    before = np.zeros(len(values), np.int64)
    for component in range(values.shape[1]):
        x, heavy = values[:, component].copy(), weight[:, component].copy()
        cells = np.rint(x / finest[component]).astype(np.int64)
        error[0] += scale * (heavy * x * x).sum()
        total, previous, first = 0.0, cells, cells
        for steps in range(1, FINEST_STEP + 1):
            power = 3 ** (FINEST_STEP - steps)
            now = (cells + (power - 1) // 2) // power
            left = x - now * (finest[component] * power)
            if logarithm:
                left = np.expm1(-left)
            error[steps] += scale * (heavy * left * left).sum()
            if steps > 1:
                total += entropy_bits(now - 3 * previous, np.minimum(np.maximum(previous, -2), 2) + 2, scale)
            else:
                total += _first_bits(now, before, component > 0, scale)
                first = now
            previous = now
            bits[steps] += total
        before = first


@compiled
def _first_bits(values: I64, before: I64, told: bool, scale: float) -> float:
    """Bits of the first step. If the component `before` is known, 16 buckets of it are a context where that pays."""
    alone = entropy_bits(values, np.zeros(len(values), np.int64), scale)
    if not told or len(values) == 0:
        return alone
    buckets = np.minimum(np.maximum(before - int(np.median(before)) + 8, 0), 15)
    return min(alone, entropy_bits(values, buckets, scale))


def hull_choice(bits: F64, error: F64, lambda_: float) -> int:
    """Index on the lower convex hull of (bits, error) that is best at `lambda_`; grows as the lambda_ falls."""
    best = 0
    index = 0
    while index < len(bits) - 1:
        slopes = (error[index] - error[index + 1 :]) / np.maximum(bits[index + 1 :] - bits[index], 1e-9)
        steepest = int(np.argmax(slopes))
        if slopes[steepest] <= lambda_:
            break
        index += 1 + steepest
        best = index
    return best


@dataclass(frozen=True)
class LatentChain:
    """The refinements of the latent, in order: RVQ stages, then steps of the latent channel.

    Attributes:
        stages: M.
        bits, error: (classes, M + steps + 1) cumulative bits and squared picture error left.
    """

    stages: int
    bits: F64
    error: F64

    @property
    def nothing(self) -> LatentChain:
        """The chain that ends before it begins."""
        return LatentChain(0, self.bits[:, :1], self.error[:, :1])


def increment(
    plans: Sequence[ChannelPlan], latent: LatentChain, klass: int, lambda_: float, last: float
) -> tuple[tuple[int, ...], float, float]:
    """(stages, steps per plan, latent steps), error left and bits of one class at `lambda_`.

    Aligned steps would all refine at the same lambda, one layer gaining everything and the next nothing. So
    in layers before the last, every other channel of every other class goes half a step early or late.
    """

    def staggered(number: int) -> float:
        return max(lambda_ * (STAGGER if (klass + number) % 2 else 1 / STAGGER), last)

    picks = [_pick(plan, klass, staggered(number)) for number, plan in enumerate(plans)]
    link = hull_choice(latent.bits[klass], latent.error[klass], staggered(len(plans)))
    error = latent.error[klass, link] + sum(plan.error[klass, n] for plan, n in zip(plans, picks, strict=True))
    bits = latent.bits[klass, link] + sum(plan.bits[klass, n] for plan, n in zip(plans, picks, strict=True))
    entry = (min(link, latent.stages), *picks, max(link - latent.stages, 0))
    return entry, float(error), float(bits)


def _pick(plan: ChannelPlan, klass: int, lambda_: float) -> int:
    best = hull_choice(plan.bits[klass], plan.error[klass], lambda_)
    return min(max(best, _least_steps(plan)), MAX_STEPS)


def _least_steps(plan: ChannelPlan) -> int:
    """Steps of an anchor that shows: far from the truth the model of errors is too kind.

    It has at least a coarse shape and opacity, and a colour that is not another one.
    """
    if plan.stream == Stream.COLOUR:
        steps = 1 + math.ceil(math.log(max(plan.step) / COARSEST_COLOUR, 3))
        return min(max(steps, 1), FINEST_STEP)
    return 0 if plan.stream == Stream.POSITION_RESIDUAL else 1
