"""Training one predictor: a small float network, then its integers (encoder side of SPEC §10.3).

The network gives two numbers. For a first step they are the mean and log-scale of a logistic law of the value, for a
ternary step the log-odds of +1 against -1 and of 0: what tells most about the next symbol. Their ranges, cut into
buckets, are the contexts; the tables fitted to each context make up for what the law gets wrong.

Adam on minibatches with a one-cycle schedule (Smith and Topin 2018), gradients written out and compiled: the networks
are so small that anything else is mostly overhead. Single-threaded and in a fixed order, so that the result does not
depend on the machine's cores; the GIL is released.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_encoder.training.networks.jit import compile_exact, compile_reduction
from reference_encoder.tuning import (
    BUCKET_PERCENTS,
    LAST_SLOWER,
    LEAST_DEVIATION,
    LEAST_RANGE,
    MOMENTA,
    NEGLIGIBLE_WEIGHT,
    PREDICTOR_BATCH,
    PREDICTOR_ITERATIONS,
    PREDICTOR_LEARNING_RATE,
    RISE_SHARE,
    SLOWEST,
    WEIGHT_PENALTY_BITS,
)
from scarfmt.arrays import F32, F64, I16, I64
from scarfmt.container.schema import Stream
from scarfmt.neural.arithmetic import MAX_SHIFT, Linear
from scarfmt.neural.predictors import AMAX, Predictor

BUCKETS = ((8, 1), (16, 1), (8, 2), (8, 4), (16, 2), (16, 4), (8, 8), (32, 2), (16, 8))
"""Numbers of contexts worth trying, by output: at most `MAX_CONTEXTS` together."""
_SECOND_DECAY = 0.98
_LEAST_MASS = 1e-6
_CHUNK = 256
"""Rows worked on together: what they need stays in the cache."""


Parameters = tuple[F32, F32, F32, F32, F32]
"""A network o = x direct + relu(x first + bias) second + offset: first (inputs, units), bias (units,), direct
(inputs, 2), second (units, 2), offset (2,)."""


def descend(
    start: Parameters, inputs: F32, targets: F32, ternary: bool, penalty: float, iterations: int, seed: int
) -> Parameters:
    """Parameters that make (n,) `targets` likely given (n, width) `inputs`, their magnitudes costing `penalty` each.

    Args:
        ternary: targets are -1, 0, 1 with log-odds o; else they follow a logistic law of mean and log-scale o.
    """
    first, bias, direct, second, offset = start
    (width, units), random = first.shape, np.random.default_rng(seed)
    # Direct weights lie beside those of the hidden units, biases below.
    wide = np.zeros((width + 1, units + 2), np.float32)
    wide[:width, :units], wide[width, :units] = first, bias
    wide[:width, units:], wide[width, units:] = direct, offset
    second = np.ascontiguousarray(second, np.float32)
    epochs = -(-iterations * PREDICTOR_BATCH // len(inputs))
    order = np.concatenate([random.permutation(len(inputs)) for _ in range(epochs)])[: iterations * PREDICTOR_BATCH]
    rates, momenta = one_cycle(iterations)
    _descend(wide, second, inputs, targets, ternary, penalty, order.reshape(iterations, -1), rates, momenta)
    return wide[:width, :units], wide[width, :units], wide[:width, units:], second, wide[width, units:]


def one_cycle(iterations: int) -> tuple[F64, F64]:
    """(iterations,) rates and momenta: up along a cosine, then down to almost nothing."""
    peak = RISE_SHARE * iterations - 1
    at = np.arange(iterations)
    rising = np.clip(at / max(peak, 1e-9), 0, 1)
    falling = np.clip((at - peak) / max(iterations - 1 - peak, 1e-9), 0, 1)
    up, down = (1 - np.cos(np.pi * rising)) / 2, (1 - np.cos(np.pi * falling)) / 2
    highest, lowest = PREDICTOR_LEARNING_RATE, PREDICTOR_LEARNING_RATE / SLOWEST
    rates = np.where(at < peak, lowest + (highest - lowest) * up, highest + (lowest / LAST_SLOWER - highest) * down)
    low, high = MOMENTA
    momenta = np.where(at < peak, low + (high - low) * up, high + (low - high) * down)
    return rates, momenta


@compile_exact
def _slopes(one: float, two: float, target: float, ternary: bool) -> tuple[float, float]:
    """Derivatives of the negative log-likelihood of `target` by both outputs."""
    if ternary:
        most = max(abs(one), two)
        low, middle, high = np.exp(-one - most), np.exp(two - most), np.exp(one - most)
        total = low + middle + high
        return (high - low) / total - target, middle / total - (1.0 if target == 0 else 0.0)
    sharpness = np.exp(-min(max(two, -4.0), 8.0))
    above, below = (target - one + 0.5) * sharpness, (target - one - 0.5) * sharpness
    up, down = 1.0 / (1.0 + np.exp(-above)), 1.0 / (1.0 + np.exp(-below))
    mass = up - down
    if mass < _LEAST_MASS:
        return 0.0, 0.0
    up, down = up * (1.0 - up), down * (1.0 - down)
    return sharpness * (up - down) / mass, (above * up - below * down) / mass if -4.0 < two < 8.0 else 0.0


@compile_exact
def _forward(wide: F32, second: F32, x: F32, targets: F32, ternary: bool, sums: F32, slopes: F32) -> None:
    """Fill `sums` with what the columns of `wide` make of a chunk, and `slopes` with derivatives by them.

    Args:
        x: (inputs + 1, _CHUNK), the last row ones.
        sums, slopes: (units + 2, _CHUNK).
    """
    units = len(second)
    for column in range(units + 2):
        sums[column] = 0
        for row in range(len(x)):
            weight, into, source = wide[row, column], sums[column], x[row]
            for k in range(_CHUNK):
                into[k] += weight * source[k]
    for unit in range(units):
        for k in range(_CHUNK):
            active = max(sums[unit, k], np.float32(0))
            sums[units, k] += active * second[unit, 0]
            sums[units + 1, k] += active * second[unit, 1]
    for k in range(_CHUNK):
        one, two = _slopes(sums[units, k], sums[units + 1, k], targets[k], ternary)
        slopes[units, k], slopes[units + 1, k] = one, two
    for unit in range(units):
        for k in range(_CHUNK):
            back = slopes[units, k] * second[unit, 0] + slopes[units + 1, k] * second[unit, 1]
            slopes[unit, k] = back if sums[unit, k] > 0 else np.float32(0)


@compile_reduction
def _dot(one: F32, two: F32) -> float:
    total = np.float32(0)
    for k in range(_CHUNK):
        total += one[k] * two[k]
    return float(total)


@compile_exact
def _backward(x: F32, sums: F32, slopes: F32, by_wide: F32, by_second: F32) -> None:
    """Add a chunk's gradients by `wide` and `second`."""
    units = len(by_second)
    for unit in range(units):
        for k in range(_CHUNK):
            sums[unit, k] = max(sums[unit, k], np.float32(0))
        for output in range(2):
            by_second[unit, output] += _dot(sums[unit], slopes[units + output])
    for row in range(len(x)):
        for column in range(units + 2):
            by_wide[row, column] += _dot(x[row], slopes[column])


