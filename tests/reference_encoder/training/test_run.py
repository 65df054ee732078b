"""Training end to end on a tiny capture: the file is what was learnt, whatever interrupts."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import scarfmt
from reference_decoder.anchors import gaussians
from reference_encoder.training import run
from reference_encoder.training.capture import Capture, load_capture
from reference_encoder.training.curriculum import moment
from reference_encoder.training.evaluate import drawn
from reference_encoder.training.log import read_log
from reference_encoder.training.options import LeftOff, TrainOptions
from reference_encoder.training.recipe import RECIPES, Recipe
from reference_encoder.training.run import begun, halves, layer_sizes, smallest, train
from scarfmt.errors import InputWarning, InvalidInput
from scarfmt.render.rasterise import render
from tests.reference_encoder.training import captures

OPTIONS = TrainOptions(iterations=40, layers=3)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    """Eight small photos of a few Gaussians."""
    return load_capture(captures.own(tmp_path_factory.mktemp("capture")), hold_out=4)


@pytest.mark.parametrize("preset", ["default", "rvq"])
def test_the_file_is_what_was_learnt(capture: Capture, preset: str) -> None:
    """Decoded by the reference decoder and drawn by the renderer that measures, every layer is training's picture."""
    trainer = begun(capture, replace(OPTIONS, preset=preset))
    for iteration in range(40):
        trainer.step(iteration / 40)
    trainer.settle()
    data = smallest(trainer.written(), trainer.joint).data
    camera = capture.test[0].camera
    for layer in range(3):
        model = scarfmt.decode(scarfmt.truncate(data, layer + 1)).scene
        made = gaussians(model, camera.centre)
        picture = render(made.scene, camera, colours=made.colours.astype(np.float64))
        mine = drawn(trainer.state, camera, layer, torch.zeros(3)).numpy()
        assert np.abs(picture - mine).max() < 0.02


