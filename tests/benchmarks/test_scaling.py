"""Scaling: scenes made of others hold what they should, and slopes are those of the line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.scaling import CODED, SERIES, markdown, points, slope
from benchmarks.scaling_jobs import arrays, rewrite, stream
from benchmarks.scaling_scenes import copies, read_scene, recut, summary, without_networks
from benchmarks.survey_time import laid_out, survey_table
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode
from reference_decoder.decoded import Decoded
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.container.source import BytesSource
from scarfmt.limits import MAX_TILE_DEPTH
from scarfmt.scene.gaussians import GaussianScene


def _sorted(decoded: Decoded) -> np.ndarray:
    """All numbers of all anchors, a row each, in an order that does not depend on tiles."""
    assert decoded.positions is not None
    parts = [
        decoded.positions,
        decoded.classes[:, None],
        *(v.reshape(len(decoded), -1) for v in decoded.values.values()),
    ]
    if decoded.indices is not None:
        parts.append(decoded.indices)
    rows = np.concatenate([np.asarray(part, np.float64) for part in parts], axis=1)
    return rows[np.lexsort(rows.T)]


@pytest.mark.parametrize("profile", Profile)
def test_a_file_read_and_written_again_is_the_same_file(tmp_path: Path, profile: Profile) -> None:
    for seed in (1, 2):
        data = write_scene(neural_scene(seed, profile))
        path = tmp_path / "a.scar"
        path.write_bytes(data)
        again = write_scene(read_scene(path))
        assert SceneReader(BytesSource(again)).header.fields == SceneReader(BytesSource(data)).header.fields
        assert len(again) <= len(data)  # metadata is left out
        assert np.array_equal(_sorted(decode(again)), _sorted(decode(data)))


def test_without_networks_nothing_neural_is_left_and_values_stay() -> None:
    scene = neural_scene(3)
    plain = write_scene(without_networks(scene))
    models = SceneReader(BytesSource(plain)).models()
    assert models.network is None
    assert models.grid is None
    assert not models.predictors[-1]
    assert np.array_equal(_sorted(decode(plain)), _sorted(decode(write_scene(scene))))


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 1000), most=st.integers(5, 80), profile=st.sampled_from(Profile))
def test_smaller_tiles_hold_the_same_anchors(seed: int, most: int, profile: Profile) -> None:
    """Whatever the size, cutting changes no number of any anchor; what cannot be cut again may be above the limit."""
    scene = random_scene(seed, profile, anchors=300, tiles=3)
    cut = recut(scene, most)
    assert len(cut.tiles) >= len(scene.tiles)
    for tile, content in zip(cut.tiles, cut.contents, strict=True):
        bits = cut.fields.lattice_bits - tile.depth - tile.shift
        assert len(content) <= most or bits == 0 or tile.depth == MAX_TILE_DEPTH
    assert np.array_equal(_sorted(decode(write_scene(cut))), _sorted(decode(write_scene(scene))))


def test_tiles_that_are_small_enough_are_left_alone() -> None:
    scene = random_scene(1, anchors=300, tiles=3)
    assert write_scene(recut(scene, 10_000)) == write_scene(scene)


@pytest.mark.parametrize("profile", Profile)
def test_copies_are_as_many_jittered_scenes_side_by_side(profile: Profile) -> None:
    """Each copy has the anchors of every class and the values of the first, elsewhere and in other order."""
    scene = random_scene(2, profile, anchors=400, tiles=2)
    many = copies(scene, 9, seed=1)
    told, once = summary(many), summary(scene)
    assert told == {name: 9 * count for name, count in once.items()}
    whole = decode(write_scene(many))
    assert len(whole) == 9 * once["anchors"]
    size = len(scene.tiles)
    for start in range(size, 9 * size, size):
        for first, copy in zip(scene.contents, many.contents[start : start + size], strict=True):
            assert np.array_equal(np.sort(first.classes), np.sort(copy.classes))
            for a, b in zip(first.values, copy.values, strict=True):
                assert np.array_equal(np.sort(a, axis=0), np.sort(b, axis=0))
        pairs = zip(scene.contents, many.contents[start : start + size], strict=True)
        assert any(not np.array_equal(first.codes, copy.codes) for first, copy in pairs)


def test_copies_are_the_same_each_time_and_lie_apart() -> None:
    scene = random_scene(4, anchors=200, tiles=2)
    data = write_scene(copies(scene, 3, seed=5))
    assert data == write_scene(copies(scene, 3, seed=5))
    decoded = decode(data)
    assert decoded.positions is not None
    copy = decoded.tiles // len(scene.tiles)
    side = decoded.fields.voxel * 2**scene.fields.lattice_bits
    cubes = np.floor((decoded.positions - decoded.fields.origin) / side)
    # A residual may reach half a cell over the border of its cube.
    assert len({tuple(np.median(cubes[copy == number], axis=0)) for number in range(3)}) == 3


def test_jobs_read_a_scene_in_every_way(tmp_path: Path) -> None:
    path, out = tmp_path / "a.scar", tmp_path / "b.scar"
    path.write_bytes(write_scene(neural_scene(1)))
    facts = rewrite({"file": str(path), "out": str(out), "static": True, "tile_anchors": 20, "copies": 2})
    assert facts["bytes"] == out.stat().st_size
    assert facts["anchors"] == len(decode(out)) == 2 * len(decode(path))
    for done in (stream({"file": str(out)}), arrays({"file": str(out), "layers": 1, "runs": 2})):
        assert done["seconds"] == min(done["walls"])


@given(st.floats(-3, 3), st.floats(0.1, 10))
def test_the_slope_of_a_power_is_its_exponent(exponent: float, factor: float) -> None:
    found = slope([(x, factor * x**exponent) for x in (10.0, 30.0, 100.0, 1000.0)])
    assert found == pytest.approx(exponent, abs=1e-9)


def test_one_size_has_no_slope() -> None:
    assert math.isnan(slope([(10.0, 1.0), (10.0, 2.0)]))
    assert math.isnan(slope([]))


def _run(count: int, **more: Any) -> dict[str, Any]:
    way = {"cpu": count / 1e6, "peak_bytes": count * 100}
    told = {"seconds": 0.001, "bytes_read": 2280}
    coded = {"bytes": count * 10, "stream": way, "first": way, "inspect": told, **more}
    return {"scene": "a", "source_count": count, "anchors": count, "static": coded, "neural": coded}


def test_tables_show_every_size_and_only_what_was_measured() -> None:
    """A size without arrays or encoding leaves gaps, not errors; slopes are taken over the others."""
    small = {**_run(200_000, arrays={"cpu": 1.0, "peak_bytes": 1}), "encode": {"1": {"cpu": 3.0, "peak_bytes": 2**20}}}
    large = {**_run(2_000_000), "copies": 4}
    del large["neural"]
    text = markdown({"a 2": large, "a 1": small})
    assert "2,000,000 (copies)" in text
    assert "| 200,000 | 200,000 | 3.00 | 1 | - | - | 2,000,000 | 2,000,000 |" in text
    assert text.index("| 200,000 |") < text.index("| 2,000,000 (copies)")
    assert "| static, tile by tile | 1.00 | 1.00 | 1.00 |" in text
    assert "| neural, tile by tile | - | - | - |" in text
    assert points([small, large], "encode, effort 1", "cpu") == [(200_000.0, 3.0)]
    assert set(CODED) == {series.split(",")[0] for series in SERIES} - {"encode"}


def test_a_scene_laid_out_is_so_many_scenes_apart() -> None:
    """On the ground: nothing is stacked; copies differ from the first by their jitter."""
    random = np.random.default_rng(1)
    zeros = np.zeros((50, 4), np.float32)
    scales = np.full((50, 3), -9, np.float32)
    one = GaussianScene(random.random((50, 3)), scales, zeros, zeros[:, 0], np.zeros((50, 1, 3), np.float32))
    found = laid_out(one, 5, "z")
    assert len(found) == 250
    copies_of = found.positions.reshape(5, 50, 3)
    assert np.array_equal(copies_of[0], one.positions)
    moved = copies_of - one.positions
    middles = np.median(moved, axis=1)
    assert np.abs(middles[:, 2]).max() < 1e-3
    assert len(np.unique(np.round(middles, 2), axis=0)) == 5
    assert (moved[1].std(axis=0) > 0).all()


def test_the_survey_tells_time_a_gaussian() -> None:
    run = {"scene": "s", "copies": 1, "gaussians": 1000, "seconds": 2.0, "cpu": 1.0, "peak_bytes": 2**20}
    text = survey_table({"a": run, "b": {**run, "gaussians": 4000, "cpu": 4.0}})
    assert "| s | 1 | 1,000 | 2.0 | 1.0 | 1000 | 1 |" in text
    assert "Slope of processor time: 1.00" in text
