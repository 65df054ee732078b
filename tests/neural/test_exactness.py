"""Integers of networks stay exact where no vector goes: at the bounds, for very many values, whatever is at once."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from conformance.writer.oracle import frequencies_of
from fuzz.testing import network_rows
from fuzz.testing.networks import random_books, random_network
from scarfmt.limits import MAX_LOCAL_BITS
from scarfmt.neural.arithmetic import Linear, amplitude, half_step, round_shift
from scarfmt.neural.context import FINE_LIMIT, Cells, CellSums, depth_shifts, joining_depths
from scarfmt.neural.evaluator import Evaluator, frequency_rows
from scarfmt.neural.grid import GridLevel, HashGrid
from scarfmt.neural.network import Inputs
from tests.samples.codec_samples import refuses

INPUTS = Inputs(classes=2, own=True, attributes=3, depths=1, latents=2, latent_shift=1, grid=2)


@given(st.integers(0, 2**32 - 1), st.integers(8, 12), st.integers(0, 23), st.integers(1, 70))
def test_layers_at_the_bound_compute_the_integers(seed: int, bits: int, shift: int, columns: int) -> None:
    """Every row reaches 2^24 - 1 with its rounding, for random inputs and those that drive it there."""
    rng, amax = np.random.default_rng(seed), amplitude(bits)
    top = min(32767, (2**24 - 1 - half_step(shift)) // (amax * columns))
    weights = rng.integers(-top, top + 1, (5, columns)).astype(np.int32)
    room = 2**24 - 1 - half_step(shift) - np.abs(weights.astype(np.int64)).sum(axis=1) * amax
    layer = Linear(weights, room * rng.choice([-1, 1], 5), shift)
    layer.check(amax)
    signs = np.sign(layer.weights) * np.sign(layer.biases)[:, None]
    x = np.concatenate([rng.integers(-amax, amax + 1, (20, columns)), signs * amax, -signs * amax])
    exact = round_shift(x @ layer.weights.T.astype(np.int64) + layer.biases, shift)
    assert layer.round(x).tolist() == exact.tolist()


@given(st.lists(st.integers(0, 8**6 - 1), min_size=1, max_size=60).map(sorted), st.integers(1, 70))
def test_the_depth_is_the_least_with_cells_full_enough(codes: list[int], target: int) -> None:
    """Counted as in SPEC §10.2: cells(e) * target <= anchors."""
    fits = (e for e in range(6) if len({code >> 3 * e for code in codes}) * target <= len(codes))
    assert depth_shifts(np.array(codes, np.uint64), 6, (target,)) == [next(fits, 6)]


def test_depths_of_nothing_and_of_the_largest_codes() -> None:
    """No anchors: depth 0. Codes of all 63 bits: the last depth joins them."""
    assert depth_shifts(np.zeros(0, np.uint64), 9, (24, 3)) == [0, 0]
    ends = np.array([0, 2**63 - 1], np.uint64)
    assert joining_depths(ends).tolist() == [MAX_LOCAL_BITS]
    assert depth_shifts(ends, MAX_LOCAL_BITS, (3, 2, 1)) == [21, 21, 0]


def test_a_cell_of_very_many_large_values_stays_exact() -> None:
    """The largest sums a file can ask for: 2^20 anchors at the clamp. Means are nearest integers, ties up."""
    count = 1 << 20
    columns = np.full((count, 1), FINE_LIMIT)
    columns[0] -= 1
    sums = CellSums(Cells(np.zeros(count, np.uint64), [0]), 1)
    sums.add(np.arange(count), columns)
    means, counts = sums.around(np.array([5]))
    total = count * FINE_LIMIT - 1
    assert (means.item(), counts.item()) == ((2 * total + count) // (2 * count), count)


def test_rows_of_many_anchors_are_those_of_each() -> None:
    """More than are worked on at once, of a book so large that few are; inputs beyond activations are the farthest."""
    rng = np.random.default_rng(2)
    books = random_books(rng, 4096, 9, 4)
    evaluator = Evaluator(random_network(rng, books, INPUTS), books)
    x = rng.integers(-300, 300, (100, INPUTS.width))
    y = evaluator.mix(evaluator.embed(x), evaluator.start(len(x)))
    far = np.where(x < 0, -1, 1) * evaluator.network.amax
    assert np.array_equal(evaluator.embed(far * (1 << 30)), evaluator.embed(far))
    assert len(list(evaluator.frequency_blocks(0, y))) > 1
    for row, weights in enumerate(network_rows.frequency_rows(evaluator, 0, y)):
        alone = network_rows.frequency_rows(evaluator, 0, y[row : row + 1])
        assert weights.tolist() == alone[0].tolist()


@pytest.mark.parametrize("size", [2, 300, 4096])
def test_sums_of_many_weights_are_exact(size: int) -> None:
    """Weights of 1 among weights of 2^16: what binary32 would lose once sums pass 2^24; equal and extreme logits."""
    rng = np.random.default_rng(size)
    logits = rng.choice([0, 0, 0, -1, -40, -500, -511, -512], (6, size)).astype(np.float32)
    logits[:, 0] = 0
    logits[3:5], logits[5] = [[0], [-(2**24) + 1]], -(2**24) + 1
    logits[5, size // 2] = 2**24 - 1
    found = frequency_rows(logits) + 1
    assert found.tolist() == [frequencies_of(row) for row in logits.astype(int).tolist()]


def test_indices_that_do_not_follow_are_refused() -> None:
    """Another stage, another number of indices, and a token after the last stage are refused."""
    rng = np.random.default_rng(1)
    books = random_books(rng, 8, 8, 4)
    evaluator = Evaluator(random_network(rng, books, INPUTS, stages=2), books)
    one = evaluator.advance(evaluator.start(3), 1, np.zeros(3, np.int64))
    for state, stage, count in ((evaluator.start(3), 2, 3), (evaluator.start(3), 1, 2), (one, 2, 3)):
        refuses("input-stage", partial(evaluator.advance, state, stage, np.zeros(count, np.int64)))


def test_chunks_and_order_of_positions_in_a_grid_do_not_matter() -> None:
    """Sorted or shuffled, at once or one by one: an anchor's features are its own."""
    rng = np.random.default_rng(5)
    levels = GridLevel(0, 9, 8, 3), GridLevel(2, 40, 12, 4), GridLevel(6, 33, 6, 1)
    bits = tuple(rng.integers(0, 2, (level.entries, level.features)).astype(np.uint8) for level in levels)
    grid = HashGrid((3, 0, 9), 10, levels, bits)
    positions = rng.integers(0, 1030, (20000, 3))
    features = grid.features(positions)
    order = np.lexsort(positions.T)
    assert np.array_equal(grid.features(positions[order]), features[order])
    assert all(
        np.array_equal(grid.features(positions[row : row + 1])[0], features[row]) for row in range(0, 20000, 997)
    )
    assert grid.features(positions[:0]).shape == (0, grid.width)
