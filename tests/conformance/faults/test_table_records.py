"""The parts of faults: table records and rANS words with any content."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conformance.faults.table_records import Record, number, packed, rans_words, uniform, unpacked, valued, with_tables
from conformance.scenes.valid_cases import valid_cases
from scarfmt.blocks.tables import unpack_tables
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import PureRansDecoder, uniform_table

WORKED = next(valid_cases()).data
RECORDS = st.lists(
    st.builds(
        lambda key, values: Record(key, tuple(sorted(values)), tuple(range(1, len(values) + 1))),
        st.integers(0, (1 << 32) - 1),
        st.sets(st.integers(-(2**31) + 1, 2**31 - 1), min_size=1, max_size=5),
    ),
    max_size=4,
    unique_by=lambda record: record.key,
).map(lambda records: sorted(records, key=lambda record: record.key))


@given(RECORDS)
def test_records_are_what_the_reader_reads(records: list[Record]) -> None:
    """Key, alphabet and weights, so that a fault is the only thing wrong with a block."""
    content = packed(records)
    assert unpacked(content) == records
    tables = unpack_tables(content)
    assert [key.number for key in tables] == [record.key for record in records]
    for record, table in zip(records, tables.values(), strict=True):
        assert tuple(table.alphabet.tolist()) == record.values
        assert tuple(table.weights.tolist()) == record.weights


def test_the_parts_of_a_key() -> None:
    """The parts of a key are split as the reader splits them."""
    record = Record(number(9, 2, 3, 77), (0,), (1,))
    assert (record.stream, record.component, record.step) == (9, 2, 3)
    assert TableKey.from_number(record.key) == (9, 2, 3, 77)


SYMBOLS = st.integers(2, 4096).flatmap(lambda size: st.tuples(st.just(size), st.integers(0, size - 1)))


@given(st.lists(SYMBOLS, max_size=20))
def test_words_of_chosen_symbols_decode_to_them(symbols: list[tuple[int, int]]) -> None:
    """In order, and end in the empty state."""
    decoder = PureRansDecoder(rans_words(uniform(size, symbol) for size, symbol in symbols))
    assert [int(decoder.decode(uniform_table(size), 1)[0]) for size, _ in symbols] == [symbol for _, symbol in symbols]
    decoder.finish()


def test_a_change_of_tables_that_changes_nothing_is_an_error() -> None:
    """Else a vector would be valid although it claims to be invalid."""
    with pytest.raises(AssertionError):
        with_tables(WORKED, 1, lambda records: records)
    with pytest.raises(AssertionError):
        valued(Record(0, (1, 2), (1, 1)), 5, 6)
