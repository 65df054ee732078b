"""Operations of the index network at their limits, each against Python integers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.entropy_operations import DoubleOperations, ShuffledOperations
from conformance.decoders.python import arithmetic as exact
from conformance.writer.oracle import Oracle, frequencies_of
from reference_decoder.torch_operations import TorchOperations
from scarfmt.entropy.rans import MAX_ALPHABET, TOTAL
from scarfmt.neural.arithmetic import ACCUMULATOR_LIMIT, MAX_SHIFT, MAX_WEIGHT, Linear, amplitude, half_step
from scarfmt.neural.network import Inputs
from scarfmt.neural.operations import NumpyOperations, Operations
from scarfmt.neural.parts import Recurrence, Rounded
from scarfmt.neural.tables import LAST, exp2_table, sigmoid_table, state_table
from tests.neural.networks import random_books, random_network

Edge = dict[str, Any]

_LAYERS, _RECURRENCES, _TOTALS, _ROWS, _SHARES = 200, 40, 20_000, 12, 20_000
_WEIGHT_ONE = 1 << 16


def every_way() -> list[Operations]:
    """The array operations compared."""
    return [NumpyOperations(), TorchOperations("cpu"), ShuffledOperations(0), DoubleOperations()]


def measure_edges() -> list[Edge]:
    """The comparisons: what was compared, how often, the worst case, its limit, and how many differ."""
    rng = np.random.default_rng(7)
    return [
        _linear_layers(rng),
        _recurrent_layers(rng),
        _roundings(),
        _tables(),
        _quotients(rng),
        _frequency_rows(rng),
        _shares(rng),
    ]


def _edge(operation: str, cases: int, worst: str, limit: str, differ: int) -> Edge:
    return {"operation": operation, "cases": cases, "worst": worst, "limit": limit, "differ": differ}


def _full_layer(rng: np.random.Generator, amax: int) -> Linear:
    """A layer of which every row reaches 2^24 - 1, of any size, weight and shift."""
    rows, columns = int(rng.integers(1, 12)), int(rng.integers(1, 257))
    top = min(MAX_WEIGHT, int((ACCUMULATOR_LIMIT * 0.9) / amax / columns))
    weights = rng.integers(-top, top + 1, (rows, columns))
    room = ACCUMULATOR_LIMIT - 1 - np.abs(weights).sum(axis=1) * amax
    shift = int(rng.integers(0, MAX_SHIFT + 1))
    while half_step(shift) > room.min():
        shift -= 1
    return Linear(weights.astype(np.int32), rng.choice([-1, 1], rows) * (room - half_step(shift)), shift)


def _linear_layers(rng: np.random.Generator) -> Edge:
    """Inputs that bring one row after the other to its largest accumulator."""
    cases = worst = differ = 0
    for _ in range(_LAYERS):
        amax = amplitude(int(rng.integers(8, 13)))
        layer = _full_layer(rng, amax)
        layer.check(amax)
        signs = np.where(layer.biases < 0, -1, 1)
        x = amax * np.where(layer.weights < 0, -1, 1) * signs[:, None]
        sums = x.astype(np.int64) @ layer.weights.T.astype(np.int64) + layer.biases
        worst = max(worst, int(np.abs(sums).max()) + half_step(layer.shift))
        plain = exact.Linear(layer.weights.tolist(), layer.biases.tolist(), layer.shift)
        wanted = [plain(row, -amax, amax) for row in x.tolist()]
        for do in every_way():
            found = np.asarray(Rounded(layer, do, -amax, amax)(do.constant(x)))
            differ += int(np.count_nonzero(found != wanted))
            cases += found.size
    return _edge("linear layer", cases, f"{worst:,}", f"{ACCUMULATOR_LIMIT - 1:,}", differ)


def _recurrent_layers(rng: np.random.Generator) -> Edge:
    """Tokens and states that bring the sum of both products of one row after the other to the largest."""
    cases = worst = differ = 0
    inputs = Inputs(classes=1, own=False, attributes=1, depths=1, latents=0, latent_shift=0, grid=0)
    for _ in range(_RECURRENCES):
        books, bits = random_books(rng, 4, 4, 5), int(rng.integers(8, 13))
        network = random_network(
            rng, books, inputs, stages=2, hidden=int(rng.integers(1, 12)), activation_bits=bits, edge=True,
            pre_activation=float(rng.choice([96, 3000, 1e6])),
        )  # fmt: skip
        layer, amax = network.gru[0], network.amax
        signs = np.where(layer.biases[0] < 0, -1, 1)[:, None]
        tokens = amax * signs * np.where(layer.inputs[0] < 0, -1, 1)
        states = amax * np.where(layer.recurrent_biases < 0, -1, 1)[:, None] * np.where(layer.recurrent < 0, -1, 1)
        px = tokens.astype(np.int64) @ layer.inputs[0].T + layer.biases[0]
        ph = states.astype(np.int64) @ layer.recurrent.T + layer.recurrent_biases
        worst = max(worst, int((np.abs(px) + np.abs(ph)).max()) + 2 * half_step(layer.shift))
        judge = Oracle(network, books.coarse.tolist(), books.residual.tolist()).network
        wanted = [judge.gru_step(0, 1, *pair) for pair in zip(tokens.tolist(), states.tolist(), strict=True)]
        for do in every_way():
            recurrence = Recurrence(layer, [tokens], bits, do)
            products = recurrence.token_products(1, do.index(np.arange(len(tokens))))
            found = np.asarray(recurrence.step(products, do.constant(states)))
            differ += int(np.count_nonzero(found != wanted))
            cases += found.size
    return _edge("recurrent layer, sum of both products", cases, f"{worst:,}", f"{ACCUMULATOR_LIMIT - 1:,}", differ)


def _roundings() -> Edge:
    """Ties, and one to both sides of them, at every shift."""
    cases = differ = 0
    for shift in range(MAX_SHIFT + 1):
        most = (ACCUMULATOR_LIMIT - 1 - half_step(shift)) // max(half_step(shift), 1)
        steps = np.unique(np.concatenate([np.arange(-9, 10), [-most, most]]))
        values = (steps[np.abs(steps) <= most][:, None] * max(half_step(shift), 1) + [-1, 0, 1]).ravel()
        values = values[np.abs(values) + half_step(shift) < ACCUMULATOR_LIMIT]
        layer = Linear(np.zeros((len(values), 1), np.int32), values.astype(np.int64), shift)
        wanted = [exact.round_shift(v, shift) for v in values.tolist()]
        for do in every_way():
            found = np.asarray(Rounded(layer, do, -ACCUMULATOR_LIMIT, ACCUMULATOR_LIMIT)(do.constant(np.zeros((1, 1)))))
            differ += int(np.count_nonzero(found[0] != wanted))
            cases += found.size
    return _edge("rounding shift, ties", cases, f"shift {MAX_SHIFT}", f"shift {MAX_SHIFT}", differ)


def _tables() -> Edge:
    """Every argument of the tables, and far beyond their ends."""
    far = [-ACCUMULATOR_LIMIT + 1, -70_000, 70_000, ACCUMULATOR_LIMIT - 1]
    both, positive = [*range(-LAST - 50, LAST + 51), *far], [*range(600), *far[2:]]
    checks = [(sigmoid_table(), LAST, both, [exact.sigmoid12(v) for v in both])]
    checks += [(exp2_table(), 0, positive, [exact.exp2w(d) for d in positive])]
    for bits in range(8, 13):
        top = amplitude(bits)
        states = [exact.clamp(exact.round_shift(exact.tanh12(v), 12 - bits), -top, top) for v in both]
        checks.append((state_table(bits), LAST, both, states))
    cases = differ = 0
    for table, origin, arguments, wanted in checks:
        for do in every_way():
            found = np.asarray(do.lookup_(do.constant(table), do.constant(np.array([arguments])), origin))
            differ += int(np.count_nonzero(found[0] != wanted))
            cases += len(wanted)
    return _edge("sigmoid, tanh and exp2w tables", cases, f"argument {far[-1]:,}", "saturate: any", differ)


def _quotients(rng: np.random.Generator) -> Edge:
    """C (2^24 - n) / C_n in binary64 for the C whose quotient comes closest to the next integer without reaching it."""
    cases, differ, nearest = 0, 0, math.inf
    for size, total in _hard_totals(rng):
        # C (2^24 - n) = -1 modulo C_n: the quotient is 1 / C_n below an integer, the least there is.
        prefix = -pow(TOTAL - size, -1, total) % total
        product = prefix * (TOTAL - size)
        found = float(np.floor(np.float64(product) / np.float64(total)))
        differ += found != product // total
        nearest = min(nearest, 1 / total / (math.ulp(product / total) / 2))
        cases += 1
    worst = f"{nearest:.2f} half units in the last place below an integer"
    return _edge("division of a frequency, float64", cases, worst, "must be above 1", differ)


def _hard_totals(rng: np.random.Generator) -> Iterator[tuple[int, int]]:
    """(n, C_n) up to the largest sum of weights, with an inverse of 2^24 - n."""
    for number in range(_TOTALS):
        size = MAX_ALPHABET if number % 2 else int(rng.integers(2, MAX_ALPHABET))
        most = size * _WEIGHT_ONE
        total = most - number if number % 4 < 2 else int(rng.integers(_WEIGHT_ONE, most))
        if math.gcd(TOTAL - size, total) == 1:
            yield size, total


def _frequency_rows(rng: np.random.Generator) -> Edge:
    """Alphabets of every size up to 4096: all equal, ties, one far above the rest, spread over and beyond the table."""
    cases = differ = 0
    for size in (1, 2, 63, 64, 65, 128, 1000, MAX_ALPHABET):
        logits = np.round(rng.normal(size=(_ROWS, size)) * rng.choice([0, 1, 30, 150, 1e6], (_ROWS, 1)))
        logits = np.clip(logits, 1 - ACCUMULATOR_LIMIT, ACCUMULATOR_LIMIT - 1)
        logits[0] = rng.choice([-(ACCUMULATOR_LIMIT - 1), ACCUMULATOR_LIMIT - 1], size)
        logits[1] = rng.choice([0, -511, -512], size)
        wanted = [frequencies_of(row) for row in logits.astype(np.int64).tolist()]
        for do in every_way():
            found = do.frequency_rows(do.constant(logits.T), do.constant(exp2_table())) + 1
            differ += int(np.count_nonzero(found != wanted))
            cases += found.size
    worst = f"{MAX_ALPHABET * _WEIGHT_ONE:,} summed"
    return _edge("frequencies of a row", cases, worst, f"{MAX_ALPHABET * _WEIGHT_ONE:,}", differ)


def _shares(rng: np.random.Generator) -> Edge:
    """Shares of attention over 1 to 8 states."""
    cases = differ = 0
    for states in range(1, 9):
        scores = np.round(rng.normal(size=(states, _SHARES // 8)) * rng.choice([0, 3, 30, 300, 1e6], _SHARES // 8))
        scores = np.clip(scores, 1 - ACCUMULATOR_LIMIT, ACCUMULATOR_LIMIT - 1)
        weights = [[exact.exp2w(max(column) - v) for v in column] for column in scores.astype(np.int64).T.tolist()]
        wanted = np.array([[256 * w // sum(column) for w in column] for column in weights]).T
        for do in every_way():
            found = np.asarray(do.shares(do.constant(scores), do.constant(exp2_table())))
            differ += int(np.count_nonzero(found != wanted))
            cases += found.size
    return _edge("shares of attention", cases, f"{8 * _WEIGHT_ONE:,} summed", f"{8 * _WEIGHT_ONE:,}", differ)
