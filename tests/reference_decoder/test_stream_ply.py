"""Streaming export: the same file as exporting the whole scene at once, in bounded memory."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from reference_decoder import decode as decode_module
from reference_decoder.decode import decode
from reference_decoder.stream_ply import export_ply
from scarfmt.coding.writer import write_scene
from scarfmt.errors import InvalidInput, Malformed
from scarfmt.formats.export_ply import write_inria_ply
from scarfmt.scene.gaussians import GaussianScene

CORNERS = np.array([-1.5, 0.25, 3.0]), np.array([-1.0, 0.75, 3.5])


@pytest.mark.parametrize(
    "arguments", [{}, {"layers": 1}, {"tiles": [2, 0]}, {"box": CORNERS}, {"box": (CORNERS[1] + 9, CORNERS[1] + 10)}]
)
def test_streamed_file_is_that_of_the_whole_scene(arguments: dict[str, object]) -> None:
    for seed in range(4):
        data = write_scene(random_scene(seed, anchors=300, sh_degree=seed))
        whole, streamed = io.BytesIO(), io.BytesIO()
        scene = decode(data, **arguments).scene  # type: ignore[arg-type]
        assert isinstance(scene, GaussianScene)
        write_inria_ply(scene, whole, comments=["note"])
        count = export_ply(data, streamed, comments=["note"], **arguments)  # type: ignore[arg-type]
        assert count == len(scene)
        assert streamed.getvalue() == whole.getvalue()


def test_tiles_are_written_before_the_next_is_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows are written as each tile comes, which bounds the memory."""
    data = write_scene(random_scene(6, anchors=400, tiles=6))
    events: list[str] = []
    part = decode_module.Decoding._part

    def noted(self: object, *arguments: object) -> object:
        events.append("decode")
        return part(self, *arguments)  # type: ignore[arg-type]

    class Target(io.BytesIO):
        def write(self, rows: object) -> int:
            events.append("write")
            return super().write(rows)  # type: ignore[arg-type]

    monkeypatch.setattr(decode_module.Decoding, "_part", noted)
    export_ply(data, Target(), threads=1)
    tiles = [event for event in events if event == "decode"]
    assert events[1:] == ["decode", "write"] * len(tiles)


def test_file_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    data = write_scene(random_scene(3, anchors=300))
    damaged = bytearray(data)
    damaged[-5] ^= 1
    with pytest.raises(Malformed):
        export_ply(bytes(damaged), path)
    with pytest.raises(InvalidInput):
        export_ply(data, path, comments=["two\nlines"])
    assert list(tmp_path.iterdir()) == []
    export_ply(data, path)
    with pytest.raises(InvalidInput) as caught:
        export_ply(data, path)
    assert caught.value.refusal == "output-exists"
