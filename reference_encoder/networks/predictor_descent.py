"""The descent that trains predictors, compiled: the networks are so small that anything else is mostly overhead.

Adam on minibatches with a one-cycle schedule (Smith and Topin 2018), gradients written out. Single-threaded and in a
fixed order, so that the result does not depend on the machine's cores; the GIL is released.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference_encoder.jit import compiled, reduced
from reference_encoder.tuning import LAST_SLOWER, MOMENTA, PREDICTOR_BATCH, PREDICTOR_LEARNING_RATE, RISE_SHARE, SLOWEST
from scarfmt.arrays import F32, F64, I64

_SECOND_DECAY = 0.98
_LEAST_MASS = 1e-6
_CHUNK = 256
"""Rows worked on together: what they need stays in the cache."""


@dataclass
class Parameters:
    """A network o = x direct + relu(x first + bias) second + offset, all float32.

    Attributes:
        first, bias: (inputs, units) and (units,).
        direct, second, offset: (inputs, 2), (units, 2) and (2,).
    """

    first: F32
    bias: F32
    direct: F32
    second: F32
    offset: F32


def descend(
    start: Parameters, inputs: F32, targets: F32, ternary: bool, penalty: float, iterations: int, seed: int
) -> Parameters:
    """Parameters that make (n,) `targets` likely given (n, width) `inputs`, their magnitudes costing `penalty` each.

    Args:
        ternary: targets are -1, 0, 1 with log-odds o; else they follow a logistic law of mean and log-scale o.
    """
    (width, units), random = start.first.shape, np.random.default_rng(seed)
    # Direct weights lie beside those of the hidden units, biases below.
    wide = np.zeros((width + 1, units + 2), np.float32)
    wide[:width, :units], wide[width, :units] = start.first, start.bias
    wide[:width, units:], wide[width, units:] = start.direct, start.offset
    second = np.ascontiguousarray(start.second, np.float32)
    epochs = -(-iterations * PREDICTOR_BATCH // len(inputs))
    order = np.concatenate([random.permutation(len(inputs)) for _ in range(epochs)])[: iterations * PREDICTOR_BATCH]
    rates, momenta = one_cycle(iterations)
    _descend(wide, second, inputs, targets, ternary, penalty, order.reshape(iterations, -1), rates, momenta)
    return Parameters(wide[:width, :units], wide[width, :units], wide[:width, units:], second, wide[width, units:])


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


@compiled
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


@compiled
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


@reduced
def _dot(one: F32, two: F32) -> float:
    total = np.float32(0)
    for k in range(_CHUNK):
        total += one[k] * two[k]
    return float(total)


@compiled
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


@compiled
def _adam(values: F32, gradient: F32, first: F64, second: F64, rate: float, momentum: float, at: int) -> None:
    """One step of Adam (Kingma and Ba 2014) on flat arrays."""
    correction = np.sqrt(1.0 - _SECOND_DECAY ** (at + 1))
    length = rate / (1.0 - momentum ** (at + 1))
    for k in range(len(values)):
        slope = np.float64(gradient[k])
        first[k] += (1.0 - momentum) * (slope - first[k])
        second[k] = _SECOND_DECAY * second[k] + (1.0 - _SECOND_DECAY) * slope * slope
        values[k] -= length * first[k] / (np.sqrt(second[k]) / correction + 1e-8)


@compiled
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
