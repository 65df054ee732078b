"""The evaluator: the integers of the oracle."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from conformance.writer.oracle import Oracle, frequencies_of
from fuzz.testing import network_rows
from scarfmt.arrays import I64
from scarfmt.neural.evaluator import Evaluator, frequency_rows
from scarfmt.neural.network import Inputs
from tests.neural.networks import Case, cases, random_books, random_network
from tests.samples.codec_samples import refuses

INPUTS = Inputs(classes=2, own=True, attributes=3, depths=1, latents=2, latent_shift=1, grid=2)


def context_of(evaluator: Evaluator, x: I64, codes: I64) -> Any:
    """y of the stage after those in `codes`, (n, stages known)."""
    state = evaluator.start(len(x))
    for stage, column in enumerate(codes.T, start=1):
        state = evaluator.advance(state, stage, column)
    return evaluator.mix(evaluator.embed(x), state)


def oracle_rows(case: Case, x: I64, codes: I64) -> list[Any]:
    """Frequencies of the next symbol, computed one anchor at a time."""
    oracle = Oracle(case.network, case.books.coarse.tolist(), case.books.residual.tolist())
    pairs = zip(x.tolist(), codes.tolist(), strict=True)
    return [oracle.top(int(codes.shape[1] > 0), oracle.context(a, b)) for a, b in pairs]


@st.composite
def questions(draw: st.DrawFn) -> tuple[Case, I64, I64]:
    """A network, inputs (ordinary and extreme), and the indices known so far."""
    case = draw(cases())
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.integers(1, 5))
    top = draw(st.sampled_from([1, 100, case.network.amax, 1 << 40]))
    x = rng.integers(-top, top + 1, (count, case.network.inputs.width))
    if draw(st.booleans()):
        x = np.where(x < 0, -top, top)
    known = draw(st.integers(0, case.stages - 1))
    sizes = [case.books.sizes[stage > 0] for stage in range(known)]
    codes = np.array([rng.integers(0, size, count) for size in sizes], np.int64).reshape(known, count).T
    return case, x, codes


@settings(max_examples=120)
@given(questions())
def test_frequencies_are_those_of_the_oracle(question: tuple[Case, I64, I64]) -> None:
    """Networks of every kind, up to the edge of the accumulators; extreme inputs."""
    case, x, codes = question
    evaluator, book = Evaluator(case.network, case.books), int(codes.shape[1] > 0)
    found = network_rows.frequency_rows(evaluator, book, context_of(evaluator, x, codes)) + 1
    assert found.tolist() == oracle_rows(case, x, codes)


@settings(max_examples=40)
@given(questions(), st.sampled_from([np.int16, np.int32, np.int64]))
def test_selecting_anchors_between_stages_changes_nothing(question: tuple[Case, I64, I64], dtype: type) -> None:
    """A subset of the anchors, taken from embeddings and states, has the rows it has alone."""
    case, x, codes = question
    x = np.clip(x, -999, 999)
    rows = np.arange(len(x))[::2]
    evaluator = Evaluator(case.network, case.books)
    state, h = evaluator.start(len(x)), evaluator.embed(x.astype(dtype))
    for stage, column in enumerate(codes.T, start=1):
        state = evaluator.advance(state, stage, column)
    some = evaluator.mix(h[rows], evaluator.take(state, rows))
    alone = context_of(evaluator, x[rows], codes[rows])
    assert np.array_equal(np.asarray(some), np.asarray(alone))


def test_rows_of_many_anchors_are_those_of_each() -> None:
    """More than are worked on at once, of a book so large that few are."""
    rng = np.random.default_rng(2)
    books = random_books(rng, 4096, 9, 4)
    evaluator = Evaluator(random_network(rng, books, INPUTS), books)
    x = rng.integers(-300, 300, (100, INPUTS.width))
    y = context_of(evaluator, x, np.zeros((100, 0), np.int64))
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