@compile_exact
def _adam(values: F32, gradient: F32, first: F64, second: F64, rate: float, momentum: float, at: int) -> None:
    """One step of Adam (Kingma and Ba 2014) on flat arrays."""
    correction = np.sqrt(1.0 - _SECOND_DECAY ** (at + 1))
    length = rate / (1.0 - momentum ** (at + 1))
    for k in range(len(values)):
        slope = np.float64(gradient[k])
        first[k] += (1.0 - momentum) * (slope - first[k])
        second[k] = _SECOND_DECAY * second[k] + (1.0 - _SECOND_DECAY) * slope * slope
        values[k] -= length * first[k] / (np.sqrt(second[k]) / correction + 1e-8)


@compile_exact
def _descend(
    wide: F32,
    second: F32,
    inputs: F32,
    targets: F32,
    ternary: bool,
    penalty: float,
    order: I64,
    rates: F64,
    momenta: F64,
) -> None:
    """Minimise in place.

    Args:
        wide: (inputs + 1, units + 2), biases last.
        order: (iterations, batch) rows of each batch; a batch is whole chunks.
    """
    (rows, columns), batch = wide.shape, order.shape[1]
    x, goal = np.ones((rows, _CHUNK), np.float32), np.empty(_CHUNK, np.float32)
    sums, slopes = np.empty((columns, _CHUNK), np.float32), np.empty((columns, _CHUNK), np.float32)
    by_wide, by_second = np.empty_like(wide), np.empty_like(second)
    moments = np.zeros((2, wide.size)), np.zeros((2, second.size))
    for at in range(len(rates)):
        by_wide[:], by_second[:] = 0, 0
        for first in range(0, batch, _CHUNK):
            for k in range(_CHUNK):
                goal[k] = targets[order[at, first + k]]
                for row in range(rows - 1):
                    x[row, k] = inputs[order[at, first + k], row]
            _forward(wide, second, x, goal, ternary, sums, slopes)
            _backward(x, sums, slopes, by_wide, by_second)
        for row in range(rows):
            for column in range(columns):
                cost = penalty * np.sign(wide[row, column]) if row < rows - 1 else 0.0
                by_wide[row, column] = by_wide[row, column] / batch + cost
        for unit in range(len(second)):
            for output in range(2):
                by_second[unit, output] = by_second[unit, output] / batch + penalty * np.sign(second[unit, output])
        _adam(wide.ravel(), by_wide.ravel(), moments[0][0], moments[0][1], rates[at], momenta[at], at)
        _adam(second.ravel(), by_second.ravel(), moments[1][0], moments[1][1], rates[at], momenta[at], at)


