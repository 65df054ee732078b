"""Counting, recording and writing groups of symbols; what is written is read again."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scarfmt_conformance.reference.observed import LayerRecord

from scarfmt.arrays import Ints
from scarfmt.blocks.tables import fit_table
from scarfmt.container.schema import Stream
from scarfmt.entropy.emitters import Emitter, SymbolCounter, SymbolWriter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.recorded import SymbolRecorder
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import InvalidInput
from scarfmt.observe import ObservedReader
from tests.samples.codec_samples import Recorder, coded, many_groups, refuses

KEY = TableKey(3, 1, 2, 7)


def put_contexts(emitter: Emitter, contexts: NDArray[np.int64], values: NDArray[np.int64]) -> None:
    emitter.emit_by_context(KEY, contexts, values)


def test_groups_go_by_ascending_context_and_keep_their_order() -> None:
    """SPEC §8.4: the stream holds each context's symbols together, anchors in order."""
    recorder = Recorder()
    put_contexts(recorder, np.array([9, 0, 255, 9, 0, 9]), np.array([1, 2, 3, 4, 5, 6]))
    expected = [(KEY._replace(context=c), v) for c, v in ((0, [2, 5]), (9, [1, 4, 6]), (255, [3]))]
    assert recorder.groups == expected


def test_counting_and_coding_agree() -> None:
    """The counter's promise is the writer's size, for static tables and uniform values together."""
    rng = np.random.default_rng(5)
    static, uniform = rng.geometric(0.4, 4000), rng.integers(0, 100, 3000)

    def put(emitter: Emitter) -> None:
        emitter.emit(KEY, static)
        emitter.emit_uniform(100, uniform)
        emitter.emit(KEY, static[:0])

    counter = SymbolCounter()
    put(counter)
    histogram = counter.histograms()[KEY]
    assert int(histogram[1].sum()) == 4000
    table = {KEY: fit_table(*histogram)}
    writer = SymbolWriter(table)
    put(writer)
    bits = counter.uniform_bits + table[KEY].cost_of_counts(*histogram)
    assert abs(8 * len(writer.finish()) - bits) < 70
    reader = SymbolReader(coded(put)[0], table)
    assert reader.read(KEY, 4000).tolist() == static.tolist()
    assert reader.read_uniform(100, 3000).tolist() == uniform.tolist()
    reader.finish()


def test_a_recorder_codes_rows_as_soon_as_it_settles() -> None:
    """Rows come with their frequencies; they have no place beside symbols that wait for tables."""
    weights, symbols = np.full((50, 2), ((1 << 24) - 2) / 2), np.arange(50) % 2
    writer = SymbolWriter({})
    writer.emit_rows(weights, symbols)
    recorder = SymbolRecorder(SymbolCounter())
    recorder.emit_rows(weights, symbols)
    assert recorder.settle().code({}) == writer.finish()
    mixed = SymbolRecorder(SymbolCounter())
    mixed.emit_rows(weights, symbols)
    mixed.emit_uniform(4, symbols)
    with pytest.raises(InvalidInput):
        mixed.settle()


def one_by_one(emitter: Emitter, contexts: Ints, values: Ints) -> None:
    """Each group by itself."""
    for context in np.unique(contexts).tolist():
        emitter.emit(KEY._replace(context=context), values[contexts == context])


def same_histograms(a: SymbolCounter, b: SymbolCounter) -> None:
    """Equal keys in the same order, alphabets and counts of one type."""
    one, other = a.histograms(), b.histograms()
    assert list(one) == list(other) == sorted(one)
    for key, parts in one.items():
        for found, wanted in zip(parts, other[key], strict=True):
            assert found.dtype == wanted.dtype == np.int64
            assert found.tolist() == wanted.tolist()


@settings(deadline=None, max_examples=150)
@given(st.lists(st.tuples(many_groups(), st.booleans()), max_size=5))
def test_what_is_recorded_is_counted_as_each_group_is(calls: list[tuple[tuple[Ints, Ints], bool]]) -> None:
    """Counts are equal for groups of repeated tables, recorded or given one by one, wide and narrow."""
    mixed, plain = SymbolCounter(), SymbolCounter()
    for (contexts, values), recorded in calls:
        one_by_one(plain, contexts, values)
        if recorded:
            recorder = SymbolRecorder(mixed)
            recorder.emit_uniform(4, values[:1] & 3)
            recorder.emit_by_context(KEY, contexts, values)
            recorder.settle()
        else:
            one_by_one(mixed, contexts, values)
    same_histograms(mixed, plain)


