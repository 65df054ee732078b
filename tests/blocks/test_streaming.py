"""STREAMING blocks come back, are refused if they have no meaning, and never disturb a decode."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from scarfmt.blocks.streaming import Streaming, View, pack_streaming, read_streaming
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockFlag, BlockKind, Profile
from scarfmt.container.source import BytesSource
from scarfmt.tools.models_report import describe_streaming
from scarfmt.tools.truncate import truncate

VIEW = View(np.array([1.0, 2.0, 3.0]), np.zeros(3), np.array([0.0, -1.0, 0.0]), 0.75)


def random_boxes(tiles: int, view: View | None = VIEW, seed: int = 0) -> Streaming:
    """Random numbers."""
    draw = np.random.default_rng(seed)
    corners = np.sort(draw.integers(0, 256, (2, tiles, 3)), axis=0).astype(np.uint8)
    return Streaming(corners[0], corners[1], draw.integers(0, 256, tiles).astype(np.uint8), view)


def equal(a: Streaming, b: Streaming) -> bool:
    """Whether both have the same values, and boxes of the same shape."""
    return pack_streaming(a) == pack_streaming(b) and a.low.shape == b.low.shape and a.high.shape == b.high.shape


def opened(data: bytes) -> Container:
    return Container(BytesSource(data))


@pytest.mark.parametrize("profile", list(Profile))
def test_the_writer_puts_it_in_for_readers_who_ask(profile: Profile) -> None:
    """A file without has none."""
    scene = random_scene(4, profile, anchors=40, tiles=4)
    made = random_boxes(len(scene.tiles))
    data, with_block = write_scene(scene), write_scene(replace(scene, streaming=made))
    found = read_streaming(opened(with_block))
    assert found is not None
    assert equal(found, made)
    assert read_streaming(opened(data)) is None
    entry = opened(with_block).find(BlockKind.STREAMING, 1)
    assert entry is not None
    assert (entry.flags, entry.count) == (BlockFlag.SAFE_TO_COPY, len(scene.tiles))


def test_a_cut_file_keeps_the_block() -> None:
    """SPEC §14, byte for byte."""
    scene = random_scene(5, anchors=50)
    made = random_boxes(len(scene.tiles))
    made.low[:], made.high[:] = 0, (0, 255, 255)
    cut = opened(truncate(BytesSource(write_scene(replace(scene, streaming=made))), 1))
    found, report = read_streaming(cut), describe_streaming(cut)
    assert found is not None
    assert equal(found, made)
    assert report is not None
    assert report["box_share"] == 1 / 256


def test_a_source_that_does_not_reach_it_tells_nothing() -> None:
    """An open download is no fault."""
    scene = random_scene(6, anchors=20)
    data = write_scene(replace(scene, streaming=random_boxes(len(scene.tiles))))
    container = opened(data)
    entry = container.find(BlockKind.STREAMING, 1)
    assert entry is not None
    cut = Container(BytesSource(data[: entry.end - 1]), allow_truncated=True)
    assert read_streaming(cut) is None
    assert describe_streaming(cut) is None
