"""STREAMING blocks come back, are refused if they have no meaning, and never disturb a decode."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzz.testing.scenes import random_scene
from scarfmt.blocks.streaming import (
    Streaming,
    View,
    pack_streaming,
    read_streaming,
    unpack_streaming,
)
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockFlag, BlockKind, Profile
from scarfmt.container.source import BytesSource
from scarfmt.errors import LimitExceeded, Malformed
from scarfmt.limits import MAX_VIEWPOINTS
from scarfmt.tools.annotate import with_streaming
from scarfmt.tools.streaming_report import describe_streaming, format_streaming
from scarfmt.tools.truncate import truncate

VIEW = View(np.array([1.0, 2.0, 3.0]), np.zeros(3), np.array([0.0, -1.0, 0.0]), 0.75)


def told(tiles: int, layers: int, viewpoints: int = 2, view: View | None = VIEW, seed: int = 0) -> Streaming:
    """Random numbers."""
    draw = np.random.default_rng(seed)
    corners = np.sort(draw.integers(0, 256, (2, tiles, 3)), axis=0).astype(np.uint8)
    gains = draw.integers(0, 256, (viewpoints, layers, tiles)).astype(np.uint8)
    reach = draw.integers(0, 256, tiles).astype(np.uint8)
    return Streaming(corners[0], corners[1], reach, draw.normal(size=(viewpoints, 3)).astype(np.float32), gains, view)


def equal(a: Streaming, b: Streaming) -> bool:
    """Whether both have the same values."""
    return pack_streaming(a) == pack_streaming(b)


def opened(data: bytes) -> Container:
    return Container.open(BytesSource(data))


@given(st.integers(0, 40), st.integers(1, 16), st.integers(0, MAX_VIEWPOINTS), st.booleans(), st.integers(0, 99))
def test_what_is_told_comes_back(tiles: int, layers: int, viewpoints: int, view: bool, seed: int) -> None:
    """Every number, also of none."""
    made = told(tiles, layers, viewpoints, VIEW if view else None, seed)
    found = unpack_streaming(pack_streaming(made))
    for name in ("low", "high", "reach", "viewpoints", "gains"):
        assert np.array_equal(getattr(found, name), getattr(made, name)), name
    assert (found.layers, found.tiles, found.view is None) == (layers, tiles, not view)
    if found.view is not None:
        assert found.view.fov == 0.75
        assert found.view.position.tolist() == [1.0, 2.0, 3.0]


def test_it_takes_a_byte_a_gain() -> None:
    """The size is that of decision 0040: seven bytes a tile, one a gain, twelve a viewpoint, and some of its own."""
    size = len(pack_streaming(told(100, 5, 8)))
    assert size == 100 * 7 + 100 * 5 * 8 + 8 * 12 + 40 + 4


@pytest.mark.parametrize(
    "bad",
    [
        replace(told(2, 3), viewpoints=np.full((2, 3), np.nan, np.float32)),
        replace(told(2, 3), view=replace(VIEW, fov=0.0)),
        replace(told(2, 3), view=replace(VIEW, fov=math.pi)),
        replace(told(2, 3), view=replace(VIEW, up=np.array([0.0, math.inf, 0.0]))),
        replace(told(2, 3), low=np.full((2, 3), 9, np.uint8), high=np.full((2, 3), 8, np.uint8)),
        replace(told(2, 3), gains=np.zeros((2, 0, 2), np.uint8)),
        replace(told(2, 3), gains=np.zeros((2, 17, 2), np.uint8)),
    ],
)
def test_what_cannot_be_meant_is_refused(bad: Streaming) -> None:
    """Rule R-7.13-1."""
    with pytest.raises(Malformed) as caught:
        unpack_streaming(pack_streaming(bad))
    assert caught.value.refusal == "bad-streaming"


def test_viewpoints_have_a_limit() -> None:
    with pytest.raises(LimitExceeded):
        unpack_streaming(pack_streaming(told(1, 1, MAX_VIEWPOINTS + 1)))


def test_it_must_fit_the_file() -> None:
    """The block must have as many tiles as the file, and no fewer layers; the offset of the refusal is that of the
    block."""
    scene = random_scene(3, anchors=30)
    data, tiles, layers = write_scene(scene), len(scene.tiles), len(scene.model.layers)
    for other in (told(tiles + 1, layers), told(tiles, layers - 1)):
        container = opened(with_streaming(data, other))
        with pytest.raises(Malformed) as caught:
            read_streaming(container)
        entry = container.find(BlockKind.STREAMING, 1)
        assert entry is not None
        assert (caught.value.refusal, caught.value.offset) == ("bad-streaming", entry.offset)


@pytest.mark.parametrize("profile", list(Profile))
def test_the_writer_and_the_editor_put_it_in_alike(profile: Profile) -> None:
    """Byte for byte, for new and for other information; a file without has none."""
    scene = random_scene(4, profile, anchors=40)
    made = told(len(scene.tiles), len(scene.model.layers))
    data, told_data = write_scene(scene), write_scene(replace(scene, streaming=made))
    assert with_streaming(data, made) == told_data
    assert with_streaming(with_streaming(data, told(len(scene.tiles), 16, 7)), made) == told_data
    found = read_streaming(opened(told_data))
    assert found is not None
    assert equal(found, made)
    assert read_streaming(opened(data)) is None
    entry = opened(told_data).find(BlockKind.STREAMING, 1)
    assert entry is not None
    assert (entry.flags, entry.count) == (BlockFlag.SAFE_TO_COPY, 2)


def test_a_cut_file_keeps_what_is_told_of_all_layers() -> None:
    """SPEC §14, byte for byte: the gains of layers that are cut off are of no use and do no harm."""
    scene = random_scene(5, anchors=50)
    made = told(len(scene.tiles), len(scene.model.layers))
    found = read_streaming(opened(truncate(BytesSource(write_scene(replace(scene, streaming=made))), 1)))
    assert found is not None
    assert equal(found, made)


def test_a_source_that_does_not_reach_it_tells_nothing() -> None:
    """An open download is no fault."""
    scene = random_scene(6, anchors=20)
    data = write_scene(replace(scene, streaming=told(len(scene.tiles), len(scene.model.layers))))
    container = opened(data)
    entry = container.find(BlockKind.STREAMING, 1)
    assert entry is not None
    cut = Container.open(BytesSource(data[: entry.end - 1]), allow_truncated=True)
    assert read_streaming(cut) is None
    assert describe_streaming(cut) is None


def test_the_report_names_what_is_told() -> None:
    """The report has numbers for scripts and lines for people, and nothing if there is no block."""
    scene = random_scene(7, anchors=20)
    made = told(len(scene.tiles), len(scene.model.layers))
    made.gains[:] = 0
    made.gains[:, 0, 0] = 255
    report = describe_streaming(opened(write_scene(replace(scene, streaming=made))))
    assert report is not None
    assert report["bytes"] == len(pack_streaming(made))
    assert report["gain_db"] == [0.0] + [None] * (len(scene.model.layers) - 1)
    assert report["view"]["target"] == [0.0, 0.0, 0.0]
    shown = format_streaming(report)
    assert "2 viewpoints" in shown
    assert "0.0, none" in shown
    assert format_streaming(None).strip().endswith("none")