@pytest.mark.parametrize("wide", [1, 1 << 15, 1 << 17])
def test_counting_goes_on_where_more_symbols_differ_than_there_is_room_for(wide: int) -> None:
    """Many alphabets of wide values: groups come when the room is used up, and when none was made."""
    rng = np.random.default_rng(wide)
    counter, plain = SymbolCounter(), SymbolCounter()
    for _ in range(6):
        contexts, values = rng.integers(0, 256, 1 << 15), rng.integers(-wide, wide + 1, 1 << 15).astype(np.int32)
        recorder = SymbolRecorder(counter)
        for part in np.split(np.arange(1 << 15), 4):
            recorder.emit_by_context(KEY, contexts[part], values[part])
        recorder.settle()
        plain.emit_by_context(KEY, contexts, values)
    same_histograms(counter, plain)


@pytest.mark.parametrize("value", [1 << 31, -(1 << 31) - 1, 1 << 32, 1 << 33, -(1 << 62)])
def test_values_beyond_32_bits_are_not_counted_as_others(value: int) -> None:
    """Wrapped to 32 bits, such values would be counted as other values."""
    for emitter in (SymbolCounter(), SymbolRecorder(SymbolCounter())):
        with pytest.raises(InvalidInput) as caught:
            emitter.emit_by_context(KEY, np.array([3, 3]), np.array([7, value]))
        assert caught.value.refusal == "input-symbol"


@settings(deadline=None, max_examples=60)
@given(st.lists(many_groups(), max_size=3))
def test_writers_and_recorders_of_many_groups(calls: list[tuple[Ints, Ints]]) -> None:
    """Groups give the same bytes later as at once; a reader finds the values in their places."""
    counter = SymbolCounter()
    recorder = SymbolRecorder(counter)
    for contexts, values in calls:
        recorder.emit_by_context(KEY, contexts, values)
        recorder.emit_uniform(4096, values & 4095)
    recorded = recorder.settle()
    known = {key: fit_table(*histogram) for key, histogram in counter.histograms().items()}
    writer = SymbolWriter(known)
    for contexts, values in calls:
        writer.emit_by_context(KEY, contexts, values)
        writer.emit_uniform(4096, values & 4095)
    data = writer.finish()
    assert data == recorded.code(known)
    reader = SymbolReader(data, known)
    for contexts, values in calls:
        assert reader.read_by_context(KEY, contexts).tolist() == values.tolist()
        assert reader.read_uniform(4096, len(values)).tolist() == (values & 4095).tolist()
    reader.finish()


@pytest.mark.parametrize("table", [{}, {KEY: fit_table(np.array([1, 5]), np.array([1, 1]))}])
def test_symbols_without_a_place_in_a_table_are_not_coded(table: dict[TableKey, SymbolTable]) -> None:
    """They would be coded as others."""
    recorder, writer = SymbolRecorder(SymbolCounter()), SymbolWriter(table)
    recorder.emit(KEY, np.array([1, 3]))
    recorded = recorder.settle()
    refuses("input-symbol", lambda: writer.emit(KEY, np.array([1, 3])))
    refuses("input-symbol", lambda: recorded.code(table))


def test_an_observed_reader_tells_the_frequencies_of_every_group() -> None:
    """A table of one symbol counts, too, although it reads nothing; a group without symbols does not count."""
    key, sure = TableKey(Stream.INDICES, 2, 0, 3), TableKey(Stream.INDICES, 1, 0, 0)
    tables = {key: SymbolTable(np.array([-1, 4]), np.array([3, 1])), sure: SymbolTable(np.array([7]), np.array([5]))}
    writer = SymbolWriter(tables)
    writer.emit(key, np.array([4, -1]))
    writer.emit_uniform(2, np.array([1]))
    record = LayerRecord()
    reader = ObservedReader(writer.finish(), tables, Stream.INDICES, record)
    assert reader.read(sure, 0).tolist() == reader.read_uniform(3, 0).tolist() == []
    assert not record.tables
    assert reader.read(sure, 2).tolist() == [7, 7]
    assert reader.read(key, 2).tolist() == [4, -1]
    assert reader.read_uniform(2, 1).tolist() == [1]
    reader.finish()
    # c_1 = 3 * (2^24 - 2) // 4 + 1
    assert {name: table.tolist() for name, table in record.tables.items()} == {
        "frequencies.INDICES.1": [1 << 24],
        "frequencies.INDICES.2": [12582911, 4194305],
        "frequencies.INDICES": [1 << 23, 1 << 23],
    }
