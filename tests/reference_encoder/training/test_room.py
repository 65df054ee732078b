"""What a run takes of a machine: told and refused before it begins."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from reference_encoder.training import room
from reference_encoder.training.capture import Capture
from reference_encoder.training.room import check_room, free_disk, free_memory, needed_room
from tests.reference_encoder.training import captures
from tests.samples.codec_samples import refuses


def test_memory_does_not_grow_with_the_number_of_photos(capture: Capture) -> None:
    """Disk does, by three bytes a pixel."""
    once, twice = needed_room(capture), needed_room(replace(capture, photos=capture.photos * 2))
    assert twice[0] == once[0]
    assert (once[1], twice[1]) == tuple(3 * captures.WIDTH * captures.HEIGHT * count for count in (8, 16))


def test_a_capture_that_is_too_large_is_refused_with_a_resolution_that_fits(
    capture: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    check_room(capture, None)
    monkeypatch.setattr(room, "free_disk", lambda _folder: needed_room(capture, 0.5)[1])
    refuses("input-options", lambda: check_room(capture, None), rf"--resolution {captures.WIDTH // 2} would fit")
    monkeypatch.setattr(room, "free_memory", lambda: 1e6)
    refuses("input-options", lambda: check_room(capture, None), "fewer points")


def test_what_is_free_is_known(tmp_path: Path) -> None:
    assert free_memory() > 1e6
    assert free_disk(tmp_path / "not" / "there") == pytest.approx(free_disk(tmp_path), rel=0.1)
