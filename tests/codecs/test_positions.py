"""Positions: any sorted multiset, and no split that does not add up."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from scarfmt.arrays import U64
from scarfmt.codecs.positions import get_positions, put_positions
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.errors import ScarError
from tests.samples.codec_samples import coded


def round_trip(codes: U64, bits: int) -> bytes:
    data, tables = coded(lambda emitter: put_positions(emitter, codes, bits))
    reader = SymbolReader(data, tables)
    assert np.array_equal(get_positions(reader, len(codes), bits), codes)
    reader.finish()
    return data


@st.composite
def multisets(draw: st.DrawFn) -> tuple[U64, int]:
    """Sorted codes with duplicates, near each other or not, at any depth."""
    bits = draw(st.integers(0, 21))
    top = (1 << 3 * bits) - 1
    base = draw(st.integers(0, top))
    near = st.integers(max(0, base - 9), min(top, base + 9))
    codes = draw(st.lists(st.one_of(near, st.integers(0, top), st.sampled_from([0, top])), max_size=50))
    codes += codes[:1] * draw(st.sampled_from([0, 1, 20, 300]))
    return np.array(sorted(codes), np.uint64), bits


@settings(deadline=None, max_examples=150)
@given(multisets())
@example((np.zeros(0, np.uint64), 21))
@example((np.zeros(1, np.uint64), 0))
@example((np.array([(1 << 63) - 1], np.uint64), 21))
@example((np.full(40, (1 << 63) - 1, np.uint64), 21))
def test_any_multiset_comes_back(case: tuple[U64, int]) -> None:
    """Empty, alone, all in one cell, spread out, at 0 to 21 bits an axis."""
    round_trip(*case)


@pytest.mark.parametrize(
    ("count", "bits"), [(65534, 21), (65535, 16), (65536, 16), (65537, 12), (70000, 9), (70000, 1), (70000, 0)]
)
def test_full_tiles_come_back(count: int, bits: int) -> None:
    """Node sizes around 2^16, where a split's remainder no longer fits one alphabet."""
    codes = np.sort(np.random.default_rng(bits).integers(0, 1 << 3 * bits, count, np.uint64))
    round_trip(codes, bits)


SOME = np.sort(np.random.default_rng(1).integers(0, 1 << 24, 300, np.uint64))
STREAM, TABLES = coded(lambda emitter: put_positions(emitter, SOME, 8))


@settings(deadline=None, max_examples=150)
@given(st.integers(0, 2**32 - 1))
def test_damaged_streams_give_codes_in_range_or_a_refusal(seed: int) -> None:
    """Whatever the words: sorted codes below 2^(3 bits), or one of our errors."""
    rng = np.random.default_rng(seed)
    words = np.frombuffer(STREAM, "<u4").copy()
    words[rng.integers(0, len(words), rng.integers(1, 4))] ^= rng.integers(1, 1 << 32, dtype=np.uint32)
    try:
        reader = SymbolReader(words[: rng.integers(1, len(words) + 1)].tobytes(), TABLES)
        found = get_positions(reader, int(rng.choice([300, 1, 17, 301])), int(rng.choice([8, 3, 21])))
        reader.finish()
    except ScarError:
        return
    assert bool((found[1:] >= found[:-1]).all())
