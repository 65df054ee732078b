"""Training one predictor: a small float network, then its integers (encoder side of SPEC §10.3).

The network gives two numbers. For a first step they are the mean and log-scale of a logistic law of the value, for a
ternary step the log-odds of +1 against -1 and of 0: what tells most about the next symbol. Their ranges, cut into
buckets, are the contexts; the tables fitted to each context make up for what the law gets wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_encoder.networks.predictor_descent import Parameters, descend
from reference_encoder.options import PredictorTraining
from reference_encoder.tuning import (
    BUCKET_PERCENTS,
    LEAST_DEVIATION,
    LEAST_RANGE,
    NEGLIGIBLE_WEIGHT,
    WEIGHT_PENALTY_BITS,
)
from scarfmt.arrays import F32, F64, I16, I64
from scarfmt.container.schema import Stream
from scarfmt.neural.arithmetic import MAX_SHIFT, Linear
from scarfmt.neural.predictors import AMAX, Predictor


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


def train(x: I16, symbols: I64, ternary: bool, total: int, training: PredictorTraining, seed: int) -> FloatNet:
    """A sparse network that predicts the law of (n,) `symbols` from (n, inputs) `x`. Deterministic.

    Args:
        total: symbols that it will serve.
    """
    centre, spread = x.mean(axis=0), np.maximum(x.std(axis=0), LEAST_DEVIATION)
    inputs, targets = ((x - centre) / spread).astype(np.float32), symbols.astype(np.float32)
    start = _start(x.shape[1], training.units, None if ternary else targets, np.random.default_rng(seed))
    found = descend(start, inputs, targets, ternary, WEIGHT_PENALTY_BITS / total, training.iterations, seed)
    first, direct, second = (
        np.where(np.abs(w) < NEGLIGIBLE_WEIGHT, 0, w) for w in (found.first, found.direct, found.second)
    )
    first, direct, second = (w.astype(np.float64) for w in (first, direct, second))
    shift = -centre / spread
    bias, offset = found.bias.astype(np.float64) + shift @ first, found.offset.astype(np.float64) + shift @ direct
    return _without_dead_units(FloatNet(first.T / spread, bias, direct.T / spread, second.T.copy(), offset))


def _start(width: int, units: int, values: F32 | None, random: np.random.Generator) -> Parameters:
    """Random hidden units and an output that is right on average; `values` of a first step, None for ternary ones."""
    offset = np.zeros(2)
    if values is not None:
        # A logistic law's scale is 0.55 of its standard deviation.
        offset = np.array([values.mean(), np.log(max(0.55 * float(values.std()), 0.2))])
    first, second = random.standard_normal((width, units)) / width**0.5, 0.05 * random.standard_normal((units, 2))
    zeros = np.zeros(units), np.zeros((width, 2))
    bias, direct = (part.astype(np.float32) for part in zeros)
    return Parameters(first.astype(np.float32), bias, direct, second.astype(np.float32), offset.astype(np.float32))


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


def quantised(
    net: FloatNet, x: I16, outputs: F64, key: tuple[Stream, int, int], buckets: tuple[int, int], top: int = 127
) -> Predictor:
    """The predictor of `net`: weights up to `top`, power-of-two shifts, buckets folded in.

    Args:
        x: (n, inputs) sample, for the range of hidden units.
        outputs: (n, 2) the net's on it.
    """
    slopes, intercepts = cuts(outputs, buckets)
    hidden, gains, kept = _hidden(net, x, top)
    weights = np.concatenate([net.direct, net.second[:, kept] / gains], axis=1) * slopes[:, None]
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
    kept = (active > 0) & net.second.any(axis=0)
    if not kept.any():
        return None, np.zeros(0), kept
    # Each row uses all the bits; the shift brings the most active unit into range.
    gains = top / np.abs(net.weights[kept]).max(axis=1)
    shift = max(0, int(np.ceil(np.log2((gains * active[kept]).max() / AMAX))))
    weights = np.rint(net.weights[kept] * gains[:, None]).astype(np.int32)
    biases = np.rint(net.biases[kept] * gains).astype(np.int64)
    return Linear(weights, biases, shift), gains / 2.0**shift, kept


def candidates(most: int) -> Sequence[tuple[int, int]]:
    """Bucket counts worth trying, contexts at most `most`."""
    return [
        b for b in ((8, 1), (16, 1), (8, 2), (8, 4), (16, 2), (16, 4), (8, 8), (32, 2), (16, 8)) if b[0] * b[1] <= most
    ]
