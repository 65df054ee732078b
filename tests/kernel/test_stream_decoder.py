"""The compiled rANS decoder: on any words the symbols, and the state after them, of the definition (SPEC §8)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from scarfmt.arrays import F32
from scarfmt.entropy.rans import (
    MAX_ALPHABET,
    TOTAL,
    FrequencyTable,
    PureRansDecoder,
    RansDecoder,
    RansEncoder,
    uniform_table,
)
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import Malformed
from scarfmt.kernel.packed_tables import PackedTables
from scarfmt.kernel.stream_decoder import KernelRansDecoder
from tests.kernel.samples import (
    SEEDS,
    both_decoders,
    check_same_state,
    frequency_rows,
    library,
    needs_kernel,
    random_rows,
    random_stream,
    random_table,
    random_weights,
    streams,
)

pytestmark = needs_kernel
SIZES = st.one_of(st.sampled_from([1, 2, 3, MAX_ALPHABET - 1, MAX_ALPHABET]), st.integers(1, 50))
COUNTS = st.one_of(st.integers(0, 40), st.just(500))


@settings(deadline=None, max_examples=100)
@given(streams(), st.lists(st.tuples(SIZES, COUNTS), max_size=5), SEEDS)
@example(b"", [(4096, 500), (1, 7)], 0)
@example(b"\1\0\0\0", [(2, 500)], 0)
def test_tables_on_any_words(data: bytes, groups: list[tuple[int, int]], seed: int) -> None:
    """Alphabets of 1 to 4096 symbols; also beyond the end of the words, where the state runs empty."""
    rng = np.random.default_rng(seed)
    compiled, pure = both_decoders(data)
    for size, count in groups:
        table = FrequencyTable.from_weights(random_weights(rng, size))
        assert compiled.decode(table, count).tolist() == pure.decode(table, count).tolist()
        check_same_state(compiled, pure)


@settings(deadline=None, max_examples=100)
@given(streams(), st.lists(st.tuples(st.one_of(SIZES, st.integers(1, MAX_ALPHABET)), COUNTS), max_size=5))
@example(b"", [(4096, 500), (1, 7)])
def test_uniform_tables_on_any_words(data: bytes, groups: list[tuple[int, int]]) -> None:
    """Uniform tables are never stored: their edges are computed."""
    compiled, pure = both_decoders(data)
    for size, count in groups:
        assert compiled.uniform(size, count).tolist() == pure.decode(uniform_table(size), count).tolist()
        check_same_state(compiled, pure)


def test_every_uniform_size_at_every_edge() -> None:
    """Sizes 1..4096; the slots on both sides of some edge of each, and the first and the last."""
    rng = np.random.default_rng(1)
    for size in range(1, MAX_ALPHABET + 1):
        edges = uniform_table(size).cumulative
        edge = int(edges[rng.integers(0, size)])
        for slot in {0, TOTAL - 1, edge, max(edge - 1, 0)}:
            data = np.array([slot, 0x80000001], "<u4").tobytes()
            found = KernelRansDecoder(library(), data).uniform(size, 1).tolist()
            assert found == ([0] if size == 1 else [int(np.searchsorted(edges, slot, side="right")) - 1])


@settings(deadline=None, max_examples=80)
@given(SEEDS, st.integers(1, 64), st.integers(0, 400), st.integers(0, 40), st.booleans())
@example(0, 64, 400, 5, False)
@example(0, 1, 0, 0, False)
def test_grouped_symbols_on_any_words(seed: int, components: int, count: int, words: int, gaps: bool) -> None:
    """Sorted by kind, values back in their order; the least kind without a table is named, and nothing read."""
    rng = np.random.default_rng(seed)
    kinds = rng.integers(0, 256 * components, count).astype(np.uint16)
    kinds[rng.random(count) < 0.5] = 256 * components - 1
    made = {int(kind): random_table(rng, int(rng.choice([1, 2, 3, 40]))) for kind in np.unique(kinds)}
    if gaps:
        made = {kind: table for kind, table in made.items() if rng.random() < 0.9}
    packed = PackedTables({(kind // 256, kind % 256): table for kind, table in made.items()}, components)
    compiled, pure = both_decoders(random_stream(rng, words))
    found = compiled.grouped(packed, kinds)
    lacking = sorted(set(kinds.tolist()) - set(made))
    if lacking:
        assert found == lacking[0]
    else:
        wanted = np.zeros(count, np.int64)
        for kind in np.unique(kinds).tolist():
            table, chosen = made[kind], np.flatnonzero(kinds == kind)
            wanted[chosen] = table.alphabet[pure.decode(table.table, len(chosen))]
        assert isinstance(found, np.ndarray)
        assert found.tolist() == wanted.tolist()
    check_same_state(compiled, pure)


@pytest.mark.parametrize("kinds", [[256], [0, 65535], [300, 0]])
def test_a_kind_of_no_component_is_one_without_a_table(kinds: list[int]) -> None:
    """Nothing is looked up outside the tables."""
    packed = PackedTables({(0, 0): SymbolTable(np.array([5]), np.array([1]))}, 1)
    compiled, _ = both_decoders(b"\1\0\0\0")
    assert compiled.grouped(packed, np.array(kinds, np.uint16)) == max(kinds)


def test_no_table_at_all() -> None:
    """Nothing to read is read; the first symbol finds none."""
    packed = PackedTables({}, 2)
    compiled, _ = both_decoders(b"")
    none = compiled.grouped(packed, np.zeros(0, np.uint16))
    assert isinstance(none, np.ndarray)
    assert none.shape == (0,)
    assert compiled.grouped(packed, np.array([300, 17], np.uint16)) == 17


def test_kinds_may_be_a_view_of_other_numbers() -> None:
    """Every second of 16 bits, or 64 bits: their memory is not read as if it were whole."""
    rng = np.random.default_rng(2)
    packed = PackedTables({(0, kind): random_table(rng, 30) for kind in range(4)}, 1)
    wide = rng.integers(0, 4, 100).astype(np.uint16)
    wanted, *found = (
        KernelRansDecoder(library(), random_stream(np.random.default_rng(3), 40)).grouped(packed, kinds)
        for kinds in (wide[::2].copy(), wide[::2], wide[::2].astype(np.int64), np.stack([wide, wide])[:, ::2][1])
    )
    assert all(np.array_equal(wanted, other) for other in found)


@settings(deadline=None, max_examples=20)
@given(SEEDS, st.lists(SIZES, min_size=1, max_size=6), st.sampled_from([1, 2, (1 << 24) - 1, ((1 << 39) - 1) >> 12]))
@example(0, [4096, 1, 4096], ((1 << 39) - 1) >> 12)
def test_prefix_sums_are_those_of_the_tables(seed: int, sizes: list[int], top: int) -> None:
    """Side by side, with sums of weights up to 2^39."""
    rng = np.random.default_rng(seed)
    tables = [SymbolTable(np.arange(size), random_weights(rng, size, top)) for size in sizes]
    packed = PackedTables({(0, number): table for number, table in enumerate(tables)}, 1)
    wanted = np.concatenate([table.table.cumulative for table in tables])
    assert np.array_equal(packed._arrays.sums, wanted)


@settings(deadline=None, max_examples=80)
@given(SEEDS, st.integers(0, 60), SIZES, st.integers(0, 60))
def test_rows_on_any_words(seed: int, words: int, size: int, count: int) -> None:
    """Each symbol with frequencies of its own; also rows in Fortran order."""
    rng = np.random.default_rng(seed)
    rows = random_rows(rng, min(count, 20_000 // size), size)
    compiled, pure = both_decoders(random_stream(rng, words))
    assert compiled.decode_rows(rows).tolist() == pure.decode_rows(rows).tolist()
    assert compiled.decode_rows(np.asfortranarray(rows)).tolist() == pure.decode_rows(rows).tolist()
    check_same_state(compiled, pure)


# Distances below, at and beyond the 512 from which a weight is 0, and those that binary32 no longer tells apart.
_REACHES = (0, 1, 5, 511, 512, 513, 3000, (1 << 24) - 1)


@settings(deadline=None, max_examples=150)
@given(SEEDS, st.integers(0, 60), SIZES, st.integers(0, 70), st.sampled_from(_REACHES))
@example(0, 9, 1, 20, 5)
@example(0, 9, 4096, 33, 0)
@example(0, 9, 4096, 15, (1 << 24) - 1)
def test_logits_on_any_words(seed: int, words: int, size: int, count: int, reach: int) -> None:
    """Equal ones, far apart, one alone; columns in any number, a multiple of the lanes or not."""
    rng = np.random.default_rng(seed)
    logits = rng.integers(-reach, reach + 1, (size, min(count, 80_000 // size))).astype(np.float32)
    if rng.random() < 0.3:
        logits[rng.integers(0, size)] = reach
    compiled, pure = both_decoders(random_stream(rng, words))
    rows = frequency_rows(logits)
    assert compiled.decode_logits(logits).tolist() == pure.decode_rows(rows).tolist()
    check_same_state(compiled, pure)
    assert compiled.decode_logits(np.asfortranarray(logits)).tolist() == pure.decode_rows(rows).tolist()
    check_same_state(compiled, pure)


def symbols_at(slot: int, logits: F32) -> set[tuple[int, ...]]:
    """The symbols that every way to code (k, 1) `logits` finds at a slot."""
    decoder = partial(KernelRansDecoder, library(), np.array([slot, 0x80000001], "<u4").tobytes())
    rows = frequency_rows(logits)
    found = decoder().decode_logits(logits), decoder().decode_rows(rows)
    table = decoder().decode(FrequencyTable(rows[0].astype(np.int64) + 1), 1)
    return {tuple(symbols.tolist()) for symbols in (*found, table)}


@settings(deadline=None, max_examples=40)
@given(SEEDS, st.sampled_from([2, 3, 7, 64, 4096]), st.sampled_from([0, 1, 40, 600]))
@example(0, 2, 0)
@example(0, 4096, 0)
def test_slots_on_both_sides_of_an_edge(seed: int, size: int, reach: int) -> None:
    """At such slots rounding decides; every way to code the same frequencies agrees."""
    rng = np.random.default_rng(seed)
    logits = rng.integers(-reach, reach + 1, (size, 1)).astype(np.float32)
    edges = np.concatenate(([0], np.cumsum(frequency_rows(logits)[0] + 1))).astype(np.int64)
    for symbol in {0, 1, size - 1, *rng.integers(0, size, 5).tolist()}:
        assert symbols_at(int(edges[symbol]), logits) == {(symbol,)}
        assert symbols_at(int(edges[symbol + 1]) - 1, logits) == {(symbol,)}


def test_a_state_at_the_limit_takes_no_word() -> None:
    """2^33 halved is exactly 2^32, from which on no word is needed (SPEC §8.2)."""
    data = np.array([7, 0, 2], "<u4").tobytes()
    halves = np.full((1, 2), (TOTAL - 2) / 2)
    reads: list[Callable[[KernelRansDecoder], Any]] = [
        lambda decoder: decoder.uniform(2, 1),
        lambda decoder: decoder.decode(uniform_table(2), 1),
        lambda decoder: decoder.decode_rows(halves),
        lambda decoder: decoder.decode_logits(np.zeros((2, 1), np.float32)),
    ]
    for read in reads:
        compiled, pure = both_decoders(data)
        assert read(compiled).tolist() == pure.decode(uniform_table(2), 1).tolist() == [0]
        assert pure._state == 1 << 32
        check_same_state(compiled, pure)


@settings(deadline=None, max_examples=40)
@given(SEEDS, st.lists(st.integers(0, 3), max_size=6))
def test_sound_streams_come_back_and_end_empty(seed: int, kinds: list[int]) -> None:
    """Streams of the encoder come back up to their seal, with every kind of symbol in turn."""
    rng = np.random.default_rng(seed)
    encoder, wanted, groups = RansEncoder(), [], list[tuple[str, Any]]()
    for kind in kinds:
        size, count = int(rng.integers(1, 40)), int(rng.integers(0, 30))
        symbols = rng.integers(0, size, count)
        if kind == 0:
            groups.append(("decode", (FrequencyTable.from_weights(random_weights(rng, size)), count)))
            encoder.encode(symbols, groups[-1][1][0])
        elif kind == 1:
            groups.append(("uniform", (size, count)))
            encoder.encode(symbols, uniform_table(size))
        elif kind == 2:
            groups.append(("decode_rows", (random_rows(rng, count, size),)))
            encoder.encode_rows(symbols, groups[-1][1][0])
        else:
            logits = rng.integers(-300, 300, (size, count)).astype(np.float32)
            groups.append(("decode_logits", (logits,)))
            encoder.encode_rows(symbols, frequency_rows(logits) if count else np.zeros((0, size)))
        wanted.append(symbols.tolist())
    data = encoder.finish()
    decoder = KernelRansDecoder(library(), data)
    assert [getattr(decoder, name)(*arguments).tolist() for name, arguments in groups] == wanted
    decoder.finish()


@pytest.mark.parametrize(
    ("data", "refusal"), [(b"\0\0\0\0", "rans-last-word"), (b"\1\0\0", "rans-length"), (b"\1\0\0\0", "rans-seal")]
)
def test_refusals_of_streams_are_those_of_the_definition(data: bytes, refusal: str) -> None:
    """Before a word is taken, and at the end."""
    for make in (partial(KernelRansDecoder, library()), PureRansDecoder, RansDecoder):
        with pytest.raises(Malformed) as caught:
            make(data).finish()
        assert caught.value.refusal == refusal
