"""rANS: what is coded comes back, tables follow the exact formula, streams are canonical."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from scarfmt.entropy import rans
from scarfmt.entropy.rans import (
    MAX_ALPHABET,
    TOTAL,
    FrequencyTable,
    RansDecoder,
    RansEncoder,
    make_uniform,
    uniform_table,
)
from scarfmt.errors import Malformed
from tests.samples.codec_samples import refuses

Groups = list[tuple[FrequencyTable, list[int]]]

WEIGHTS = st.lists(st.integers(0, 1 << 24), min_size=1, max_size=40).filter(any)
TABLES = st.one_of(
    st.builds(lambda weights: FrequencyTable.from_weights(np.array(weights)), WEIGHTS),
    st.sampled_from([1, 2, 3, 16, 4095, 4096]).map(uniform_table),
)


@st.composite
def symbol_groups(draw: st.DrawFn) -> Groups:
    """A few tables with symbols to code by each."""
    tables = draw(st.lists(TABLES, max_size=4))
    return [(t, draw(st.lists(st.integers(0, len(t) - 1), max_size=30))) for t in tables]


def encoded(groups: Groups) -> bytes:
    encoder = RansEncoder()
    for table, symbols in groups:
        encoder.encode(np.array(symbols, np.int32), table)
    return encoder.finish()


def outcome(decoder: RansDecoder, groups: Groups) -> tuple[list[list[int]], str]:
    """The outcome of decoding a stream: symbols, and the refusal of its seal or ``""``."""
    symbols = [decoder.decode(table, len(like)).tolist() for table, like in groups]
    try:
        decoder.finish()
    except Malformed as error:
        return symbols, error.refusal
    return symbols, ""


@settings(deadline=None, max_examples=300)
@given(symbol_groups(), st.lists(st.integers(0, 2**32 - 1), max_size=12), st.integers(1, 2**32 - 1))
def test_only_canonical_streams_are_accepted(groups: Groups, words: list[int], last: int) -> None:
    """An accepted stream is what the encoder makes of its symbols."""
    for stream in ([], [*words, last], [last]):
        data = np.array(stream, "<u4").tobytes()
        symbols, refusal = outcome(RansDecoder(data), groups)
        if not refusal:
            assert encoded([(table, part) for (table, _), part in zip(groups, symbols, strict=True)]) == data


@st.composite
def symbol_rows(draw: st.DrawFn) -> list[tuple[list[int], NDArray[np.float64]]]:
    """Groups of symbols with a table each, as rows of frequencies minus 1."""
    groups = []
    for size in draw(st.lists(st.sampled_from([1, 2, 3, 40, 4096]), max_size=3)):
        rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
        symbols = draw(st.lists(st.integers(0, size - 1), max_size=8))
        skew = draw(st.sampled_from([1, 20, 300]))
        rows = [FrequencyTable.from_weights((rng.random(size) ** skew * 65536).astype(np.int64) + 1) for _ in symbols]
        frequencies = np.array([row.frequencies for row in rows], np.float64).reshape(len(symbols), size)
        groups.append((symbols, frequencies - 1))
    return groups


@settings(deadline=None, max_examples=150)
@given(symbol_rows(), symbol_groups())
def test_rows_are_tables_of_one_symbol_each(rows: list[tuple[list[int], NDArray[np.float64]]], groups: Groups) -> None:
    """The symbols come back. The bytes equal those of one table for each symbol; tables and rows can be
    mixed."""
    by_rows, by_tables = RansEncoder(), RansEncoder()
    for symbols, weights in rows:
        by_rows.encode_rows(np.array(symbols, np.int64), weights)
        for symbol, row in zip(symbols, weights, strict=True):
            by_tables.encode(np.array([symbol]), FrequencyTable(row.astype(np.int64) + 1))
    for table, symbols in groups:
        by_rows.encode(np.array(symbols, np.int32), table)
        by_tables.encode(np.array(symbols, np.int32), table)
    data = by_rows.finish()
    assert data == by_tables.finish()
    decoder = RansDecoder(data)
    assert [decoder.decode_rows(weights).tolist() for _, weights in rows] == [symbols for symbols, _ in rows]
    assert outcome(decoder, groups) == ([symbols for _, symbols in groups], "")


@pytest.mark.parametrize(
    "rows",
    [
        [[TOTAL - 2, 1]],
        [[TOTAL - 1, -1]],
        [[TOTAL - 2.5, 0.5]],
        [[TOTAL - 2, 0], [TOTAL - 2, 0]],
        [TOTAL - 2, 0],
        [[]],
        [[np.nan, 0]],
    ],
    ids=str,
)
def test_rows_that_are_no_tables_are_refused(rows: object) -> None:
    """A wrong sum, a negative or broken number, a wrong shape."""
    refuses("input-table", lambda: RansEncoder().encode_rows(np.array([0]), np.array(rows, np.float64)))


@settings(deadline=None, max_examples=200)
@given(WEIGHTS)
@example([1, (1 << 39) - 2])
@example([(1 << 39) - 2, 1])
@example([(1 << 39) - 1])
@example([0] * (MAX_ALPHABET - 1) + [(1 << 39) - 1])
@example([(1 << 27) - 1] * MAX_ALPHABET)
@example([1, 0])
def test_frequencies_are_the_exact_formula(weights: list[int]) -> None:
    """c_i = floor(C_i * (2^24 - n) / C_n) + i in unbounded integers (SPEC §8.1), and nothing has frequency 0."""
    n, total = len(weights), sum(weights)
    prefix = [sum(weights[:i]) for i in range(n + 1)] if n < 100 else [0, *np.cumsum(weights).tolist()]
    cumulative = [c * (TOTAL - n) // total + i for i, c in enumerate(prefix)]
    table = FrequencyTable.from_weights(np.array(weights))
    assert table.cumulative.tolist() == cumulative
    assert int(table.frequencies.min()) >= 1
    assert cumulative[-1] == TOTAL


@pytest.mark.parametrize(
    "weights", [[], [0], [0, 0], [-1, 5], [1 << 39], [1 << 38, 1 << 38], [1] * (MAX_ALPHABET + 1)], ids=str
)
def test_weights_that_make_no_table_are_refused(weights: list[int]) -> None:
    """Empty, all zero, negative, a sum from 2^39 on, too many."""
    refuses("input-table", lambda: FrequencyTable.from_weights(np.array(weights, np.int64)))


@pytest.mark.parametrize("frequencies", [[], [0, TOTAL], [TOTAL - 1], [1, TOTAL], [-1, TOTAL + 1]], ids=str)
def test_frequencies_that_break_the_rule_are_refused(frequencies: list[int]) -> None:
    """Each at least 1, the sum exactly 2^24."""
    refuses("input-table", lambda: FrequencyTable(np.array(frequencies, np.int64)))


@pytest.mark.parametrize("symbol", [-1, 2])
def test_symbols_outside_the_alphabet_are_not_coded(symbol: int) -> None:
    """The encoder refuses what no decoder could return, by a table and by a row."""
    refuses("input-symbol", lambda: RansEncoder().encode(np.array([0, symbol]), uniform_table(2)))
    refuses("input-symbol", lambda: RansEncoder().encode_rows(np.array([symbol]), np.array([[TOTAL - 2.0, 0]])))


def test_uniform_tables_kept_are_few() -> None:
    """All 4095 sizes with their models would hold more than 200 MiB."""
    for size in range(2, 4097, 7):
        assert len(make_uniform(size)) == size
    assert make_uniform.cache_info().currsize <= 128


@settings(deadline=None, max_examples=60)
@given(symbol_groups())
def test_the_library_and_python_code_the_same(groups: Groups) -> None:
    """Where there is no C library, ten lines of Python give the same words."""
    with mock.patch.object(rans, "library", return_value=None):
        plain = encoded(groups)
    assert plain == encoded(groups)
