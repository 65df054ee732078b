"""Positions read by the compiled library: codes, counts, state and refusals of the definition (SPEC §7.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from scarfmt.arrays import U64
from scarfmt.codecs.positions import LARGEST_OWN_TABLE, put_positions
from scarfmt.coding.engine import Engine
from scarfmt.container.schema import Stream
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from tests.kernel.samples import SEEDS, both, needs_kernel, random_stream, same
from tests.samples.codec_samples import Recorder, coded

pytestmark = needs_kernel

LARGE = LARGEST_OWN_TABLE + 1


def key(count: int) -> TableKey:
    return TableKey(Stream.POSITIONS, 0, 0, count)


def read(data: bytes, tables: Mapping[TableKey, SymbolTable], total: int, bits: int) -> Any:
    """Codes, symbols counted, and what the stream is refused for once they are read."""

    def act(engine: Engine) -> Any:
        reader = engine.symbol_reader(data, tables)
        codes = engine.get_positions(reader, total, bits)
        reader.finish()
        return codes, reader.static, reader.uniform

    return both(act)


@st.composite
def multisets(draw: st.DrawFn) -> tuple[U64, int]:
    """Sorted codes at 0 to 21 bits an axis: near each other, far apart, many in one place."""
    bits = draw(st.integers(0, 21))
    rng = np.random.default_rng(draw(SEEDS))
    base = rng.integers(0, 1 << 3 * bits, draw(st.integers(1, 40)), np.uint64)
    codes = np.repeat(base, rng.integers(1, draw(st.sampled_from([2, 3, 40, 1200])), len(base)))
    near = rng.integers(0, 1 << draw(st.integers(0, min(3 * bits, 12))), len(codes), np.uint64)
    return np.sort(codes ^ near if draw(st.booleans()) else codes), bits


@settings(deadline=None, max_examples=60)
@given(multisets())
@example((np.zeros(1, np.uint64), 0))
@example((np.full(3000, (1 << 63) - 1, np.uint64), 21))
def test_sound_streams_come_back_with_equal_counts(case: tuple[U64, int]) -> None:
    """Duplicates, crowds and single anchors."""
    codes, bits = case
    data, tables = coded(lambda emitter: put_positions(emitter, codes, bits))
    compiled, plain = read(data, tables, len(codes), bits)
    assert same(compiled, plain)
    assert np.array_equal(compiled[0], codes)


@pytest.mark.parametrize(("count", "bits"), [(65535, 21), (65536, 12), (65537, 8), (140_000, 3), (70000, 0)])
def test_full_tiles_come_back(count: int, bits: int) -> None:
    """Rests above 4096, which travel in two parts; more anchors than one block may bring."""
    rng = np.random.default_rng(bits)
    codes = np.sort(rng.integers(0, 1 << 3 * bits, count, np.uint64) >> rng.integers(0, 3 * bits + 1, count, np.uint64))
    data, tables = coded(lambda emitter: put_positions(emitter, codes, bits))
    compiled, plain = read(data, tables, count, bits)
    assert same(compiled, plain)
    assert np.array_equal(compiled[0], codes)


def random_tables(rng: np.random.Generator, spoilt: float) -> dict[TableKey, SymbolTable]:
    """Tables of every node size, some with values that are no split, some missing."""
    tables = {}
    for count in range(2, LARGE + 1):
        top = count if count < LARGE else 15
        alphabet = np.unique(rng.integers(0, top + 1, 6))
        if rng.random() < spoilt:
            extreme = int(rng.choice([-1, top + 1, 2**31 - 1, -(2**31) + 1]))
            alphabet = np.unique(np.append(alphabet, extreme))
        if rng.random() >= spoilt / 2:
            tables[key(count)] = SymbolTable(alphabet, rng.integers(1, 1 << 24, len(alphabet)))
    return tables


@settings(deadline=None, max_examples=150)
@given(SEEDS, st.integers(0, 21), st.sampled_from([1, 2, 16, 17, 300, 5000]), st.sampled_from([0, 0.02, 0.3]))
@example(0, 21, 66_000, 0)
@example(3, 4, 66_000, 0)
def test_any_words_give_the_same_codes_or_refusal(seed: int, bits: int, total: int, spoilt: float) -> None:
    """Exhausted streams too: an all-zero state goes on giving symbols."""
    rng = np.random.default_rng(seed)
    data = random_stream(rng, int(rng.choice([0, 1, 2, 30, 2 * total])))
    tables = random_tables(rng, spoilt)

    def act(engine: Engine) -> Any:
        reader = engine.symbol_reader(data, tables)
        return engine.get_positions(reader, total, bits), reader.static, reader.uniform

    compiled, plain = both(act)
    assert same(compiled, plain)
    # The seal shows that both have used the same words.
    assert same(*read(data, tables, total, bits))


def faulty(*groups: tuple[int, list[int]], uniform: tuple[tuple[int, int], ...] = ()) -> Any:
    """A stream of exactly these splits and uniform parts, and its tables."""

    def put(emitter: Emitter) -> None:
        for count, values in groups:
            emitter.emit(key(count), np.array(values, np.int64))
        for size, value in uniform:
            emitter.emit_uniform(size, np.array([value]))

    return coded(put)


FAULTS = {
    "bin below 0": (faulty((LARGE, [-1])), 40, "bin"),
    "bin above 15": (faulty((LARGE, [16])), 40, "bin"),
    "bin at the end of the range": (faulty((LARGE, [2**31 - 1])), 70000, "bin"),
    "rest beyond its bin": (faulty((LARGE, [0]), uniform=((2, 1), (4096, 1))), 65536, "remainder"),
    "split below 0": (faulty((3, [-1])), 3, "more anchors below"),
    "split above its node": (faulty((3, [4])), 3, "more anchors below"),
    "split at the end of the range": (faulty((16, [-(2**31) + 1])), 16, "more anchors below"),
    "node without a table": (faulty((3, [1])), 2, "no static table"),
    "large node without a table": (faulty((3, [1])), 17, "no static table"),
}


@pytest.mark.parametrize(("stream", "total", "message"), FAULTS.values(), ids=FAULTS)
def test_every_fault_is_refused_in_the_same_words(stream: Any, total: int, message: str) -> None:
    """Bins, rests and splits out of range, and node sizes without a table."""
    compiled, plain = read(*stream, total, 1)
    assert compiled == plain
    assert message in plain[2]


def test_no_anchor_reads_nothing() -> None:
    """The compiled reader is not even asked."""
    compiled, plain = read(b"", {}, 0, 21)
    assert same(compiled, plain)
    assert len(compiled[0]) == 0


@settings(deadline=None, max_examples=60)
@given(multisets())
@example((np.zeros(1, np.uint64), 0))
@example((np.zeros(0, np.uint64), 5))
@example((np.sort(np.arange(70_000, dtype=np.uint64) * np.uint64(37) % np.uint64(1 << 18)), 6))
@example((np.full(3000, (1 << 63) - 1, np.uint64), 21))
def test_the_same_groups_are_written(case: tuple[U64, int]) -> None:
    """Splits, bins, rests and bits, in the order of the definition; rests above 4096 in two parts."""
    codes, bits = case

    def act(engine: Engine) -> Any:
        recorder = Recorder()
        engine.put_positions(recorder, codes, bits)
        return [(key, values) for key, values in recorder.groups if values]

    compiled, plain = both(act)
    assert compiled == plain
    assert (len(plain) > 0) == (len(codes) > 0 and bits > 0)
