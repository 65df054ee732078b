"""Tables, their records, and the grouping of symbols by table."""

from __future__ import annotations

import numpy as np
import pytest
from codec_samples import Recorder, coded, emitting, refuses
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from scarfmt.bytefields import signed_varint, unsigned_varint
from scarfmt.errors import InvalidInput, LimitExceeded, Malformed, ScarError
from scarfmt.rans import MAX_ALPHABET, PureRansDecoder
from scarfmt.symbols import (
    MAX_TABLES,
    Emitter,
    SymbolCounter,
    SymbolReader,
    SymbolRecorder,
    SymbolTable,
    SymbolWriter,
    TableKey,
    cached_uniform,
    emit_by_context,
    fit_table,
    pack_table,
    pack_tables,
    read_by_context,
    unpack_tables,
)

EDGE = 2**31 - 1
KEY = TableKey(3, 1, 2, 7)

ALPHABETS = st.lists(
    st.one_of(st.integers(-20, 20), st.integers(-EDGE, EDGE), st.sampled_from([-EDGE, EDGE])),
    min_size=1,
    max_size=30,
    unique=True,
).map(sorted)
KEYS = st.builds(TableKey, *[st.integers(0, 255)] * 4)


@st.composite
def tables(draw: st.DrawFn) -> SymbolTable:
    alphabet = draw(ALPHABETS)
    weights = draw(st.lists(st.integers(1, (1 << 24) - 1), min_size=len(alphabet), max_size=len(alphabet)))
    return SymbolTable.from_weights(np.array(alphabet, np.int64), np.array(weights, np.int64))


@given(KEYS, KEYS)
def test_keys_are_ordered_as_their_numbers(a: TableKey, b: TableKey) -> None:
    """The order of a TABLES block is that of the key's fields, and a number names one key."""
    assert TableKey.from_number(a.number) == a
    assert (a < b) == (a.number < b.number)


@settings(deadline=None)
@given(st.dictionaries(KEYS, tables(), max_size=4))
def test_tables_come_back(wanted: dict[TableKey, SymbolTable]) -> None:
    """Sparse alphabets with outliers at the ends of 32 bits, any weights below 2^24."""
    found = unpack_tables(pack_tables(wanted))
    assert sorted(found) == sorted(wanted)
    for key, table in wanted.items():
        assert found[key].alphabet.tolist() == table.alphabet.tolist()
        assert found[key].weights.tolist() == table.weights.tolist()
        assert found[key].table.frequencies.tolist() == table.table.frequencies.tolist()


def record(
    number: int = 5, first: int = 0, gaps: tuple[int, ...] = (0,), weights: tuple[int, ...] = (1, 2), size: int = 2
) -> bytes:
    parts = [unsigned_varint(number), unsigned_varint(size), signed_varint(first)]
    return b"".join(parts + [unsigned_varint(n) for n in (*gaps, *weights)])


def test_the_hand_made_record_is_readable() -> None:
    """The refusals below are for what was crafted, nothing else."""
    table = unpack_tables(b"\x01" + record(first=-3, gaps=(4,)))[TableKey.from_number(5)]
    assert table.alphabet.tolist() == [-3, 2]
    assert table.weights.tolist() == [1, 2]


@pytest.mark.parametrize(
    ("payload", "refusal"),
    [
        (b"\x02" + record(5) + record(5), "bad-table"),
        (b"\x02" + record(6) + record(5), "bad-table"),
        (b"\x01" + record(size=0, gaps=(), weights=()), "bad-table"),
        (b"\x01" + record(weights=(0, 5)), "bad-table"),
        (b"\x01" + record(first=-(2**31)), "bad-table"),
        (b"\x01" + record(first=2**31, gaps=(), weights=(1,), size=1), "bad-table"),
        (b"\x01" + record(first=EDGE), "bad-table"),
        (b"\x01" + record(first=0, gaps=(2**32 - 1,)), "bad-table"),
        (b"\x01" + record(gaps=(2**32,)), "bad-varint"),
        (b"\x01" + record(weights=(1, 1 << 24)), "bad-varint"),
        (b"\x01" + record(number=1 << 32), "bad-varint"),
        (b"\x01" + record()[:-1] + b"\x82\x00", "bad-varint"),
        (b"\x01" + record()[:-1], "payload-short"),
        (b"\x01" + record() + b"\0", "payload-long"),
        (b"\x02" + record(), "payload-short"),
        (b"", "payload-short"),
    ],
)
def test_records_that_break_the_rule_are_refused(payload: bytes, refusal: str) -> None:
    """Order and uniqueness of keys, range of values and weights, canonical varints, exact length."""
    refuses(refusal, lambda: unpack_tables(payload))


