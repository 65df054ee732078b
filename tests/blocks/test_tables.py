"""Records of the TABLES block (SPEC §8.3), read at once and one by one, and the tables that are worth sending."""

from __future__ import annotations

import tracemalloc
from contextlib import nullcontext
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from scarfmt.blocks import tables as tables_block
from scarfmt.blocks.tables import MAX_TABLES, fit_table, pack_table, pack_tables, unpack_tables
from scarfmt.container.bytefields import ByteReader, signed_varint, unsigned_varint
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import MAX_ALPHABET
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import LimitExceeded, ScarError
from tests.samples.codec_samples import refuses

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
    return SymbolTable(np.array(alphabet, np.int64), np.array(weights, np.int64))


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


@pytest.mark.parametrize("payload", [unsigned_varint(MAX_TABLES + 1), b"\x01\x05" + unsigned_varint(MAX_ALPHABET + 1)])
def test_too_many_tables_or_symbols_pass_a_limit(payload: bytes) -> None:
    """Counts are refused before their records are read."""
    with pytest.raises(LimitExceeded):
        unpack_tables(payload)


@settings(max_examples=300)
@given(st.binary(max_size=60))
def test_garbage_is_a_table_block_or_refused(payload: bytes) -> None:
    """An accepted block packs to the same bytes: a record has one form."""
    try:
        found = unpack_tables(payload)
    except ScarError:
        return
    assert pack_tables(found) == payload


@settings(deadline=None)
@given(ALPHABETS, st.data())
def test_the_fitted_table_is_never_dearer_than_the_uniform_one(alphabet: list[int], data: st.DataObject) -> None:
    """The cost is that of the table's bytes plus coding. The fitted table is compared with equal weights and with the
    counts themselves."""
    sizes = st.one_of(st.integers(1, 9), st.integers(1, 1 << 20))
    counts = np.array(data.draw(st.lists(sizes, min_size=len(alphabet), max_size=len(alphabet))), np.int64)
    values = np.array(alphabet, np.int64)
    table = fit_table(values, counts)
    uniform = SymbolTable(values, np.ones(len(values), np.int64))

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
    """An inherited table that cannot code a layer is therefore never kept."""
    table = fit_table(np.array([-5, 0, 7]), np.array([1, 2, 3]))
    assert np.isfinite(table.cost_of_counts(np.array([-5, 7]), np.array([9, 9])))
    for missing in (-6, -4, 8):
        assert table.cost_of_counts(np.array([missing]), np.array([1])) == float("inf")


def table_blocks(payload: bytes, at_once: bool) -> Any:
    """The result or the refusal of `unpack_tables` for a payload, with the fast way or without."""
    fast = nullcontext() if at_once else patch("scarfmt.blocks.tables._unpack_sound", return_value=None)
    try:
        with fast:
            found = unpack_tables(payload)
    except ScarError as error:
        return type(error), error.refusal, error.message, error.field
    return [
        (key, *((array.dtype.str, array.tolist()) for array in (table.alphabet, table.weights)))
        for key, table in found.items()
    ]


def check_both_ways(payload: bytes) -> bool:
    """Equal tables or refusals both ways; whether the fast way took it, which it does exactly if it is sound."""
    slow = table_blocks(payload, at_once=False)
    assert table_blocks(payload, at_once=True) == slow
    taken = tables_block._unpack_sound(payload) is not None
    assert taken == isinstance(slow, list)
    return taken


# The ends of what the numbers of a record may be, and what lies beyond.
_NUMBERS = sorted(
    {max((1 << bits) + apart, 0) for bits in (0, 7, 12, 14, 16, 24, 31, 32, 33, 35, 56, 62) for apart in (-2, -1, 0, 1)}
)


@st.composite
def table_numbers(draw: st.DrawFn) -> list[int]:
    """The integers of a payload, of which few or none are changed."""
    payload = pack_tables(draw(st.dictionaries(KEYS, tables(), max_size=4)))
    reader, numbers = ByteReader(payload, "x"), list[int]()
    while reader.position < len(payload):
        numbers.append(reader.unsigned(33))
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, len(numbers) - 1))
        new = draw(st.lists(st.one_of(st.sampled_from(_NUMBERS), st.integers(0, 6)), max_size=2))
        numbers[at : at + draw(st.integers(0, 1))] = new
        numbers = numbers or [0]
    return numbers


@settings(deadline=None, max_examples=400)
@given(table_numbers())
@example([])
@example([0])
@example([0, 0])
@example([1, 5, 1, 0, 1])
@example([1, 5, 1, (1 << 32) - 2, 1])
@example([1, 5, 1, (1 << 32) - 1, 1])
@example([1, 5, 2, (1 << 32) - 3, (1 << 32) - 3, 1, (1 << 24) - 1])
@example([1, 5, 2, (1 << 32) - 3, (1 << 32) - 2, 1, 1])
@example([2, 5, 1, 0, 1, 5, 1, 0, 1])
@example([MAX_TABLES + 1])
def test_records_of_any_numbers_are_read_alike_at_once_and_one_by_one(numbers: list[int]) -> None:
    """Sound ones at once; what breaks a rule is refused as it is when read number by number."""
    check_both_ways(b"".join(map(unsigned_varint, numbers)))


@settings(deadline=None, max_examples=400)
@given(st.dictionaries(KEYS, tables(), max_size=4), st.data())
def test_damaged_records_are_read_alike_at_once_and_one_by_one(
    wanted: dict[TableKey, SymbolTable], data: st.DataObject
) -> None:
    """Bytes changed, left out, put in; over-long integers among them."""
    payload = bytearray(pack_tables(wanted))
    assert check_both_ways(bytes(payload))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(payload)))
        new = data.draw(
            st.one_of(st.binary(max_size=2), st.sampled_from([b"\x80", b"\x80\0", b"\xff", b"\0", b"\x7f"]))
        )
        payload[at : at + data.draw(st.integers(0, 2))] = new
    check_both_ways(bytes(payload))


def test_the_largest_tables_are_read_alike() -> None:
    """4096 symbols from end to end; many small tables; and more than is read at once."""
    rng = np.random.default_rng(3)
    wide = np.unique(np.concatenate([rng.integers(-EDGE, EDGE, MAX_ALPHABET), [-EDGE, EDGE]]))[-MAX_ALPHABET:]
    large = SymbolTable(wide, rng.integers(1, 1 << 24, MAX_ALPHABET))
    assert check_both_ways(pack_tables({KEY: large}))
    small = SymbolTable(np.array([-1, 0, 1]), np.array([1, 2, 3]))
    many = {TableKey.from_number(number): small for number in range(3000)}
    assert check_both_ways(pack_tables({**many, TableKey(255, 255, 255, 255): large}))
    payload = pack_tables({KEY._replace(context=context): large for context in range(256)})
    assert len(payload) > 1 << 20
    assert tables_block._unpack_sound(payload) is None
    assert len(table_blocks(payload, at_once=True)) == 256


def test_a_long_payload_of_no_tables_costs_little() -> None:
    """Megabytes of zeros, a few hundred bytes of a file: refused before all of them are parsed."""
    payload = bytes(16 << 20)
    tracemalloc.start()
    refuses("payload-long", lambda: unpack_tables(payload))
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()
