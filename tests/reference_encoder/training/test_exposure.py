"""Exposures of photos: found where they differ, and the scene keeps the colours of their mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from reference_encoder.training import exposure, photo_store
from reference_encoder.training.capture import Capture, Photo
from reference_encoder.training.evaluate import quality
from reference_encoder.training.exposure import LIMIT, expose, fit_exposure, spread
from reference_encoder.training.options import TrainOptions
from reference_encoder.training.photo_store import store_photos
from reference_encoder.training.presets import PRESETS
from reference_encoder.training.run import make_trainer
from reference_encoder.training.run_folder import load_checkpoint, save_checkpoint
from reference_encoder.training.trainer import Trainer
from scarfmt.arrays import U8
from scarfmt.coding.writer import write_scene

GAINS, OFFSETS = torch.tensor([[0.7, 0.75, 0.8], [1.3, 1.25, 1.2]]), torch.tensor([[0.05], [-0.05]])


def _fitted(gains: torch.Tensor, offsets: torch.Tensor) -> torch.Tensor:
    """Exposures after thirty looks at each photo of one picture."""
    picture = 0.2 + 0.5 * torch.rand(40, 48, 3, generator=torch.Generator().manual_seed(0))
    photos = [torch.round(255 * (picture * gain + offset)).byte() for gain, offset in zip(gains, offsets, strict=True)]
    exposures = torch.zeros(len(photos), 2, 3)
    for _ in range(30):
        for number, photo in enumerate(photos):
            fit_exposure(exposures, number, picture, photo)
    return exposures


def test_gains_and_offsets_of_photos_are_found() -> None:
    """Somewhat shrunk; a picture then looks like its photo, and gradients reach it through the gain."""
    exposures = _fitted(GAINS, OFFSETS)
    assert torch.allclose(exposures.mean(dim=0), torch.zeros(2, 3), atol=1e-6)
    assert spread(exposures) > LIMIT
    picture = torch.full((2, 2, 3), 0.5, requires_grad=True)
    for number in (0, 1):
        exposed = expose(exposures, number, picture)
        assert torch.allclose(exposed, picture * GAINS[number] + OFFSETS[number], atol=0.02)
    exposed.sum().backward()  # type: ignore[no-untyped-call]
    assert picture.grad is not None
    assert torch.allclose(picture.grad, 1 + exposures[1, 0].expand(2, 2, 3))


def test_photos_that_hardly_differ_are_left_as_they_are() -> None:
    exposures = _fitted(1 + 0.1 * (GAINS - 1), 0 * OFFSETS)
    assert 0 < spread(exposures) < LIMIT
    picture = torch.full((2, 2, 3), 0.5)
    assert expose(exposures, 1, picture) is picture


def test_any_number_of_threads_finds_the_same() -> None:
    """In photos of more pixels than torch sums up by one thread."""
    random = torch.Generator().manual_seed(0)
    picture = torch.rand(300, 400, 3, generator=random)
    photo = torch.randint(0, 256, picture.shape, generator=random, dtype=torch.uint8)
    found = []
    for threads in (1, 2, 4):
        torch.set_num_threads(threads)
        exposures = torch.zeros(20_000, 2, 3)
        fit_exposure(exposures, 5, picture, photo)
        found.append((exposures, spread(exposures)))
    assert all(torch.equal(each, found[0][0]) and value == found[0][1] for each, value in found)


@pytest.fixture
def uneven(capture: Capture, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Gains that the photos are decoded with: of the six learnt from between 0.6 and 1.4, of those held out 1."""
    gains = iter(np.linspace(0.6, 1.4, 6)[[3, 0, 5, 1, 4, 2]])
    by_name = {photo.camera.name: next(gains) for photo in capture.train}
    decoded = photo_store.pixels

    def pixels(photo: Photo) -> U8:
        seen = decoded(photo) * by_name.get(photo.camera.name, 1.0)
        return np.clip(np.round(seen), 0, 255).astype(np.uint8)

    monkeypatch.setattr(photo_store, "pixels", pixels)
    return list(by_name.values())


def _steps(trainer: Trainer, first: int, last: int, count: int) -> Trainer:
    for iteration in range(first, last):
        trainer.step(iteration / count)
    return trainer


def test_a_scene_of_uneven_photos_has_the_colours_of_their_mean(
    capture: Capture, uneven: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gains are found as they were made, and photos that were not learnt from are met better than without."""
    count, black = 240, torch.zeros(3)
    held_out = store_photos(capture.test, None)
    options = TrainOptions(iterations=count, layers=1)
    found = _steps(make_trainer(capture, options), 0, count, count).state
    exposures = found.exposures
    grey = 1 + exposures[:, 0] + 2 * exposures[:, 1]
    assert np.corrcoef(grey.mean(dim=1), uneven)[0, 1] > 0.95
    assert spread(exposures) == pytest.approx(np.std(uneven), rel=0.3)
    monkeypatch.setattr(exposure, "LIMIT", np.inf)
    without = _steps(make_trainer(capture, options), 0, count, count).state
    assert quality(found, held_out, None, black)[0] > quality(without, held_out, None, black)[0] + 0.5


@pytest.mark.parametrize("preset", list(PRESETS))
def test_exposures_go_on_from_a_checkpoint(capture: Capture, uneven: list[float], preset: str, tmp_path: Path) -> None:
    """A run taken up where they are applied already ends as one that was left alone."""
    options = TrainOptions(iterations=60, layers=2, preset=preset)
    whole = _steps(make_trainer(capture, options), 0, 40, 60)
    assert spread(whole.state.exposures) > LIMIT
    save_checkpoint(tmp_path, 40, whole.checkpoint(), "a run")
    loaded = load_checkpoint(tmp_path, "a run")
    assert loaded is not None
    second = make_trainer(capture, options)
    second.resume(loaded[1])
    for trainer in (whole, second):
        _steps(trainer, 40, 60, 60).finish()
    assert torch.equal(whole.state.exposures, second.state.exposures)
    assert write_scene(whole.quantise()) == write_scene(second.quantise())
