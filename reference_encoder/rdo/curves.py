"""Rate-distortion curves: what each step of each channel of each class costs in bits, and the error it leaves.

Both are measured on the data. For a given lambda (error per bit) the best choice of each channel is independent; a
falling lambda gives the layers. Steps are taken along the lower convex hull, so that a smaller lambda never takes
anything back (SPEC §6.5).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from reference_encoder.rdo.classes import split_numbers
from reference_encoder.rdo.rdo_input import RdoInput
from reference_encoder.tuning import (
    COARSEST_COLOUR,
    FINEST_STEP,
    LAMBDA_QUALITY_DB,
    LAMBDA_SLOPE,
    PLANNED_ANCHORS,
    POSITION_BITS,
    STAGGER,
    TABLE_ENTRY_BITS,
)
from scarfmt.arrays import F64, I64, Floats
from scarfmt.container.schema import Stream
from scarfmt.scene.model import MAX_STEPS

_LOGARITHMS = (Stream.SCALE, Stream.OPACITY)
_OPTIONAL = (Stream.POSITION_RESIDUAL, Stream.LATENT)
"""Channels of which an anchor that is there may receive nothing."""
_MOST_BINS = 16
"""Histograms with more possible entries a symbol are made by sorting."""


@dataclass(frozen=True)
class RdCurve:
    """The rate-distortion curves of one channel, per class.

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

    def split(self, parts: Sequence[float]) -> RdCurve:
        """The curves once parts of the first classes are classes of their own (:func:`split_numbers`): a part that is
        spread evenly costs and errs in proportion."""
        whole, share, _, _ = split_numbers(len(self.bits), parts)
        return replace(self, bits=self.bits[whole] * share[:, None], error=self.error[whole] * share[:, None])


def predict_lambda(quality: float, gaussians: int, offset_db: float) -> float:
    """Lambda of the last layer: squared picture error per bit that is predicted to give `quality` dB.

    Measured on the real scenes (docs/decisions/0004-rate-constant.md).

    Args:
        quality: dB.
        gaussians: of the source, or anchors.
        offset_db: at `LAMBDA_QUALITY_DB`, lambda times their number is so far below 1.
    """
    decibels = offset_db + (quality - LAMBDA_QUALITY_DB) / LAMBDA_SLOPE
    return 10 ** (-decibels / 10) / max(gaussians, 1)


def best_width(sensitivity: F64, lambda_: float) -> F64:
    """Quantiser cell whose last bit pays exactly: sqrt(6 * lambda / (ln 2 * S)), the high-rate optimum.

    Args:
        sensitivity: S, squared picture error per squared unit, of any shape.
        lambda_: squared picture error per bit.
    """
    return np.asarray(np.sqrt(6 * lambda_ / np.log(2) / np.maximum(sensitivity, 1e-300)))


def measure_curves(problem: RdoInput) -> list[RdCurve]:
    """The curves of all channels, in coding order."""
    classes, count = problem.classes.of, problem.classes.count
    curves = []
    for stream, caps in problem.coarsest.items():
        weight = problem.weights[stream]
        step = align_steps(caps[: weight.shape[1]], weight, classes, count, problem.lambda_)
        step *= len(caps) // len(step)
        curves.append(measure_curve(stream, problem.values[stream], step, weight, classes, count, problem.repeat))
    return curves


def position_bits(classes: I64, count: int) -> F64:
    """(count,) bits of base positions and labels of the anchors of each class."""
    return POSITION_BITS * np.bincount(classes, minlength=count).astype(np.float64)


