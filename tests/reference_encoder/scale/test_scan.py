"""Scans see what a reader of everything sees, and count every Gaussian once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference_encoder.scale.scan import (
    DEEPER,
    add_counts,
    bounds_of,
    count_chunk,
    counts_in,
    crowded,
    divided,
    first_cells,
    scan_chunk,
)
from reference_encoder.scale.source import inputs_of
from reference_encoder.scale.work import Work
from scarfmt.errors import InvalidInput
from scarfmt.formats.clean import clean
from scarfmt.limits import MAX_TILE_DEPTH
from scarfmt.scene.gaussians import GaussianScene
from tests.reference_encoder.scale.scenes import clusters, ply_of


def spoiled(name: str, row: int, value: float) -> GaussianScene:
    scene = clusters(30)
    values = getattr(scene, name).copy()
    values.reshape(30, -1)[row, 0] = value
    return replace(scene, **{name: values})


def test_bounds_are_those_of_all_positions(tmp_path: Path) -> None:
    scene = clusters(100, degree=2)
    chunks = inputs_of(ply_of(scene, tmp_path), 9).chunks
    bounds = bounds_of([scan_chunk(chunk) for chunk in chunks], False, None)
    assert bounds.low == tuple(scene.positions.min(axis=0))
    assert bounds.high == tuple(scene.positions.max(axis=0))
    assert (bounds.count, bounds.sh_degree) == (100, 2)
    assert bounds_of([scan_chunk(chunk) for chunk in chunks], False, 1).sh_degree == 1


@pytest.mark.parametrize(
    ("name", "value"), [("positions", np.nan), ("log_scales", np.inf), ("opacity_logits", -np.inf), ("sh", 2.0**21)]
)
def test_what_cannot_be_encoded_is_refused_by_its_row(tmp_path: Path, name: str, value: float) -> None:
    """As in memory, with the row that a person finds in the file; or left out where asked for."""
    scene = spoiled(name, 17, value)
    scans = [scan_chunk(chunk) for chunk in inputs_of(ply_of(scene, tmp_path), 8).chunks]
    with pytest.raises(InvalidInput) as whole:
        clean(scene)
    with pytest.raises(InvalidInput, match=r"row 17 of .*scene\.ply") as caught:
        bounds_of(scans, False, None)
    assert caught.value.refusal == whole.value.refusal
    kept, dropped = clean(scene, drop_invalid=True)
    bounds = bounds_of(scans, True, None)
    assert (bounds.count, dropped) == (29, 1)
    assert bounds.low == tuple(kept.positions.min(axis=0))


def test_a_scene_of_nothing_is_refused(tmp_path: Path) -> None:
    """No rows, or none that can be encoded."""
    empty = clusters(0)
    bad = replace(empty, **{name: getattr(spoiled("sh", 0, np.nan), name)[:1] for name in vars(empty)})
    for scene, message in ((empty, "no Gaussians"), (bad, "nothing is left")):
        chunks = inputs_of(ply_of(scene, tmp_path, f"{len(scene)}.ply"), 8).chunks
        with pytest.raises(InvalidInput, match=message) as caught:
            bounds_of([scan_chunk(chunk) for chunk in chunks], True, None)
        assert caught.value.refusal == "input-empty"


def test_counts_of_chunks_add_up_and_crowded_cells_are_counted_deeper(tmp_path: Path) -> None:
    scene = clusters(2000)
    chunks = inputs_of(ply_of(scene, tmp_path), 300).chunks
    bounds = bounds_of([scan_chunk(chunk) for chunk in chunks], False, None)
    work = Work(str(tmp_path / "work"))

    def counted(depth: int, within: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        names = [f"counts/{depth}-{chunk.number}" for chunk in chunks]
        for name, chunk in zip(names, chunks, strict=True):
            count_chunk(work, name, chunk, bounds, chunk.number % 2 == 0, depth, within)
        add_counts(work, "counts/some", names[:3])
        return counts_in(work, ["counts/some", *names[3:]])

    cells = first_cells(*counted(3), 3)
    full = crowded(cells, 200)
    assert len(full)
    deeper = divided(cells, *counted(3 + DEEPER, full))
    assert deeper.count.sum() == cells.count.sum() == 2000
    paths = np.sort(bounds.paths(scene.positions))
    past = deeper.first + (np.uint64(1) << (3 * (MAX_TILE_DEPTH - deeper.depth)).astype(np.uint64))
    assert (np.searchsorted(paths, past) - np.searchsorted(paths, deeper.first) == deeper.count).all()
    assert (past[:-1] <= deeper.first[1:]).all()
    assert len(deeper.first) > len(cells.first)