@pytest.mark.parametrize("size", [3, 100])
def test_of_several_faults_the_first_in_the_content_is_refused(size: int) -> None:
    """SPEC §12.2, in short tables and in those read many numbers at once."""
    zeros, ones = (0,) * (size - 2), (1,) * (size - 2)
    refuses("bad-table", lambda: unpack_tables(b"\x01" + record(5, 0, (0, *zeros), (*ones, 0, 1 << 24), size)))
    refuses("bad-varint", lambda: unpack_tables(b"\x01" + record(5, 0, (0, *zeros), (*ones, 1 << 24, 0), size)))
    refuses("bad-table", lambda: unpack_tables(b"\x01" + record(5, 1 << 31, (1 << 32, *zeros), (), size)))
    refuses("bad-table", lambda: unpack_tables(b"\x01" + record(5, 0, (EDGE,), (), size)))
    refuses("payload-short", lambda: unpack_tables(b"\x01" + record(5, 0, (EDGE - 1,), (), size)))


@pytest.mark.parametrize(
    "payload", [unsigned_varint(MAX_TABLES + 1), b"\x01\x05" + unsigned_varint(MAX_ALPHABET + 1)]
)
def test_too_many_tables_or_symbols_pass_a_limit(payload: bytes) -> None:
    """Counts are refused before their records are read."""
    with pytest.raises(LimitExceeded):
        unpack_tables(payload)


@settings(max_examples=300)
@given(st.binary(max_size=60))
def test_garbage_is_a_table_block_or_refused(payload: bytes) -> None:
    """What is accepted packs to the same bytes: a record has one form."""
    try:
        found = unpack_tables(payload)
    except ScarError:
        return
    assert pack_tables(found) == payload


@settings(deadline=None)
@given(ALPHABETS, st.data())
def test_the_fitted_table_is_never_dearer_than_the_uniform_one(alphabet: list[int], data: st.DataObject) -> None:
    """Its own bytes plus the coding cost, against equal weights and against the counts themselves."""
    sizes = st.one_of(st.integers(1, 9), st.integers(1, 1 << 20))
    counts = np.array(data.draw(st.lists(sizes, min_size=len(alphabet), max_size=len(alphabet))), np.int64)
    values = np.array(alphabet, np.int64)
    table = fit_table(values, counts)
    uniform = SymbolTable.from_weights(values, np.ones(len(values), np.int64))

    def cost(of: SymbolTable) -> float:
        return of.cost_of_counts(values, counts) + 8 * len(pack_table(KEY, of))

    assert cost(table) <= cost(uniform) + 1e-6 * float(counts.sum())
    assert table.alphabet.tolist() == alphabet


def test_a_fitted_table_is_near_the_entropy() -> None:
    """With many symbols the loss to the empirical entropy, table included, is under 2 %."""
    counts = np.array([50000, 20000, 9000, 4000, 500, 20, 1], np.int64)
    values = np.array([0, -1, 1, 2, -2, 9, 30000], np.int64)
    order = np.argsort(values)
    values, counts = values[order], counts[order]
    entropy = float(-(counts * np.log2(counts / counts.sum())).sum())
    table = fit_table(values, counts)
    assert table.cost_of_counts(values, counts) + 8 * len(pack_table(KEY, table)) < 1.02 * entropy


