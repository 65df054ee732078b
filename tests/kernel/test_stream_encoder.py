"""The compiled rANS encoder: on any groups the bytes of the definition, and nothing unsound reaches C (SPEC §8)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from scarfmt.arrays import F64, I64
from scarfmt.entropy.rans import MAX_ALPHABET, PRECISION, FrequencyTable, PureRansDecoder, RansEncoder, uniform_table
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import InvalidInput
from scarfmt.kernel.packed_tables import PackedTables
from scarfmt.kernel.stream_encoder import KernelRansEncoder
from tests.kernel.samples import (
    EXTREME,
    SEEDS,
    frequency_rows,
    library,
    needs_kernel,
    random_rows,
    random_table,
    random_weights,
)

pytestmark = needs_kernel

Feed = Callable[[KernelRansEncoder], Any]
# Symbols that one table codes, or one row each.
Run = tuple[I64, FrequencyTable | F64]


def random_symbols(rng: np.random.Generator, size: int, count: int) -> I64:
    """Any, or all at one end of the table: slot 0 leaves an empty state empty."""
    chosen = [rng.integers(0, size, count), np.zeros(count, np.int64), np.full(count, size - 1)]
    return chosen[int(rng.choice(3, p=[0.6, 0.3, 0.1]))]


def narrowed(rng: np.random.Generator, symbols: I64) -> Any:
    """The same numbers in another type, or every second number of another array."""
    kind = int(rng.integers(4))
    return [symbols, symbols.astype(np.int32), symbols.astype(np.uint16), np.repeat(symbols, 2)[::2]][kind]


def grouped(rng: np.random.Generator, components: int, count: int) -> tuple[Feed, list[Run]]:
    """Values of many tables that take turns, and the runs in which they travel."""
    kinds = rng.choice(rng.integers(0, 256 * components, 12), count)
    made = {kind: random_table(rng, int(rng.choice([1, 2, 3, 40]))) for kind in np.unique(kinds).tolist()}
    packed = PackedTables({(kind // 256, kind % 256): table for kind, table in made.items()}, components)
    values, runs = np.zeros(count, np.int64), list[Run]()
    for kind, table in made.items():
        chosen = np.flatnonzero(kinds == kind)
        runs.append((random_symbols(rng, len(table.alphabet), len(chosen)), table.table))
        values[chosen] = table.alphabet[runs[-1][0]]
    given = narrowed(rng, kinds), values.astype(np.int32) if rng.random() < 0.5 else values
    return lambda encoder: encoder.encode_grouped(packed, *given), runs


def random_group(rng: np.random.Generator, kind: int, size: int, count: int) -> tuple[Feed, list[Run]]:
    """Symbols coded in one of five ways, and what the definition calls it."""
    if kind == 4:
        return grouped(rng, int(rng.choice([1, 3, 64])), count)
    if kind > 1:
        count = min(count, 20_000 // size)
    symbols = random_symbols(rng, size, count)
    given = narrowed(rng, symbols)
    if kind < 2:
        table = uniform_table(size) if kind else FrequencyTable.from_weights(random_weights(rng, size))
        return lambda encoder: encoder.encode(given, table), [(symbols, table)]
    if kind == 2:
        rows = random_rows(rng, count, size)
        other = np.asfortranarray(rows) if rng.random() < 0.5 else rows
        return lambda encoder: encoder.encode_rows(given, other), [(symbols, rows)]
    reach = int(rng.choice([0, 5, 300, 513, 3000]))
    logits = rng.integers(-reach, reach + 1, (size, count)).astype(np.float32)
    turned = np.asfortranarray(logits) if rng.random() < 0.5 else logits
    return lambda encoder: encoder.encode_logits(given, turned), [(symbols, frequency_rows(logits))] if count else []


def check_same_bytes(groups: list[tuple[Feed, list[Run]]]) -> bytes:
    """Check that both encoders make one stream, and that the definition reads it up to its seal."""
    compiled, plain = KernelRansEncoder(library()), RansEncoder()
    for feed, runs in groups:
        feed(compiled)
        for symbols, table in runs:
            if isinstance(table, FrequencyTable):
                plain.encode(symbols, table)
            else:
                plain.encode_rows(symbols, table)
    data = compiled.finish()
    assert data == plain.finish()
    decoder = PureRansDecoder(data)
    for symbols, table in (run for _, runs in groups for run in runs):
        if isinstance(table, FrequencyTable):
            assert decoder.decode(table, len(symbols)).tolist() == symbols.tolist()
        else:
            assert decoder.decode_rows(table).tolist() == symbols.tolist()
    decoder.finish()
    return data


SIZES = st.one_of(st.sampled_from([1, 2, 3, MAX_ALPHABET]), st.integers(1, 50))
GROUPS = st.lists(st.tuples(st.integers(0, 4), SIZES, st.one_of(st.integers(0, 20), st.just(70))), max_size=6)


@settings(deadline=None, max_examples=200)
@given(SEEDS, GROUPS)
@example(0, [])
@example(0, [(kind, 1, 9) for kind in range(4)])
@example(0, [(kind, MAX_ALPHABET, 5) for kind in range(5)])
@example(0, [(kind, 7, 0) for kind in range(5)])
def test_any_groups_give_the_bytes_of_the_definition(seed: int, groups: list[tuple[int, int, int]]) -> None:
    """Static, uniform, rows, logits and many tables in turn; alphabets of one symbol and empty groups among them."""
    rng = np.random.default_rng(seed)
    check_same_bytes([random_group(rng, *group) for group in groups])


@pytest.mark.parametrize("seed", range(3))
def test_long_streams(seed: int) -> None:
    """The streams have hundreds of words."""
    rng = np.random.default_rng(seed)
    groups = [grouped(rng, 64, 3000), *(random_group(rng, kind, 40, 400) for kind in (0, 1, 2, 3))]
    assert len(check_same_bytes(groups)) > 2000


@pytest.mark.parametrize("last", [0, 1])
def test_first_slots_leave_an_empty_state_empty(last: int) -> None:
    """The symbol coded first, at the end of the last group, takes no word while it lies at slot 0 (SPEC §8.2)."""
    table, zeros = uniform_table(2), np.zeros(500, np.int64)

    def feed(symbols: I64) -> tuple[Feed, list[Run]]:
        return lambda encoder: encoder.encode(symbols, table), [(symbols, table)]

    data = check_same_bytes([feed(zeros), feed(np.array([last])), feed(zeros)])
    assert (len(data) == 0) == (last == 0)


def test_words_are_taken_where_the_definition_takes_them() -> None:
    """Frequencies of one slot and of all but one, in turn: states at both ends of their range."""
    rng = np.random.default_rng(4)
    table = FrequencyTable(np.array([1, (1 << PRECISION) - 2, 1]))
    for share in (0.0, 0.01, 0.3, 1.0):
        symbols = np.where(rng.random(3000) < share, rng.choice([0, 2], 3000), 1)
        check_same_bytes([(lambda encoder, given=symbols: encoder.encode(given, table), [(symbols, table)])])


def test_costs_of_logits_are_those_of_their_rows() -> None:
    """In bits; nothing for an alphabet of one symbol."""
    rng = np.random.default_rng(5)
    for size, count in ((1, 5), (2, 0), (2, 33), (40, 70)):
        symbols, logits = rng.integers(0, size, count), rng.integers(-600, 600, (size, count)).astype(np.float32)
        found = KernelRansEncoder(library()).encode_logits(symbols, logits)
        rows = frequency_rows(logits) if count else np.zeros((0, size))
        wanted = PRECISION - np.log2(rows[np.arange(count), symbols] + 1) if size > 1 else np.zeros(count)
        assert found.shape == (count,)
        assert np.allclose(found, wanted)


def refusal(act: Feed, library: Any) -> str:
    """The refusal of `act`, after a check that the stream encoded before is unchanged."""
    encoder = KernelRansEncoder(library)
    with pytest.raises(InvalidInput) as caught:
        act(encoder)
    assert encoder._spans == []
    return caught.value.refusal


# Beyond 16 and 32 bits: wrapped, they would be symbols.
BAD = [-1, 3, EXTREME, 1 << 16, 1 << 32, -(1 << 32), (1 << 32) + 2, -(1 << 63)]


@pytest.mark.parametrize("bad", BAD)
def test_symbols_out_of_range_never_reach_the_library(bad: int) -> None:
    """The library looks symbols up unchecked. A library without functions stands in for it."""
    symbols = np.array([0, bad, 2])
    rows = np.broadcast_to(uniform_table(3).frequencies - 1.0, (3, 3))
    for act in (
        lambda encoder: encoder.encode(symbols, uniform_table(3)),
        lambda encoder: encoder.encode_rows(symbols, rows),
        lambda encoder: encoder.encode_logits(symbols, np.zeros((3, 3), np.float32)),
    ):
        assert refusal(act, object()) == "input-symbol"


@pytest.mark.parametrize("count", [0, 2, 4])
def test_as_many_symbols_as_tables(count: int) -> None:
    """Rows, columns and kinds of fewer symbols, or of more, are not read beyond their end."""
    symbols, packed = np.zeros(3, np.int64), PackedTables({(0, 0): SymbolTable(np.array([0]), np.array([1]))}, 1)
    rows = np.broadcast_to(uniform_table(3).frequencies - 1.0, (count, 3))
    assert refusal(lambda encoder: encoder.encode_rows(symbols, rows), object()) == "input-table"
    logits = np.zeros((3, count), np.float32)
    assert refusal(lambda encoder: encoder.encode_logits(symbols, logits), object()) == "input-table"
    kinds = np.zeros(count, np.uint16)
    assert refusal(lambda encoder: encoder.encode_grouped(packed, kinds, symbols), object()) == "input-symbol"


@pytest.mark.parametrize("fault", [-1.0, 0.5, 1.0, np.nan, np.inf])
def test_rows_that_are_no_frequencies_never_reach_the_library(fault: float) -> None:
    """Such rows are refused with the id of the other encoder."""
    rows = np.broadcast_to(uniform_table(3).frequencies - 1.0, (4, 3)).copy()
    rows[2, 1] += fault
    assert refusal(lambda encoder: encoder.encode_rows(np.zeros(4, np.int64), rows), object()) == "input-table"


def one_table() -> PackedTables:
    """Tables of two components; for the second, only context 3 has a table."""
    return PackedTables({(1, 3): SymbolTable(np.array([-EXTREME, -4, 0, 7, EXTREME]), np.array([1, 2, 3, 4, 5]))}, 2)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        *[(259, value) for value in (-EXTREME - 1, -EXTREME + 1, -5, 1, 6, 8, EXTREME - 1)],
        *[(259, value) for value in ((1 << 32) + 7, 7 - (1 << 32), 1 << 32, 1 << 31, 1 << 62)],
        *[(kind, 7) for kind in (0, 3, 258, 260, 511, 512, 65535, 65536 + 259, 259 - 65536, -1)],
    ],
)
@pytest.mark.parametrize("first", [True, False])
def test_values_and_kinds_that_no_table_holds_are_refused(kind: int, value: int, first: bool) -> None:
    """Between, beside and beyond those of the table; and such as would be there once wrapped."""
    kinds, values = np.array([259, 259, 259]), np.array([7, -EXTREME, EXTREME])
    KernelRansEncoder(library()).encode_grouped(one_table(), kinds, values)
    at = 0 if first else 2
    kinds[at], values[at] = kind, value
    assert refusal(lambda encoder: encoder.encode_grouped(one_table(), kinds, values), library()) == "input-symbol"


def test_no_table_at_all() -> None:
    """Nothing needs none."""
    packed, none = PackedTables({}, 1), np.zeros(0, np.int64)
    encoder = KernelRansEncoder(library())
    encoder.encode_grouped(packed, none, none)
    assert encoder.finish() == b""
    one = np.zeros(1, np.int64)
    assert refusal(lambda encoder: encoder.encode_grouped(packed, one, one), library()) == "input-symbol"
