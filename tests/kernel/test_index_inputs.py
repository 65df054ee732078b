"""Fine values, sums over cells, grid features and inputs of the index network: compiled and not, the same integers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.codecs.neural_indices import Around, IndexCoder, embedding_inputs
from scarfmt.coding.engine import Engine
from scarfmt.kernel import index_inputs
from scarfmt.kernel.cells import KernelCellSums
from scarfmt.kernel.index_inputs import grid_features
from scarfmt.neural.context import FINE_LIMIT, CellMeans, CellSums, depth_shifts
from scarfmt.neural.context_operations import fine
from scarfmt.neural.grid import (
    MAX_EXTENT_BITS,
    MAX_FEATURES,
    MAX_RESOLUTION,
    MAX_TABLE_LOG2,
    GridLevel,
    HashGrid,
)
from scarfmt.neural.network import Inputs
from scarfmt.scene.model import MAX_CLASSES, MAX_STEPS
from tests.kernel.samples import SEEDS, both, library, needs_kernel, same

pytestmark = needs_kernel

EXTREME = (1 << 31) - 1


def spread(rng: np.random.Generator, shape: tuple[int, ...], top: int) -> I64:
    """Integers of every magnitude up to `top`, its ends and zero among them."""
    out = np.rint(np.exp2(rng.uniform(0, np.log2(top), shape))).astype(np.int64)
    out[rng.random(shape) < 0.1] = top
    out[rng.random(shape) < 0.1] = 0
    return np.minimum(out, top) * rng.choice([-1, 1], shape)


@settings(deadline=None, max_examples=100)
@given(SEEDS, st.integers(0, 50), st.integers(1, 9), st.booleans(), st.sampled_from([np.int32, np.int64]))
def test_fine_values(seed: int, count: int, columns: int, alike: bool, dtype: type) -> None:
    """Values after 0 to 20 steps agree up to the ends of 32 bits; views of other arrays work, too."""
    rng = np.random.default_rng(seed)
    values = spread(rng, (count, 2 * columns), EXTREME).astype(dtype)[:, ::2]
    steps = rng.integers(0, MAX_STEPS + 1, 1 if alike else count)
    compiled, plain = both(lambda engine: fine(values, steps, engine))
    assert same(compiled, plain)


@pytest.mark.parametrize("steps", range(MAX_STEPS + 1))
def test_fine_values_at_every_edge(steps: int) -> None:
    """Ties, and the clamp, of every step."""
    power = 3 ** max(steps - 1, 0)
    middles = np.concatenate([k * power // 1024 + np.arange(-2, 3) for k in (-FINE_LIMIT, -3, -1, 0, 1, 2, FINE_LIMIT)])
    values = np.clip(np.concatenate([middles, [-EXTREME, EXTREME]]), -EXTREME, EXTREME)[:, None]
    compiled, plain = both(lambda engine: fine(values, np.array([steps]), engine))
    assert same(compiled, plain)
    exact = [(2048 * int(v) + power) // (2 * power) if steps else 0 for v in values[:, 0]]
    assert compiled[:, 0].tolist() == [min(max(v, -FINE_LIMIT), FINE_LIMIT) for v in exact]


def random_codes(rng: np.random.Generator, count: int, bits: int) -> NDArray[np.uint64]:
    """Ascending codes, some equal."""
    codes = rng.integers(0, 1 << 3 * bits, count, np.uint64) >> rng.integers(0, 3 * bits + 1, count, np.uint64)
    return np.sort(codes)


@settings(deadline=None, max_examples=100)
@given(SEEDS, st.integers(0, 80), st.integers(0, 21), st.integers(0, 4), st.integers(0, 70))
@example(0, 80, 21, 4, 512)
def test_sums_over_cells(seed: int, count: int, bits: int, depths: int, columns: int) -> None:
    """Cells empty and full, filled in several rounds; values at the limit of fine ones."""
    rng = np.random.default_rng(seed)
    codes = random_codes(rng, count, bits)
    occupancies = np.sort(rng.choice([1, 2, 3, 7, 24, 65535], depths, replace=False))[::-1].tolist()
    cells = CellMeans(codes, depth_shifts(codes, bits, occupancies))
    compiled, plain = KernelCellSums(library(), cells.compact, cells.sizes, columns), CellSums(cells, columns)
    for rows in np.array_split(rng.permutation(count), 3):
        wanted = rng.integers(0, max(count, 1), 0 if not count else 30)
        assert all(map(same, map(np.ascontiguousarray, compiled.around(wanted)), plain.around(wanted)))
        values = spread(rng, (len(rows), columns), FINE_LIMIT)
        compiled.add(rows, values)
        plain.add(rows, values.astype(np.float64))
    rows = np.arange(count)
    assert all(map(np.array_equal, compiled.around(rows), plain.around(rows)))


def test_a_full_tile_in_one_cell() -> None:
    """2^20 anchors at the limit, of one sign: exact sums, and means that are the value itself."""
    count = 1 << 20
    sums = KernelCellSums(library(), [np.zeros(count, np.int32)], [1], 2)
    sums.add(np.arange(count), np.tile([FINE_LIMIT, -FINE_LIMIT], (count, 1)))
    means, counts = sums.around(np.array([0, count - 1]))
    assert means.tolist() == [[[FINE_LIMIT, -FINE_LIMIT]]] * 2
    assert counts.tolist() == [[count]] * 2


def test_cells_of_another_type_are_refused() -> None:
    """Memory is never read as what it is not."""
    with pytest.raises(TypeError):
        KernelCellSums(library(), [np.zeros(4, np.int64)], [1], 2)
    with pytest.raises(TypeError):
        KernelCellSums(library(), [np.zeros(8, np.int32)[::2]], [1], 2)


LEVELS = st.builds(
    GridLevel,
    st.integers(0, 6),
    st.one_of(st.integers(1, 70), st.integers(1, MAX_RESOLUTION), st.just(MAX_RESOLUTION)),
    st.integers(1, 12),
    st.integers(1, MAX_FEATURES),
)


def grid_of(rng: np.random.Generator, levels: list[GridLevel], extent_bits: int) -> HashGrid:
    """Random bits, the box anywhere."""
    bits = tuple((rng.random((level.entries, level.features)) < rng.random()).astype(np.uint8) for level in levels)
    origin = tuple(int(o) for o in rng.choice([0, 1, 12345, 2**32 - 1], 3))
    grid = HashGrid((origin[0], origin[1], origin[2]), extent_bits, tuple(levels), bits)
    grid.check()
    return grid


@settings(deadline=None, max_examples=120)
@given(SEEDS, st.lists(LEVELS, min_size=1, max_size=4), st.integers(0, MAX_EXTENT_BITS), st.integers(0, 60))
@example(1, [GridLevel(0, MAX_RESOLUTION, MAX_TABLE_LOG2, 8)], 32, 60)
@example(2, [GridLevel(0, 79, MAX_TABLE_LOG2, 8), GridLevel(1, 723, MAX_TABLE_LOG2, 1)], 32, 60)
@example(3, [GridLevel(plane, 5, 8, 3) for plane in range(7)], 0, 60)
@example(4, [GridLevel(plane, 6, 4, 2) for plane in range(7)], 7, 60)
@example(5, [GridLevel(plane, MAX_RESOLUTION, 16, 1) for plane in range(7)], 8, 60)
def test_grid_features(seed: int, levels: list[GridLevel], extent_bits: int, count: int) -> None:
    """All planes, dense and hashed; positions in the box, on its surface, far outside and below 0."""
    rng = np.random.default_rng(seed)
    grid = grid_of(rng, levels, extent_bits)
    places = np.array(grid.origin) + rng.integers(0, 1 << extent_bits, (count, 3))
    far = rng.random((count, 3)) < 0.2
    places[far] = spread(rng, (int(far.sum()),), 1 << 40)
    near = rng.random((count, 3)) < 0.2
    places[near] = (np.array(grid.origin) + (1 << extent_bits) * rng.integers(0, 2, (count, 3)))[near] - 1
    for positions in (places, np.asfortranarray(places)):
        compiled, plain = both(lambda engine, positions=positions: engine.grid_features(grid, positions))
        assert same(compiled, plain)


def test_bits_of_a_grid_must_lie_in_one_piece() -> None:
    """A table in Fortran order would be read in the wrong order, and past its end in another type."""
    level = GridLevel(0, 3, 6, 2)
    for bits in (np.zeros((level.entries, 2), np.int64), np.zeros((2, level.entries), np.uint8).T):
        with pytest.raises(TypeError):
            grid_features(library(), HashGrid((0, 0, 0), 4, (level,), (bits,)), np.zeros((1, 3), np.int64))


@settings(deadline=None, max_examples=150)
@given(
    SEEDS,
    st.one_of(st.integers(1, 40), st.just(700)),
    st.builds(
        Inputs,
        classes=st.integers(0, MAX_CLASSES),
        own=st.booleans(),
        attributes=st.integers(0, 12),
        depths=st.integers(0, 4),
        latents=st.integers(0, 64),
        latent_shift=st.integers(0, 24),
        grid=st.integers(0, 9),
    ),
    st.sampled_from([127, 511, 2047]),
)
def test_inputs_of_the_index_network(seed: int, count: int, inputs: Inputs, amax: int) -> None:
    """Every column, clamped, of some of the anchors in any order."""
    rng = np.random.default_rng(seed)
    codes = random_codes(rng, count, 3)
    cells = CellMeans(codes, depth_shifts(codes, 3, [300, 12, 3, 1][: inputs.depths]))
    rows = rng.permutation(count)
    settled = spread(rng, (count, inputs.attributes), FINE_LIMIT)
    known, values = rng.permutation(count)[: count // 2], spread(rng, (count, inputs.latents), 1 << 22)
    grid = rng.integers(-127, 128, (count, inputs.grid)).astype(np.int16)
    context: Any = SimpleNamespace(classes=rng.integers(0, MAX_CLASSES, count), rows=rows.__getitem__)
    network: Any = SimpleNamespace(inputs=inputs, amax=amax)
    nothing: Any = SimpleNamespace()
    coder = IndexCoder(network, nothing, nothing, nothing)
    columns = inputs.attributes + inputs.latents
    part = rng.permutation(count)[: rng.integers(0, count + 1)]

    def act(engine: Engine) -> Any:
        means = engine.cell_sums(cells, columns)
        means.add(rows[known], np.concatenate([settled, values], axis=1)[known])
        made = index_inputs.embedding_inputs if isinstance(means, KernelCellSums) else embedding_inputs
        return made(coder, Around(context, settled, means, grid), part)

    compiled, plain = both(act)
    assert compiled.shape == (len(part), inputs.width)
    assert same(compiled, plain)
