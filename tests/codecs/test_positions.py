"""Positions: any sorted multiset, at less than an octree costs, and no split that does not add up."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from scarfmt.arrays import U64
from scarfmt.codecs.positions import get_positions, put_positions
from scarfmt.container.morton import interleave
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.errors import ScarError
from tests.samples.codec_samples import coded, cost_bits


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


def clustered(seed: int, count: int, bits: int) -> NDArray[np.int64]:
    """(count, 3) points on a few noisy surfaces, as trained scenes have them."""
    rng = np.random.default_rng(seed)
    centre, axes = rng.uniform(0.2, 0.8, (6, 3)), rng.normal(size=(6, 2, 3)) * 0.06
    which = rng.integers(0, 6, count)
    flat = (rng.normal(size=(count, 2))[:, :, None] * axes[which]).sum(1)
    points = centre[which] + flat + rng.normal(size=(count, 3)) * 0.001
    cells: NDArray[np.int64] = np.clip((points * (1 << bits)).astype(np.int64), 0, (1 << bits) - 1)
    return cells


@pytest.mark.parametrize(
    ("count", "bits"), [(65534, 21), (65535, 16), (65536, 16), (65537, 12), (70000, 9), (70000, 1), (70000, 0)]
)
def test_full_tiles_come_back(count: int, bits: int) -> None:
    """Node sizes around 2^16, where a split's remainder no longer fits one alphabet."""
    codes = np.sort(np.random.default_rng(bits).integers(0, 1 << 3 * bits, count, np.uint64))
    round_trip(codes, bits)


def test_a_crowded_cell_costs_next_to_nothing() -> None:
    """70000 anchors at one place: all splits are empty on one side."""
    codes = np.full(70000, 0x123456789ABCDEF, np.uint64)
    assert len(round_trip(codes, 21)) < 400


def occupancies(codes: U64, bits: int) -> list[NDArray[np.int64]]:
    """(255,) counts of the occupancy bytes 1..255 of every octree level."""
    out = []
    for level in range(bits):
        children = np.unique(codes >> np.uint64(3 * (bits - level - 1)))
        _, parent = np.unique(children >> np.uint64(3), return_inverse=True)
        byte = np.bincount(parent, weights=1 << (children & np.uint64(7)).astype(np.int64)).astype(np.int64)
        out.append(np.bincount(byte, minlength=256)[1:])
    return out


def adaptive_bits(counts: NDArray[np.int64]) -> float:
    """Cost of symbols under an adaptive model that starts all counts at 1/2 (Krichevsky-Trofimov)."""
    learnt = math.lgamma(counts.sum() + len(counts) / 2) - math.lgamma(len(counts) / 2)
    return (learnt - sum(math.lgamma(n + 0.5) - math.lgamma(0.5) for n in counts.tolist())) / math.log(2)


@pytest.mark.parametrize(("count", "bits"), [(3000, 12), (3000, 16), (20000, 12), (20000, 16)])
def test_cost_is_below_that_of_an_adaptive_octree(count: int, bits: int) -> None:
    """Tables included, against order-0 adaptive occupancy bytes, one model a level or one for all."""
    codes = np.sort(interleave(clustered(1, count, bits)))
    ours = cost_bits(lambda emitter: put_positions(emitter, codes, bits))
    levels = occupancies(codes, bits)
    assert ours < sum(map(adaptive_bits, levels))
    assert ours < adaptive_bits(np.sum(levels, axis=0))


@settings(deadline=None, max_examples=150)
@given(st.integers(0, 2**32 - 1))
def test_damaged_streams_give_codes_in_range_or_a_refusal(seed: int) -> None:
    """Whatever the words: sorted codes below 2^(3 bits), or one of our errors."""
    rng = np.random.default_rng(seed)
    codes = np.sort(interleave(clustered(seed, 300, 8)))
    data, tables = coded(lambda emitter: put_positions(emitter, codes, 8))
    words = np.frombuffer(data, "<u4").copy()
    words[rng.integers(0, len(words), rng.integers(1, 4))] ^= rng.integers(1, 1 << 32, dtype=np.uint32)
    try:
        reader = SymbolReader(words[: rng.integers(1, len(words) + 1)].tobytes(), tables)
        found = get_positions(reader, int(rng.choice([300, 1, 17, 301])), int(rng.choice([8, 3, 21])))
        reader.finish()
    except ScarError:
        return
    assert bool((found[1:] >= found[:-1]).all())