def align_steps(
    caps: tuple[float, ...], sensitivity: F64, classes: I64, count: int, lambda_: float
) -> tuple[float, ...]:
    """First-cell widths of float32, near `caps`, whose ternary refinements hit the step that pays at `lambda_`.

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
    return tuple(np.array(steps, np.float32).tolist())


def measure_curve(
    stream: Stream,
    values: Floats,
    step: tuple[float, ...],
    sensitivity: F64,
    classes: I64,
    count: int,
    repeat: float = 1.0,
) -> RdCurve:
    """The curves of a channel for every class and every number of steps up to `FINEST_STEP`.

    Large classes are judged by a sample.

    Args:
        values: (N, components) in units of the attribute.
        sensitivity: (N, components) or (N, 1) squared picture error per squared unit.
        repeat: how many anchors each stands for.
    """
    order, edges = np.argsort(classes, kind="stable"), np.cumsum([0, *np.bincount(classes, minlength=count)])
    members = [order[first:past] for first, past in pairwise(edges)]
    sampled = [here[:: max(1, len(here) // PLANNED_ANCHORS)] for here in members]
    sizes, rows = np.array([len(some) for some in sampled]), np.concatenate(sampled)
    scale = repeat * np.diff(edges) / np.maximum(sizes, 1)
    columns = zip(values.T, np.broadcast_to(sensitivity, values.shape).T, strict=True)
    sampled_columns = ((value[rows], weight[rows]) for value, weight in columns)
    widths = np.array(step) / 3.0 ** (FINEST_STEP - 1)
    of = np.repeat(np.arange(count), sizes)
    bits, error = _price_steps(sampled_columns, of, widths, stream in _LOGARITHMS, scale)
    return RdCurve(stream, step, bits, error)


def _price_steps(
    columns: Iterable[tuple[Floats, F64]], classes: I64, finest: F64, logarithm: bool, scale: F64
) -> tuple[F64, F64]:
    """(classes, steps + 1) cumulative bits, and error left, with 0 .. `FINEST_STEP` steps of every class.

    Of a logarithm, errors are as pictures show them: the part by which the value is off. For small errors that is the
    same. A splat of the coarsest scales is up to e^0.8 times too long, which shows much more than one that is as much
    too short.

    Args:
        columns: of each component, (n,) values and (n,) weights.
        classes: (n,) rising.
        finest: (components,) widths of cells after all steps.
        scale: (classes,) how many anchors each stands for.
    """
    shape = len(scale), FINEST_STEP + 1
    bits, error, before = np.zeros(shape), np.zeros(shape), None
    for (x, heavy), width in zip(columns, finest, strict=True):
        cells = np.rint(x / width).astype(np.int64)
        error[:, 0] += scale * np.bincount(classes, heavy * x * x, len(scale))
        total, previous, first = np.zeros(len(scale)), cells, cells
        for steps in range(1, FINEST_STEP + 1):
            power = 3 ** (FINEST_STEP - steps)
            now = (cells + (power - 1) // 2) // power
            left = x - now * (width * power)
            if logarithm:
                left = np.expm1(-left)
            error[:, steps] += scale * np.bincount(classes, heavy * left * left, len(scale))
            if steps > 1:
                total += entropy_bits(now - 3 * previous, np.clip(previous, -2, 2) + 2, 5, classes, scale)
            else:
                total += _first_bits(now, before, classes, scale)
                first = now
            previous = now
            bits[:, steps] += total
        before = first
    return bits, error


def _first_bits(values: I64, before: I64 | None, classes: I64, scale: F64) -> F64:
    """Bits of the first step of each class. If the component `before` is known, 16 buckets of it are a context where
    that pays."""
    alone = entropy_bits(values, np.zeros_like(values), 1, classes, scale)
    if before is None:
        return alone
    sizes = np.bincount(classes, minlength=len(scale))
    parts = np.split(before, np.cumsum(sizes)[:-1])
    middles = np.array([int(np.median(part)) if len(part) else 0 for part in parts])
    buckets = np.clip(before - middles[classes] + 8, 0, 15)
    return np.minimum(alone, entropy_bits(values, buckets, 16, classes, scale))


def entropy_bits(symbols: I64, contexts: I64, kinds: int, classes: I64, scale: F64) -> F64:
    """(classes,) bits under ideal static tables per class and context, plus about a byte per table entry.

    Args:
        symbols: (n,).
        contexts: (n,) below `kinds`.
        classes: (n,).
        scale: (classes,) how often each symbol of a class is there.
    """
    if len(symbols) == 0:
        return np.zeros(len(scale))
    low = symbols.min()
    span, tables = int(symbols.max() - low) + 1, classes * kinds + contexts
    numbers = tables * span + (symbols - low)
    if len(scale) * kinds * span > _MOST_BINS * len(numbers):
        used, amounts = np.unique(numbers, return_counts=True)
    else:
        amounts = np.bincount(numbers)
        used = np.flatnonzero(amounts)
        amounts = amounts[used]
    ideal = amounts * np.log2(np.bincount(tables)[used // span] / amounts)
    of = used // (span * kinds)
    return scale * np.bincount(of, ideal, len(scale)) + TABLE_ENTRY_BITS * np.bincount(of, minlength=len(scale))


@dataclass(frozen=True)
class StepChoices:
    """What each lambda chooses: steps along the lower convex hulls of all curves (SPEC §6.5).

    Attributes:
        steps: (channels, classes, n) numbers of steps on the hull, rising; the last one repeated.
        slopes: (channels, classes, n) error saved per bit on the way to each from the one before, not rising: infinite
            for the first, 0 for those repeated.
        bits, error: (channels, classes, n) of those.
        stagger: (channels, classes) factors of lambda: every other channel of every other class refines half a step
            early or late. Aligned steps would all refine at the same lambda, one layer gaining all, the next nothing.
        latent: (channels,) whether a channel is LATENT.
    """

    steps: I64
    slopes: F64
    bits: F64
    error: F64
    stagger: F64
    latent: NDArray[np.bool_]

    @classmethod
    def of(cls, curves: Sequence[RdCurve]) -> StepChoices:
        """The hulls of some curves."""
        classes, size = len(curves[0].bits), FINEST_STEP + 1
        steps = np.zeros((len(curves), classes, size), np.int64)
        slopes = np.zeros((len(curves), classes, size))
        bits, error = np.zeros(slopes.shape), np.zeros(slopes.shape)
        for number, curve in enumerate(curves):
            for klass in range(classes):
                place, rate, left = (number, klass), curve.bits[klass], curve.error[klass]
                steps[place], slopes[place] = find_hull(rate, left, _least_steps(curve), size)
                bits[place], error[place] = rate[steps[place]], left[steps[place]]
        odd = np.add.outer(np.arange(len(curves)), np.arange(classes)) % 2
        latent = np.array([curve.stream == Stream.LATENT for curve in curves])
        return cls(steps, slopes, bits, error, np.where(odd, STAGGER, 1 / STAGGER), latent)

    def at(self, lambda_: float, last: float, latent: bool = True) -> tuple[I64, F64, F64]:
        """(channels, classes) steps, (classes,) error left, and (classes,) bits, of classes at `lambda_`.

        Args:
            last: lambda of the last layer, which is not staggered.
            latent: whether the LATENT channel may be received.
        """
        wanted = np.maximum(lambda_ * self.stagger, last) if lambda_ > last else np.full_like(self.stagger, last)
        place = (self.slopes > wanted[:, :, None]).sum(axis=2) - 1
        if not latent:
            place[self.latent] = 0
        here = (*np.indices(place.shape), place)
        return self.steps[here], self.error[here].sum(axis=0), self.bits[here].sum(axis=0)


def find_hull(bits: F64, error: F64, least: int, size: int) -> tuple[I64, F64]:
    """(size,) numbers of steps on the lower convex hull of (bits, error), and the slopes that lead to them.

    Args:
        bits, error: (steps + 1,) with 0.. steps.
        least: fewest steps there may be: points of the hull before it are it.
        size: at least as many as there are points; :class:`StepChoices` says what fills the rest.
    """
    chosen, slopes = [0], [math.inf]
    while chosen[-1] < len(bits) - 1:
        here = chosen[-1]
        each = (error[here] - error[here + 1 :]) / np.maximum(bits[here + 1 :] - bits[here], 1e-9)
        steepest = int(np.argmax(each))
        if each[steepest] <= 0:
            break
        chosen.append(here + 1 + steepest)
        slopes.append(min(float(each[steepest]), slopes[-1]))
    rest = size - len(chosen)
    steps = np.array(chosen + chosen[-1:] * rest, np.int64)
    return np.clip(steps, least, MAX_STEPS), np.array(slopes + [0.0] * rest)


def _least_steps(curve: RdCurve) -> int:
    """Steps of an anchor that shows: far from the truth the model of errors is too kind.

    It has at least a coarse shape and opacity, and a colour that is not another one.
    """
    if curve.stream == Stream.COLOUR:
        steps = 1 + math.ceil(math.log(max(curve.step) / COARSEST_COLOUR, 3))
        return min(max(steps, 1), FINEST_STEP)
    return 0 if curve.stream in _OPTIONAL else 1
