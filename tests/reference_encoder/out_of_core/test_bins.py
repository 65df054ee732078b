"""A range holds the Gaussians of its part of space, in the order of the source."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference_encoder.out_of_core.bins import bin_chunk, load_range, write_index
from reference_encoder.out_of_core.scan import END
from reference_encoder.out_of_core.source import find_inputs
from reference_encoder.out_of_core.types import Range
from reference_encoder.out_of_core.work_dir import WorkDir
from scarfmt.formats.clean import keep_edges
from tests.reference_encoder.out_of_core.scenes import binned, clusters, equal, ply_of


@pytest.mark.parametrize("rows", [70, 1000])
@pytest.mark.parametrize("place", ["{}", "file://{}", "memory://bins{}"])
def test_ranges_are_the_scene(tmp_path: Path, rows: int, place: str) -> None:
    """However the source was cut into chunks, wherever they are kept."""
    scene = clusters(1000)
    work = WorkDir(place.format(tmp_path / "work"))
    bounds, ranges, chunks = binned(ply_of(scene, tmp_path), work, rows=rows, range_size=150, tile=40)
    assert len(ranges) > 4
    paths = bounds.paths(scene.positions)
    for one in ranges:
        found = load_range(work, chunks, bounds, one.number)
        inside = (paths >= np.uint64(one.first)) & (paths < np.uint64(one.past))
        assert equal(found, scene.take(inside))
        assert len(found) == one.count


def test_each_chunk_is_one_file(tmp_path: Path) -> None:
    """Not one for each range: thousands of both would be millions of files."""
    work = WorkDir(str(tmp_path / "work"))
    _, ranges, chunks = binned(ply_of(clusters(1000), tmp_path), work, rows=100, range_size=50, tile=20)
    assert len(ranges) > 15
    assert len(work.names("bins")) == chunks + 1 == 11


def test_what_cannot_be_encoded_is_left_out(tmp_path: Path) -> None:
    """As a reader of everything leaves it out."""
    scene = clusters(300)
    logits = scene.opacity_logits.copy()
    logits[[3, 120, 121]], logits[[7, 250]] = np.nan, np.inf
    scene = replace(scene, opacity_logits=logits)
    origin, work = ply_of(scene, tmp_path), WorkDir(str(tmp_path / "work"))
    bounds, _, chunks = binned(origin, work, rows=100, range_size=1000, tile=1000, drop=True)
    assert equal(load_range(work, chunks, bounds, 0), keep_edges(scene)[0].take(~np.isnan(logits)))


@pytest.mark.parametrize(("degree", "coefficients"), [(None, 9), (1, 4)])
def test_files_of_lower_degree_get_zeros(tmp_path: Path, degree: int | None, coefficients: int) -> None:
    (tmp_path / "tiles").mkdir()
    for name, bands in (("a.ply", 0), ("b.ply", 2)):
        ply_of(clusters(50, bands, bands), tmp_path / "tiles", name)
    work, origin = WorkDir(str(tmp_path / "work")), str(tmp_path / "tiles")
    bounds, ranges, chunks = binned(origin, work, rows=20, range_size=1000, tile=1000, degree=degree)
    found = load_range(work, chunks, bounds, ranges[0].number)
    assert found.sh.shape == (100, coefficients, 3)
    assert not found.sh[:50, 1:].any()
    assert equal(found.take(np.arange(50, 100)), clusters(50, 2, 2).with_sh_degree(found.sh_degree))


def test_a_range_of_nothing_in_a_chunk_is_read_as_nothing(tmp_path: Path) -> None:
    """Chunks of one place of the scene have nothing of other ranges."""
    scene = clusters(400)
    order = np.argsort(scene.positions[:, 0], kind="stable")
    work = WorkDir(str(tmp_path / "work"))
    origin = ply_of(scene.take(order), tmp_path)
    bounds, ranges, chunks = binned(origin, work, rows=40, range_size=50, tile=20)
    found = [load_range(work, chunks, bounds, one.number) for one in ranges]
    assert sum(map(len, found)) == 400
    border = int(np.sort(bounds.paths(scene.positions))[150])
    halves = Range(0, 0, border, 150), Range(1, border, END, 250)
    write_index(work, [bin_chunk(work, chunk, bounds, True, halves) for chunk in find_inputs(origin, 40).chunks])
    assert [len(load_range(work, chunks, bounds, half.number)) for half in halves] == [150, 250]
    write_index(work, [np.zeros(2, np.int64)])
    assert len(load_range(work, 1, bounds, 0)) == 0
