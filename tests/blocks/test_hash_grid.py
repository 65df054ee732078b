"""HASH_GRID blocks: every grid comes back, its layout is the written one, and damage is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.blocks.hash_grid import pack_grid, unpack_grid
from scarfmt.container.bytefields import unsigned_varint
from scarfmt.entropy.rans import FrequencyTable, RansEncoder
from scarfmt.errors import LimitExceeded, ScarError
from scarfmt.neural.grid import MAX_LEVELS, MAX_RESOLUTION, GridLevel, HashGrid
from tests.samples.codec_samples import refuses

LEVELS = st.builds(GridLevel, st.integers(0, 6), st.integers(1, MAX_RESOLUTION), st.integers(1, 9), st.integers(1, 8))


def random_grid(levels: list[GridLevel], seed: int) -> HashGrid:
    """Any box; each table of its own density of ones, 0 and 1 among them."""
    rng = np.random.default_rng(seed)
    chances = rng.choice([0.0, 0.02, 0.5, rng.random(), 1.0], len(levels))
    bits = tuple(
        (rng.random((level.entries, level.features)) < chance).astype(np.uint8)
        for level, chance in zip(levels, chances, strict=True)
    )
    x, y, z = rng.integers(0, 2**32, 3).tolist()
    return HashGrid((x, y, z), int(rng.integers(0, 33)), tuple(levels), bits)


def same(found: HashGrid, wanted: HashGrid) -> bool:
    shape = (found.origin, found.extent_bits, found.levels) == (wanted.origin, wanted.extent_bits, wanted.levels)
    return shape and all(np.array_equal(a, b) for a, b in zip(found.bits, wanted.bits, strict=True))


@settings(deadline=None)
@given(st.lists(LEVELS, min_size=1, max_size=MAX_LEVELS), st.integers(0, 2**32 - 1))
def test_grids_come_back(levels: list[GridLevel], seed: int) -> None:
    """Any levels, any density of ones, and what comes back passes its own check."""
    grid = random_grid(levels, seed)
    found = unpack_grid(pack_grid(grid))
    found.check()
    assert same(found, grid)


def test_tables_of_few_ones_are_small() -> None:
    """One bit in a hundred costs what its entropy says, not a bit."""
    rng = np.random.default_rng(3)
    bits = (rng.random((1 << 15, 4)) < 0.01).astype(np.uint8)
    size = len(pack_grid(HashGrid((0, 0, 0), 8, (GridLevel(0, 100, 15, 4),), (bits,))))
    assert size < 1.05 * bits.size * 0.0808 / 8 + 40


def payload(
    origin: tuple[int, int, int] = (5, 300, 0),
    extent_bits: int = 9,
    count: int = 1,
    level: tuple[int, int, int, int] = (4, 2, 2, 1),
    ones: int = 128,
    stream: bytes | None = None,
    length: int | None = None,
) -> bytes:
    """A grid of one axis level with three entries, by default 1, 0, 1 with even chances."""
    encoder = RansEncoder()
    encoder.encode(np.array([1, 0, 1]), FrequencyTable.from_weights(np.array([128, 128])))
    stream = encoder.finish() if stream is None else stream
    size = (len(stream) if length is None else length).to_bytes(4, "little")
    numbers = [*origin, extent_bits, count, *level]
    return b"".join(map(unsigned_varint, numbers)) + bytes([ones]) + size + stream


def test_the_hand_made_grid_is_readable() -> None:
    """The layout, not only its inverse."""
    grid = unpack_grid(payload())
    assert (grid.origin, grid.extent_bits, grid.levels) == ((5, 300, 0), 9, (GridLevel(4, 2, 2, 1),))
    assert grid.bits[0].tolist() == [[1], [0], [1]]


BAD = {
    "no level": (b"".join(map(unsigned_varint, [0, 0, 0, 8, 0])), "bad-grid"),
    "box too large": (payload(extent_bits=33), "bad-grid"),
    "origin too large": (payload(origin=(0, 2**32, 0)), "bad-varint"),
    "unknown plane": (payload(level=(7, 2, 2, 1)), "bad-grid"),
    "no cells": (payload(level=(4, 0, 2, 1)), "bad-grid"),
    "too many cells": (payload(level=(4, MAX_RESOLUTION + 1, 19, 1)), "bad-grid"),
    "table of 1": (payload(level=(4, 2, 0, 1)), "bad-grid"),
    "table too large": (payload(level=(4, 2, 20, 1)), "bad-grid"),
    "no features": (payload(level=(4, 2, 2, 0)), "bad-grid"),
    "too many features": (payload(level=(4, 2, 2, 9)), "bad-grid"),
    "no probability": (payload(ones=0), "bad-grid"),
    "too many bits": (b"".join(map(unsigned_varint, [0, 0, 0, 8, 5, *[0, 999, 19, 8] * 5])), "bad-grid"),
    "stream not in words": (payload(stream=b"abc"), "rans-length"),
    "stream not empty at the end": (payload(stream=b"\1\2\3\4" * 3), "rans-seal"),
    "stream cut": (payload(length=400), "payload-short"),
    "long": (payload() + b"\0", "payload-long"),
}


@pytest.mark.parametrize("name", BAD)
def test_payloads_that_break_the_rule_are_refused(name: str) -> None:
    """Each rule of SPEC §10.6 by one payload."""
    data, refusal = BAD[name]
    refuses(refusal, lambda: unpack_grid(data))


def test_too_many_levels_pass_a_limit() -> None:
    """Refused before anything is read or allocated."""
    with pytest.raises(LimitExceeded):
        unpack_grid(payload(count=MAX_LEVELS + 1))


def even_grid() -> HashGrid:
    """Three levels with as many ones as zeros: tables of one value only would not depend on their probability byte."""
    levels, rng = (GridLevel(0, 5, 8, 2), GridLevel(2, 60, 6, 3), GridLevel(6, 9, 4, 4)), np.random.default_rng(8)
    bits = tuple(rng.integers(0, 2, (level.entries, level.features), dtype=np.uint8) for level in levels)
    return HashGrid((9, 2**31, 0), 17, levels, bits)


DAMAGED = even_grid()


def test_every_prefix_is_refused() -> None:
    """With one of our errors, at every length."""
    data = pack_grid(DAMAGED)
    for length in range(len(data)):
        with pytest.raises(ScarError):
            unpack_grid(data[:length])


@settings(deadline=None)
@given(st.integers(0, 8 * len(pack_grid(DAMAGED)) - 1))
def test_flipped_bits_are_refused_or_give_a_valid_grid(place: int) -> None:
    """Never another error, never a grid that its own check refuses, never the same grid."""
    data = bytearray(pack_grid(DAMAGED))
    data[place // 8] ^= 1 << place % 8
    try:
        found = unpack_grid(bytes(data))
    except ScarError:
        return
    found.check()
    assert not same(found, DAMAGED)


@given(st.binary(max_size=60))
def test_garbage_raises_only_our_errors(data: bytes) -> None:
    """Any bytes give a valid grid or a refusal."""
    try:
        unpack_grid(data).check()
    except ScarError:
        return
