"""Regions: boxes have the volume they are said to have, and their bytes are those that decoding them reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.regions import TILES, markdown, shares, spread
from benchmarks.regions_jobs import CORE, PLACES, boxes, choose, sizes, times
from benchmarks.scaling_scenes import recut
from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode
from reference_encoder.tuning import LARGE_SCENE_TILE_ANCHORS, TILE_ANCHORS
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import write_scene
from scarfmt.container.header import header_length
from scarfmt.container.source import BytesSource, FileSource
from scarfmt.counters import Counters

COUNTS = [(0.01, 5), (0.1, 3)]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("regions") / "a.scar"
    path.write_bytes(write_scene(recut(random_scene(6, anchors=600, tiles=4), 60)))
    return path


@pytest.mark.parametrize("share", [0.01, 0.1, 1.0])
@pytest.mark.parametrize("place", PLACES)
def test_boxes_have_their_share_of_the_volume(place: str, share: float) -> None:
    positions = np.random.default_rng(0).normal(size=(500, 3)) * (1, 2, 5)
    low, high = positions.min(axis=0), positions.max(axis=0)
    if place != "whole":
        low, high = np.percentile(positions, CORE, axis=0)
    found = np.array(boxes(positions, share, place, 7))
    assert found.shape == (7, 2, 3)
    assert np.prod(found[:, 1] - found[:, 0], axis=1) == pytest.approx(share * np.prod(high - low))
    centres = found.mean(axis=1)
    assert ((centres >= low - 1e-9) & (centres <= high + 1e-9)).all()
    if place == "anywhere":
        assert ((found[:, 0] >= low - 1e-9) & (found[:, 1] <= high + 1e-9)).all()
    else:
        assert np.abs(centres[:, None] - positions).max(axis=2).min(axis=1).max() < 1e-9


def test_boxes_do_not_depend_on_the_order_of_anchors() -> None:
    positions = np.random.default_rng(1).random((200, 3))
    for place in PLACES:
        assert boxes(positions, 0.1, place, 4) == boxes(positions[::-1], 0.1, place, 4)
        assert boxes(positions, 0.1, place, 4) != boxes(positions, 0.1, place, 4, seed=1)


def test_counted_bytes_are_those_that_a_decode_reads(file: Path) -> None:
    """Header, directory, models and the tiles met: nothing between them is read to save a request."""
    regions = choose({"file": str(file), "counts": COUNTS})["regions"]
    told = sizes({"file": str(file), "regions": regions})
    header = SceneReader(BytesSource(file.read_bytes())).header
    # The first read of a header takes as much as the longest may have.
    again = min(told["file_bytes"], header_length(16)) - header.header_length
    some = 0
    for region, size in zip(regions, told["regions"], strict=True):
        for box, length, inside in zip(region["boxes"], size["bytes"], region["anchors"], strict=True):
            counters = Counters()
            with FileSource(file) as source:
                part = decode(source, box=box, counters=counters)
            assert counters.bytes_read == length + again
            assert len(part) == round(inside * header.anchor_count)
            some += counters.bytes_read < told["file_bytes"]
    assert some


def test_file_bytes_are_told_whole(file: Path) -> None:
    told = sizes({"file": str(file), "regions": []})
    assert told["file_bytes"] == file.stat().st_size == told["front_bytes"] + sum(told["layer_bytes"])
    assert 0 < told["model_bytes"] < told["layer_bytes"][0] + sum(told["layer_bytes"][1:])


def test_a_box_takes_fewer_symbols_than_the_whole(file: Path) -> None:
    regions = choose({"file": str(file), "counts": COUNTS[:1]})["regions"]
    told = times({"file": str(file), "regions": regions})
    for region, measured in zip(regions, told["regions"], strict=True):
        assert len(measured["cpus"]) == len(measured["reads"]) == len(region["boxes"])
        assert all(count <= told["symbols"] for count in measured["symbols"])
    assert min(count for measured in told["regions"] for count in measured["symbols"]) < told["symbols"]


def test_the_encoders_own_size_is_measured() -> None:
    assert {TILE_ANCHORS, LARGE_SCENE_TILE_ANCHORS} <= set(TILES)
    assert max(TILES) == TILES[0]


def _run(most: int, cost: float) -> dict[str, Any]:
    kinds = [(place, share) for place in PLACES for share in (0.01, 0.1)]
    lists = {"bytes": [10, 1000 * cost], "cpus": [0.1, cost], "symbols": [1, 2]}
    regions = [
        {"place": p, "share": s, **{field: spread(values) for field, values in {"anchors": [s, s], **lists}.items()}}
        for p, s in kinds
    ]
    file = {"file_bytes": 1000, "layer_bytes": [400, 500], "front_bytes": 100, "model_bytes": 50, "tiles": 3}
    named = {"scene": "a", "coded": "static", "most": most, "anchors": 9}
    return {**named, **file, "cpu": 2.0, "opening": 0.1, "symbols": 4, "regions": regions}


def test_tables_mark_what_keeps_to_the_target() -> None:
    text = markdown({"1": _run(1024, 0.03), "2": _run(32768, 0.5)})
    assert text.index("| 32,768 |") < text.index("| 1,024 |")
    assert "| 1,024 | **2.0%** / 3%" in text
    assert "| 32,768 | 25.5% / 50%" in text
    assert shares(_run(1024, 0.5), "whole", 0.1, "symbols") == {"median": 0.375, "mean": 0.375, "worst": 0.5}


def test_a_spread_is_median_mean_and_worst() -> None:
    assert spread([1.0, 2.0, 9.0]) == {"median": 2.0, "mean": 4.0, "worst": 9.0}
    assert spread([1234567]) == {"median": 1234600.0, "mean": 1234600.0, "worst": 1234600.0}
