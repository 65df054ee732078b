"""The arrays lent to one call that reads all steps of a channel: arrays of another type never reach the library."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.container.schema import Stream
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.kernel.cells import CellNames, kernel_fine
from scarfmt.kernel.channel import KernelChannel
from scarfmt.kernel.packed_predictors import PackedPredictorSteps, Surroundings
from scarfmt.kernel.packed_tables import PackedSteps, PackedTables
from scarfmt.kernel.scratch import Scratch
from scarfmt.kernel.stream_decoder import ALL_READ, KernelRansDecoder
from scarfmt.scene.model import Channel, ContextRule
from tests.kernel.samples import SEEDS, library, needs_kernel, random_stream

pytestmark = needs_kernel

CHANNEL = Channel(Stream.COLOUR, (1.0,) * 2, (ContextRule(False), ContextRule(False)))


def trits(size: int) -> PackedTables:
    """Tables of the first `size` of -1, 0 and 1 for every context."""
    table = SymbolTable(np.arange(-1, size - 1), np.arange(3, 3 + size))
    return PackedTables({(place, context): table for place in range(2) for context in range(256)}, 2)


@settings(deadline=None, max_examples=60)
@given(SEEDS, st.integers(0, 40), st.integers(1, 3))
def test_anchors_that_receive_each_step(seed: int, count: int, size: int) -> None:
    """Only anchors between the steps before and after receive a step; what each receives are the digits of its
    value."""
    rng = np.random.default_rng(seed)
    before = rng.integers(1, 4, count)
    after = before + rng.integers(0, 3, count)
    values, first = np.zeros((count, 2), np.int32), np.zeros((count, 2), np.int32)
    steps = np.full(count, -1)
    target = KernelChannel(library(), CHANNEL, np.zeros(count, np.int64), values, [first], steps)
    rans = KernelRansDecoder(library(), random_stream(rng, 30))
    coded = range(2, 7)
    found = target.read(rans, coded, (before, after), PackedSteps([trits(size)] * 5), None, None)
    assert found == (ALL_READ, 7, [int(((before < step) & (after >= step)).sum()) for step in coded])
    assert (steps == after).all()
    assert not first.any()
    assert (np.abs(values) <= (3 ** (after - before)[:, None] - 1) // 2).all()


def test_settled_values_of_another_kind_are_refused() -> None:
    """The library would read such arrays as another type, or past their end."""
    cells = CellNames([np.zeros(4, np.int32)], [1])
    made: list[Any] = [np.zeros((4, 2), np.int32), np.zeros((4, 2), np.int32), np.zeros(4, np.int64)]
    target = KernelChannel(library(), CHANNEL, np.zeros(4, np.int64), made[0], [made[1]], made[2])
    moves, tables = (np.ones(4, np.int64), np.full(4, 2)), PackedSteps([trits(3)])
    others: list[Any] = [np.zeros((4, 3), np.int64), np.zeros((3, 3), np.int32)]
    others += [np.zeros((3, 4), np.int32).T, np.zeros((4, 6), np.int32)[:, ::2]]
    for settled in others:
        around = Surroundings(settled, cells, np.arange(4), 1)
        with pytest.raises(TypeError):
            target.read(KernelRansDecoder(library(), b""), range(2, 3), moves, tables, around, None)
    by_code: Any = np.arange(4, dtype=np.int32)
    around = Surroundings(np.zeros((4, 3), np.int32), cells, by_code, 1)
    with pytest.raises(TypeError):
        target.read(KernelRansDecoder(library(), b""), range(2, 3), moves, tables, around, PackedPredictorSteps([None]))


def test_fine_values_go_where_there_is_room_for_them() -> None:
    """Rows may lie anywhere, numbers of a row side by side."""
    values, steps, wide = np.arange(6).reshape(3, 2), np.ones(3, np.int64), np.full((3, 5), 7, np.int32)
    kernel_fine(library(), values, steps, wide[:, 1:3])
    assert wide.tolist() == [[7, 1024 * row, 1024 * (row + 1), 7, 7] for row in (0, 2, 4)]
    for out in (np.zeros((3, 2), np.int64), np.zeros((2, 3), np.int32).T, np.zeros((3, 3), np.int32)):
        with pytest.raises(TypeError):
            kernel_fine(library(), values, steps, out)  # type: ignore[arg-type]


def test_scratch_grows_and_stays() -> None:
    """A name that is used again lies at the same place; more memory is placed elsewhere, beside what others hold."""
    scratch = Scratch()
    first = scratch.at("a", 100)
    assert scratch.at("a", 40) == first
    other, more = scratch.at("b", 100), scratch.at("a", 1 << 20)
    assert abs(more - other) >= 100
    assert scratch.at("a", 1 << 20) == more
