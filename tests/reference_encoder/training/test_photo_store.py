"""Photos in a file: the pixels that a capture has, at either size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from reference_encoder.training import photo_store
from reference_encoder.training.capture import Capture, pixels
from reference_encoder.training.photo_store import half_size, store_photos
from tests.reference_encoder.training import captures


def test_pixels_come_back_in_any_order(capture: Capture, tmp_path: Path) -> None:
    """And nothing is left in the folder, even if the process is killed."""
    views = store_photos(capture.photos, tmp_path / "run")
    for index in (7, 0, 3, 0):
        assert np.array_equal(views[index].photo(torch.device("cpu")), pixels(capture.photos[index]))
    assert list((tmp_path / "run").iterdir()) == []


def test_half_of_large_photos_is_their_mean(capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """Small ones have none: what they show would have to be learnt again."""
    views = store_photos(capture.photos, None)
    assert half_size(views) == []
    monkeypatch.setattr(photo_store, "_LEAST_HALF", captures.WIDTH // 2)
    small = half_size(views)
    assert [view.camera.width for view in small] == [captures.WIDTH // 2] * len(views)
    expected = views[2].read().double().reshape(captures.HEIGHT // 2, 2, captures.WIDTH // 2, 2, 3).mean(dim=(1, 3))
    assert (small[2].read() - expected).abs().max() <= 1.0