def test_the_cost_of_a_value_without_a_symbol_is_infinite() -> None:
    """So an inherited table that cannot code a layer is never kept."""
    table = fit_table(np.array([-5, 0, 7]), np.array([1, 2, 3]))
    assert np.isfinite(table.cost_of_counts(np.array([-5, 7]), np.array([9, 9])))
    for missing in (-6, -4, 8):
        assert table.cost_of_counts(np.array([missing]), np.array([1])) == float("inf")


def put_contexts(emitter: Emitter, contexts: NDArray[np.int64], values: NDArray[np.int64]) -> None:
    emit_by_context(emitter, KEY, contexts, values)


def test_groups_go_by_ascending_context_and_keep_their_order() -> None:
    """SPEC §8.4: the stream holds each context's symbols together, anchors in order."""
    recorder = Recorder()
    put_contexts(recorder, np.array([9, 0, 255, 9, 0, 9]), np.array([1, 2, 3, 4, 5, 6]))
    expected = [(KEY._replace(context=c), v) for c, v in ((0, [2, 5]), (9, [1, 4, 6]), (255, [3]))]
    assert recorder.groups == expected


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 255), st.integers(-EDGE, EDGE)), max_size=60))
def test_values_come_back_from_their_contexts(pairs: list[tuple[int, int]]) -> None:
    """Through both decoders, whatever the contexts and values."""
    contexts, values = np.array([p[0] for p in pairs], np.int64), np.array([p[1] for p in pairs], np.int64)
    data, fitted = coded(lambda emitter: put_contexts(emitter, contexts, values))
    for reader in (SymbolReader(data, fitted), SymbolReader(data, fitted, PureRansDecoder(data))):
        assert read_by_context(reader, KEY, contexts).tolist() == values.tolist()
        reader.finish()


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


def test_a_recorder_codes_later_what_a_writer_codes_at_once() -> None:
    """The same bytes, and the counter hears of every group that needs a table."""
    rng = np.random.default_rng(6)
    static, uniform = rng.geometric(0.4, 300), rng.integers(0, 100, 200)
    counter = SymbolCounter()
    recorder = SymbolRecorder(counter)
    recorder.emit(KEY, static)
    recorder.emit_uniform(100, uniform)
    recorder.settle()
    table = {KEY: fit_table(*counter.histograms()[KEY])}
    writer = SymbolWriter(table)
    writer.emit(KEY, static)
    writer.emit_uniform(100, uniform)
    assert recorder.code(table) == writer.finish()


def test_a_recorder_codes_rows_as_soon_as_it_settles() -> None:
    """They come with their frequencies; beside symbols that wait for tables they have no place."""
    weights, symbols = np.full((50, 2), ((1 << 24) - 2) / 2), np.arange(50) % 2
    writer = SymbolWriter({})
    writer.emit_rows(weights, symbols)
    recorder = SymbolRecorder(SymbolCounter())
    recorder.emit_rows(weights, symbols)
    recorder.settle()
    assert recorder.code({}) == writer.finish()
    mixed = SymbolRecorder(SymbolCounter())
    mixed.emit_rows(weights, symbols)
    mixed.emit_uniform(4, symbols)
    with pytest.raises(InvalidInput):
        mixed.settle()


def test_a_missing_table_is_named_and_only_when_needed() -> None:
    """Nothing to read needs no table."""
    reader = emitting((KEY, [1, 2]))
    other = KEY._replace(context=8)
    assert reader.read(other, 0).tolist() == []
    refuses("missing-table", lambda: reader.read(other, 1))


def test_symbols_left_in_a_stream_break_the_seal() -> None:
    """A stream that holds more than was asked for is not accepted."""
    reader = emitting((KEY, [1, 2, 3, 1, 3]))
    reader.read(KEY, 4)
    with pytest.raises(Malformed) as caught:
        reader.finish()
    assert caught.value.refusal == "rans-seal"


def test_uniform_tables_kept_are_few() -> None:
    """All 4095 sizes with their models would hold more than 200 MiB."""
    for size in range(2, 4097, 7):
        assert len(cached_uniform(size)) == size
    assert cached_uniform.cache_info().currsize <= 128