@dataclass(frozen=True)
class FloatNet:
    """A trained network in units of the integer inputs, o = direct x + hidden part.

    Attributes:
        weights, biases: (units, inputs) and (units,) of the ReLU layer.
        direct, second, offsets: (2, inputs), (2, units) and (2,) of the output.
    """

    weights: F64
    biases: F64
    direct: F64
    second: F64
    offsets: F64

    def hidden(self, x: F64) -> F64:
        """(n, units) of (n, inputs)."""
        return np.asarray(np.maximum(x @ self.weights.T + self.biases, 0))

    def outputs(self, x: F64) -> F64:
        """(n, 2) of (n, inputs)."""
        return np.asarray(x @ self.direct.T + self.hidden(x) @ self.second.T + self.offsets)


def train(
    x: I16,
    symbols: I64,
    ternary: bool,
    total: int,
    units: int,
    seed: int,
    iterations: int = PREDICTOR_ITERATIONS,
) -> FloatNet:
    """A sparse network that predicts the law of (n,) `symbols` from (n, inputs) `x`. Deterministic.

    Args:
        total: symbols that it will serve.
        units: hidden units, at most.
        seed: of the start and of the order of samples.
        iterations: steps of the descent.
    """
    centre, spread = x.mean(axis=0), np.maximum(x.std(axis=0), LEAST_DEVIATION)
    inputs, targets = ((x - centre) / spread).astype(np.float32), symbols.astype(np.float32)
    start = _start(x.shape[1], units, None if ternary else targets, np.random.default_rng(seed))
    trained = descend(start, inputs, targets, ternary, WEIGHT_PENALTY_BITS / total, iterations, seed)
    first, bias, direct, second, offset = trained
    hidden, linear, output = (
        np.where(np.abs(w) < NEGLIGIBLE_WEIGHT, 0, w).astype(np.float64) for w in (first, direct, second)
    )
    shift = -centre / spread
    biases, offsets = bias.astype(np.float64) + shift @ hidden, offset.astype(np.float64) + shift @ linear
    return _without_dead_units(FloatNet(hidden.T / spread, biases, linear.T / spread, output.T.copy(), offsets))


