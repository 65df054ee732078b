"""Gaussians in parts: together those of the whole scene, in bounded memory."""

from __future__ import annotations

import io

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from reference_decoder.decode import DecodeRequest, decode, decode_scene
from reference_decoder.stream_gaussians import stream_gaussians
from scarfmt.coding.writer import write_scene
from scarfmt.container.source import BytesSource
from scarfmt.errors import InvalidInput, Malformed
from scarfmt.formats.outputs import write_parts
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.scene_files import scene_ply

CORNERS = [-1.5, 0.25, 3.0], [-1.0, 0.75, 3.5]


@pytest.mark.parametrize("native", [True, False])
@pytest.mark.parametrize(
    "fields", [{}, {"layers": 1}, {"tiles": [2, 0]}, {"box": CORNERS}, {"box": ([8.0] * 3, [9.0] * 3)}]
)
def test_a_ply_of_parts_is_that_of_the_whole_scene(fields: dict[str, object], native: bool) -> None:
    for seed in range(4):
        data = write_scene(random_scene(seed, anchors=300, sh_degree=seed))
        request = DecodeRequest(native=native, **fields)  # type: ignore[arg-type]
        scene = decode_scene(data, request)
        assert isinstance(scene, GaussianScene)
        streamed = io.BytesIO()
        described, parts = stream_gaussians(BytesSource(data), request)
        assert write_parts("ply", parts, described, streamed).count == len(scene)
        assert streamed.getvalue() == scene_ply(scene)


def test_parts_are_read_as_they_are_taken() -> None:
    """That bounds the memory: damage to the last tile does not keep back the first."""
    data = bytearray(write_scene(random_scene(6, anchors=400, tiles=6)))
    first = decode(bytes(data)).tiles[0]
    data[-5] ^= 1
    _, parts = stream_gaussians(BytesSource(bytes(data)), DecodeRequest(threads=1))
    assert len(next(parts)) == np.count_nonzero(decode(bytes(data), tiles=[int(first)]).tiles == first)
    with pytest.raises(Malformed, match="CRC-32"):
        list(parts)


def test_all_attributes_are_needed() -> None:
    _, parts = stream_gaussians(BytesSource(write_scene(random_scene(1))), DecodeRequest(attributes=["positions"]))
    with pytest.raises(InvalidInput, match="were left out"):
        next(parts)
