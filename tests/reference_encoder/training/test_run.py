"""Training end to end on a tiny capture: the file is what was learnt, whatever interrupts."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import scarfmt
from reference_decoder.anchors import gaussians
from reference_encoder.training.capture import Capture, load_capture
from reference_encoder.training.evaluate import drawn
from reference_encoder.training.options import TrainOptions
from reference_encoder.training.run import begun, layer_sizes, smallest, train
from scarfmt.errors import InvalidInput
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
    """What is not there, or has nothing to code, is refused before anything is done, not left out silently."""
    with pytest.raises(InvalidInput) as caught:
        train(capture, replace(OPTIONS, **said))
    assert (caught.value.refusal, caught.value.field) == ("input-options", field)
