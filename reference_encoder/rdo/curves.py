"""Rate-distortion curves: what each step of each channel of each class costs in bits, and the error it leaves.

Both are measured on the data. For a given lambda (error per bit) the best choice of each channel is independent; a
falling lambda gives the layers. Steps are taken along the lower convex hull, so that a smaller lambda never takes
anything back (SPEC §6.5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numba import get_num_threads

from reference_encoder.jit import compiled
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
from scarfmt.arrays import F64, I64
from scarfmt.container.schema import Stream
from scarfmt.scene.model import MAX_STEPS

_LOGARITHMS = (Stream.SCALE, Stream.OPACITY)
_OPTIONAL = (Stream.POSITION_RESIDUAL, Stream.LATENT)
"""Channels of which an anchor that is there may receive nothing."""
_MOST_BINS = 1 << 20
"""Histograms with more possible entries are made by sorting."""


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


def measure_curve(
    stream: Stream,
    values: F64,
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
    return RdCurve(stream, step, bits, error)


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
def _first_bits(values: I64, before: I64, known: bool, scale: float) -> float:
    """Bits of the first step. If the component `before` is known, 16 buckets of it are a context where that pays."""
    alone = entropy_bits(values, np.zeros(len(values), np.int64), scale)
    if not known or len(values) == 0:
        return alone
    buckets = np.minimum(np.maximum(before - int(np.median(before)) + 8, 0), 15)
    return min(alone, entropy_bits(values, buckets, scale))


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
    for context, amount in _count(contexts * span + (symbols - low), kinds * span):
        total = totals[context // span]
        bits += scale * amount * np.log2(total / amount) + TABLE_ENTRY_BITS
    return bits


@compiled
def _count(numbers: I64, below: int) -> I64:
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


def choose_on_hull(bits: F64, error: F64, lambda_: float) -> int:
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


def choose_steps(
    curves: Sequence[RdCurve], klass: int, lambda_: float, last: float, latent: bool = True
) -> tuple[tuple[int, ...], float, float]:
    """Steps of each channel, error left and bits of one class at `lambda_`.

    Aligned steps would all refine at the same lambda, one layer gaining everything and the next nothing. So
    in layers before the last, every other channel of every other class goes half a step early or late.

    Args:
        last: lambda of the last layer.
        latent: whether the LATENT channel may be received.
    """
    steps = []
    for number, curve in enumerate(curves):
        staggered = max(lambda_ * (STAGGER if (klass + number) % 2 else 1 / STAGGER), last)
        left_out = curve.stream == Stream.LATENT and not latent
        steps.append(0 if left_out else _choose_step(curve, klass, staggered))
    error = sum(curve.error[klass, n] for curve, n in zip(curves, steps, strict=True))
    bits = sum(curve.bits[klass, n] for curve, n in zip(curves, steps, strict=True))
    return tuple(steps), float(error), float(bits)


def _choose_step(curve: RdCurve, klass: int, lambda_: float) -> int:
    best = choose_on_hull(curve.bits[klass], curve.error[klass], lambda_)
    return min(max(best, _least_steps(curve)), MAX_STEPS)


def _least_steps(curve: RdCurve) -> int:
    """Steps of an anchor that shows: far from the truth the model of errors is too kind.

    It has at least a coarse shape and opacity, and a colour that is not another one.
    """
    if curve.stream == Stream.COLOUR:
        steps = 1 + math.ceil(math.log(max(curve.step) / COARSEST_COLOUR, 3))
        return min(max(steps, 1), FINEST_STEP)
    return 0 if curve.stream in _OPTIONAL else 1