def _start(width: int, units: int, values: F32 | None, random: np.random.Generator) -> Parameters:
    """Random hidden units and an output that is right on average; `values` of a first step, None for ternary ones."""
    offset = np.zeros(2)
    if values is not None:
        # A logistic law's scale is 0.55 of its standard deviation.
        offset = np.array([values.mean(), np.log(max(0.55 * float(values.std()), 0.2))])
    first, second = random.standard_normal((width, units)) / width**0.5, 0.05 * random.standard_normal((units, 2))
    zeros = np.zeros(units), np.zeros((width, 2))
    bias, direct = (part.astype(np.float32) for part in zeros)
    return first.astype(np.float32), bias, direct, second.astype(np.float32), offset.astype(np.float32)


def _without_dead_units(net: FloatNet) -> FloatNet:
    """`net` without the units that look at nothing: they are constants."""
    live = net.weights.any(axis=1)
    constant = net.second[:, ~live] @ np.maximum(net.biases[~live], 0)
    return FloatNet(net.weights[live], net.biases[live], net.direct, net.second[:, live], net.offsets + constant)


def cuts(outputs: F64, buckets: tuple[int, int]) -> tuple[F64, F64]:
    """Slope and intercept, (2,) each, so that floor(slope * output + intercept) is the bucket."""
    slopes, intercepts = np.zeros(2), np.zeros(2)
    for row, (count, percent) in enumerate(zip(buckets, BUCKET_PERCENTS, strict=True)):
        if count > 1:
            low, high = np.percentile(outputs[:, row], [percent, 100 - percent])
            slopes[row] = count / max(high - low, LEAST_RANGE)
            intercepts[row] = -low * slopes[row]
    return slopes, intercepts


def float_contexts(outputs: F64, buckets: tuple[int, int]) -> I64:
    """(n,) context numbers that an exact network would give."""
    slopes, intercepts = cuts(outputs, buckets)
    one, two = np.clip(np.floor(outputs * slopes + intercepts), 0, np.array(buckets) - 1).T
    return np.asarray(one * buckets[1] + two, np.int64)


def quantise(
    net: FloatNet, x: I16, outputs: F64, key: tuple[Stream, int, int], buckets: tuple[int, int], top: int = 127
) -> Predictor:
    """The predictor of `net`: weights up to `top`, power-of-two shifts, buckets folded in.

    Args:
        x: (n, inputs) sample, for the range of hidden units.
        outputs: (n, 2) the net's on it.
    """
    slopes, intercepts = cuts(outputs, buckets)
    hidden, gains, live = _hidden(net, x, top)
    weights = np.concatenate([net.direct, net.second[:, live] / gains], axis=1) * slopes[:, None]
    # round_shift rounds where buckets are cut downwards.
    offsets = net.offsets * slopes + intercepts - 0.5 * (slopes > 0)
    shift = int(np.clip(np.floor(np.log2(top / max(float(np.abs(weights).max()), 1e-9))), 0, MAX_SHIFT - 4))
    scaled = np.clip(np.rint(weights * 2.0**shift), -top, top).astype(np.int32)
    output = Linear(scaled, np.rint(offsets * 2.0**shift).astype(np.int64), shift)
    stream, component, step = key
    return Predictor(stream, component, step, hidden, output, buckets)


def _hidden(net: FloatNet, x: I16, top: int) -> tuple[Linear | None, F64, NDArray[np.bool_]]:
    """The ReLU layer, what its units were multiplied by, and which are kept."""
    if not len(net.weights):
        return None, np.zeros(0), np.zeros(0, np.bool_)
    active = np.percentile(net.hidden(x.astype(np.float64)), 99.9, axis=0)
    live = (active > 0) & net.second.any(axis=0)
    if not live.any():
        return None, np.zeros(0), live
    # Each row uses all the bits; the shift brings the most active unit into range.
    gains = top / np.abs(net.weights[live]).max(axis=1)
    shift = max(0, int(np.ceil(np.log2((gains * active[live]).max() / AMAX))))
    weights = np.rint(net.weights[live] * gains[:, None]).astype(np.int32)
    biases = np.rint(net.biases[live] * gains).astype(np.int64)
    return Linear(weights, biases, shift), gains / 2.0**shift, live