def test_large_photos_are_learnt_at_half_their_size_first(capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """Small ones are not: what they show at half their size would have to be learnt again."""
    cpu = torch.device("cpu")
    assert halves(capture.train, cpu) == []
    trainer = begun(capture, OPTIONS)
    assert trainer.small is trainer.views
    monkeypatch.setattr(run, "_LEAST_HALF", captures.WIDTH // 2)
    smaller = [(camera.width, camera.height) for camera, _ in halves(capture.train, cpu)]
    assert smaller == [(captures.WIDTH // 2, captures.HEIGHT // 2)] * len(capture.train)
    trainer = begun(capture, OPTIONS)
    assert len(trainer.small) == len(trainer.views)
    for done in (0.0, 0.5):
        trainer.step(done)


def test_the_same_seed_gives_the_same_file_and_another_one_another(capture: Capture) -> None:
    """With iterations, nothing but the options decides the bytes."""
    files = [train(capture, replace(OPTIONS, seed=seed)).data for seed in (0, 0, 1)]
    assert files[0] == files[1]
    assert files[0] != files[2]


def test_a_stopped_training_leaves_a_file_and_goes_on_to_the_same_end(capture: Capture, tmp_path: Path) -> None:
    """A run that was stopped half way and taken up again ends with the bytes of one that was left alone."""
    options = replace(OPTIONS, iterations=30, layers=2)
    whole = train(capture, options, tmp_path / "whole")
    half = train(capture, options, tmp_path / "halves", stop=After(17))
    assert half.iterations == 17
    assert len(scarfmt.inspect(half.data)["layers"]) == 2
    assert train(capture, options, tmp_path / "halves").data == whole.data
    assert train(capture, options, tmp_path / "whole", stop=After(1)).data == whole.data  # nothing is left to do


def test_a_training_in_slices_ends_like_one_that_was_left_alone(capture: Capture, tmp_path: Path) -> None:
    """A slice leaves a checkpoint and no file; each goes on by one iteration at least, however short it is."""
    options = replace(OPTIONS, iterations=20, layers=2)
    whole = train(capture, options)
    for done in (6, 12, 18):
        with pytest.raises(LeftOff) as caught:
            train(capture, options, tmp_path, leave=After(6))
        assert caught.value.progress.iteration == done
    assert train(capture, options, tmp_path, leave=After(6)).data == whole.data


@pytest.mark.parametrize(
    "changes",
    [
        {"stages": 1, "codewords": 32},
        {"stages": 2, "codewords": 8},
        {"estimator": "straight-through"},
        {"curriculum": "cold"},
    ],
    ids=str,
)
def test_ablations_choose_what_no_preset_says(capture: Capture, changes: dict[str, Any]) -> None:
    """Each recipe gives a sound file, and another one than the preset it changes."""
    options = replace(OPTIONS, iterations=20, layers=2, preset="rvq", entropy="static")
    base = replace(RECIPES["rvq"], codewords=16)
    data = train(capture, options, recipe=replace(base, **changes)).data
    assert scarfmt.validate(data).valid
    assert data != train(capture, options, recipe=base).data


def test_a_run_with_another_recipe_is_not_gone_on_from(capture: Capture, tmp_path: Path) -> None:
    """The anchors of another recipe may have other features."""
    options = replace(OPTIONS, iterations=3)
    train(capture, options, tmp_path)
    with pytest.raises(InvalidInput, match="input-checkpoint"):
        train(capture, options, tmp_path, recipe=Recipe(features=16))


def test_the_loss_has_its_share_of_ssim(capture: Capture) -> None:
    """Between that of L1 alone and that of SSIM alone, as far as the option says."""
    first = {share: begun(capture, replace(OPTIONS, lambda_ssim=share)).step(0.0).loss for share in (0.0, 0.3, 1.0)}
    assert first[0.3] == pytest.approx(0.7 * first[0.0] + 0.3 * first[1.0], rel=1e-4)
    assert first[0.0] != pytest.approx(first[1.0], rel=1e-2)


def test_the_last_layer_is_drawn_as_often_as_said(capture: Capture) -> None:
    """Of 400 layers that the trainer draws, 9 of 10 are the last of two."""
    trainer = begun(capture, replace(OPTIONS, layers=2, last_layer=9.0))
    drawn = [trainer._mode(moment(trainer.curriculum, 0.5)).layer for _ in range(400)]
    assert 340 <= drawn.count(1) <= 380
    assert drawn.count(0) == 400 - drawn.count(1)


def test_pictures_beside_their_photos_are_told_once_and_in_the_log(
    capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """When a quarter of the run is over; before, nothing has found its place."""
    monkeypatch.setattr(run, "_CHECK_ITERATIONS", 5)
    monkeypatch.setattr(run, "displacement", lambda pairs: 0.1 * sum(1 for _ in pairs))
    with pytest.warns(InputWarning, match=r"0\.60 pixels") as told:
        trained = train(capture, replace(OPTIONS, iterations=20, layers=2), tmp_path)
    assert len([one for one in told if one.category is InputWarning]) == 1
    assert len(capture.train) == 6
    assert trained.displacement == pytest.approx(0.6)
    assert [line.get("displacement") for line in read_log(tmp_path)][:3] == [pytest.approx(0.6)] * 3


class After:
    """Asks a run to stop after so many iterations."""

    def __init__(self, iterations: int) -> None:
        self.left = iterations

    def __call__(self) -> bool:
        self.left -= 1
        return self.left <= 0


def test_layers_are_told_as_they_are_in_the_file(capture: Capture) -> None:
    """Bytes of layers are offsets at which the file can be cut."""
    trained = train(capture, OPTIONS)
    assert [layer.bytes for layer in trained.layers] == layer_sizes(trained.data)
    assert trained.layers[-1].bytes == len(trained.data)
    assert all(layer.psnr > 5 for layer in trained.layers)


@pytest.mark.parametrize(
    ("said", "field"),
    [({"context": "grid3d"}, "context"), ({"entropy": "gru"}, "entropy")],
)
def test_what_cannot_be_trained_is_told(capture: Capture, said: dict[str, Any], field: str) -> None:
    """A capture without photos, or with nothing to code, is refused before anything is done."""
    with pytest.raises(InvalidInput) as caught:
        train(capture, replace(OPTIONS, **said))
    assert (caught.value.refusal, caught.value.field) == ("input-options", field)
