"""Scans see what a reader of everything sees, and count every Gaussian once; no tile of the scene is in two ranges."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference_encoder.out_of_core.scan import (
    DEEPER,
    END,
    Cells,
    bounds_of,
    count_chunk,
    counts_in,
    divide,
    find_crowded,
    first_cells,
    partition,
    scan_chunk,
)
from reference_encoder.out_of_core.source import find_inputs
from reference_encoder.out_of_core.work_dir import WorkDir
from reference_encoder.rdo.lattice import cut_cubes
from scarfmt.arrays import U64
from scarfmt.errors import InputWarning, InvalidInput
from scarfmt.formats.clean import clean
from scarfmt.limits import MAX_TILE_DEPTH
from scarfmt.scene.gaussians import GaussianScene
from tests.reference_encoder.out_of_core.scenes import clusters, ply_of
from tests.samples.codec_samples import refuses


def spoiled(name: str, row: int, value: float) -> GaussianScene:
    scene = clusters(30)
    values = getattr(scene, name).copy()
    values.reshape(30, -1)[[row, 25], 0] = value
    scene = replace(scene, **{name: values})
    scene.opacity_logits[[2, 28]] = np.inf
    return scene


def test_bounds_are_those_of_all_positions(tmp_path: Path) -> None:
    scene = clusters(100, degree=2)
    chunks = find_inputs(ply_of(scene, tmp_path), 9).chunks
    bounds = bounds_of([scan_chunk(chunk) for chunk in chunks], False, None)
    assert bounds.low == tuple(scene.positions.min(axis=0))
    assert bounds.high == tuple(scene.positions.max(axis=0))
    assert (bounds.count, bounds.sh_degree) == (100, 2)
    assert [bounds_of([scan_chunk(chunk) for chunk in chunks], False, most).sh_degree for most in (1, 3)] == [1, 2]


@pytest.mark.parametrize(
    ("name", "value"), [("positions", np.nan), ("log_scales", np.inf), ("opacity_logits", np.nan), ("sh", 2.0**21)]
)
def test_what_cannot_be_encoded_is_refused_by_its_row(tmp_path: Path, name: str, value: float) -> None:
    """As in memory, with the row that a person finds in the file; or left out where asked for."""
    scene = spoiled(name, 17, value)
    scans = [scan_chunk(chunk) for chunk in find_inputs(ply_of(scene, tmp_path), 8).chunks]
    with pytest.raises(InvalidInput) as whole:
        clean(scene)
    refuses(whole.value.refusal, lambda: bounds_of(scans, False, None), r"row 17 of .*scene\.ply")
    with pytest.warns(InputWarning) as expected:
        cached, dropped = clean(scene, drop_invalid=True)
    with pytest.warns(InputWarning) as told:
        bounds = bounds_of(scans, True, None)
    assert [str(each.message) for each in told] == [str(each.message) for each in expected]
    assert (bounds.count, dropped) == (28, 2)
    assert bounds.low == tuple(cached.positions.min(axis=0))


def test_a_scene_of_nothing_is_refused(tmp_path: Path) -> None:
    """No rows, or none that can be encoded."""
    empty = clusters(0)
    bad = replace(empty, **{name: getattr(spoiled("sh", 0, np.nan), name)[:1] for name in empty.arrays()})
    for scene, message in ((empty, "no Gaussians"), (bad, "nothing is left")):
        chunks = find_inputs(ply_of(scene, tmp_path, f"{len(scene)}.ply"), 8).chunks
        refuses("input-empty", partial(bounds_of, [scan_chunk(chunk) for chunk in chunks], True, None), message)


def test_counts_of_chunks_add_up_and_crowded_cells_are_counted_deeper(tmp_path: Path) -> None:
    scene = clusters(2000)
    chunks = find_inputs(ply_of(scene, tmp_path), 300).chunks
    bounds = bounds_of([scan_chunk(chunk) for chunk in chunks], False, None)
    work = WorkDir(str(tmp_path / "work"))

    def counted(depth: int, within: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        names = [f"counts/{depth}-{chunk.number}" for chunk in chunks]
        for name, chunk in zip(names, chunks, strict=True):
            count_chunk(work, name, chunk, bounds, chunk.number % 2 == 0, depth, within)
        return counts_in(work, names)

    cells = first_cells(*counted(3), 3)
    full = find_crowded(cells, 200)
    assert len(full)
    deeper = divide(cells, *counted(3 + DEEPER, full))
    assert deeper.count.sum() == cells.count.sum() == 2000
    paths = np.sort(bounds.paths(scene.positions))
    past = deeper.first + (np.uint64(1) << (3 * (MAX_TILE_DEPTH - deeper.depth)).astype(np.uint64))
    assert (np.searchsorted(paths, past) - np.searchsorted(paths, deeper.first) == deeper.count).all()
    assert (past[:-1] <= deeper.first[1:]).all()
    assert len(deeper.first) > len(cells.first)


def cells_of(paths: U64, depth: int) -> Cells:
    codes, counts = np.unique(paths >> np.uint64(3 * (MAX_TILE_DEPTH - depth)), return_counts=True)
    return first_cells(codes, counts, depth)


def paths_of(count: int, seed: int) -> U64:
    """Most in a small part of space, some everywhere."""
    rng = np.random.default_rng(seed)
    near = (np.int64(1) << 40) + rng.integers(0, 1 << 30, count)
    far = rng.integers(0, END, count)
    return np.sort(np.where(rng.random(count) < 0.7, near, far)).astype(np.uint64)


@given(st.integers(1, 3000), st.integers(0, 5), st.integers(1, 500), st.integers(1, 200), st.sampled_from([2, 10, 21]))
def test_no_tile_is_in_two_ranges(count: int, seed: int, size: int, tile: int, depth: int) -> None:
    """Tiles as a split of everything makes them; what is finer than the cells is divided within its range."""
    paths = paths_of(count, seed)
    ranges = partition(cells_of(paths, depth), size, tile)
    assert [one.number for one in ranges] == list(range(len(ranges)))
    assert (ranges[0].first, ranges[-1].past) == (0, END)
    assert [one.past for one in ranges[:-1]] == [one.first for one in ranges[1:]]
    borders = np.array([one.first for one in ranges] + [END - 1], np.uint64)
    held = np.diff(np.searchsorted(paths, borders[:-1]), append=count)
    assert [one.count for one in ranges] == held.tolist()
    assert min(held) > 0
    depths, prefixes, _ = cut_cubes(paths, MAX_TILE_DEPTH, tile)
    free = (3 * (MAX_TILE_DEPTH - depths)).astype(np.uint64)
    inside = [(prefixes << free < border) & (border < (prefixes + np.uint64(1)) << free) for border in borders[1:-1]]
    assert not np.any(inside)


def test_ranges_hold_about_what_they_should() -> None:
    """At most what was asked for and a tile, and no more ranges than needed."""
    ranges = partition(cells_of(paths_of(100_000, 1), 14), 10_000, 100)
    assert len(ranges) == 10
    assert max(one.count for one in ranges) <= 10_000 + 2 * 100


@pytest.mark.parametrize("size", [300, 20])
def test_one_place_that_holds_everything_is_divided(size: int) -> None:
    """An outlier can leave all others in one cell of the first count."""
    paths = np.sort(np.append(np.arange(2000, dtype=np.uint64) << np.uint64(12), np.uint64(END - 1)))
    cells = cells_of(paths, 2)
    while len(full := find_crowded(cells, size)):
        depth = int(cells.depth.max()) + 5
        codes = paths >> np.uint64(3 * (MAX_TILE_DEPTH - depth))
        codes = codes[np.isin(codes >> np.uint64(15), full)]
        cells = divide(cells, *np.unique(codes, return_counts=True))
    ranges = partition(cells, size, 10)
    assert max(one.count for one in ranges) <= size + 8
    assert sum(one.count for one in ranges) == 2001


def test_what_lies_in_one_point_stays_together() -> None:
    """Nothing tells such Gaussians apart: their range holds more than was asked for."""
    cells = cells_of(np.full(500, 77, np.uint64), MAX_TILE_DEPTH)
    assert not len(find_crowded(cells, 10))
    assert [one.count for one in partition(cells, 10, 10)] == [500]
