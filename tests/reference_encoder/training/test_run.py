"""Training end to end on a tiny capture: the file is what was learnt, whatever interrupts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import scarfmt
from reference_decoder.anchors import gaussians
from reference_encoder.training import photo_store, run, smallest
from reference_encoder.training.capture import Capture
from reference_encoder.training.device import reproducible
from reference_encoder.training.evaluate import draw
from reference_encoder.training.options import Suspended, TrainOptions
from reference_encoder.training.presets import PRESETS
from reference_encoder.training.run import make_trainer, train
from reference_encoder.training.run_folder import DRAFT, HELD_OUT, discard_checkpoints, read_log
from reference_encoder.training.smallest import smallest_file
from scarfmt.coding.writer import write_scene
from scarfmt.errors import InputWarning
from scarfmt.render.rasterise import render
from tests.reference_encoder.training import captures

OPTIONS = TrainOptions(iterations=40, layers=3)


@pytest.mark.parametrize("preset", ["default", "rvq"])
def test_the_file_is_what_was_learnt(capture: Capture, preset: str) -> None:
    """Decoded by the reference decoder and drawn by the renderer that measures, every layer is training's picture."""
    trainer = make_trainer(capture, replace(OPTIONS, preset=preset))
    for iteration in range(40):
        trainer.step(iteration / 40)
    trainer.finish()
    data = smallest_file(trainer.quantise(), trainer.joint)
    camera = capture.test[0].camera
    for layer in range(3):
        model = scarfmt.decode(scarfmt.truncate(data, layer + 1)).scene
        made = gaussians(model, camera.centre)
        picture = render(made.scene, camera, colours=made.colours.astype(np.float64))
        mine = draw(trainer.state, camera, layer, torch.zeros(3)).numpy()
        assert np.abs(picture - mine).max() < 0.02


def test_large_photos_are_learnt_at_half_their_size_first(capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """Small ones are not: what they show at half their size would have to be learnt again."""
    trainer = make_trainer(capture, OPTIONS)
    assert trainer.small is trainer.views
    monkeypatch.setattr(photo_store, "_LEAST_HALF", captures.WIDTH // 2)
    trainer = make_trainer(capture, OPTIONS)
    smaller = [view.read().shape for view in trainer.small]
    assert smaller == [(captures.HEIGHT // 2, captures.WIDTH // 2, 3)] * len(capture.train)
    for done in (0.0, 0.9):
        trainer.step(done)


def test_a_stopped_training_leaves_a_file_and_goes_on_to_the_same_end(capture: Capture, tmp_path: Path) -> None:
    """A run that was stopped half way and taken up again ends with the bytes of one that was left alone.

    With iterations, nothing but the options decides the bytes; another seed gives others.
    """
    options = replace(OPTIONS, iterations=30, layers=2)
    whole = train(capture, options, tmp_path / "whole")
    half = train(capture, options, tmp_path / "halves", stop=After(17))
    assert half.iterations == 17
    assert len(scarfmt.inspect(half.data)["layers"]) == 2
    assert train(capture, options, tmp_path / "halves").data == whole.data
    assert train(capture, replace(options, seed=1)).data != whole.data
    assert train(capture, options, tmp_path / "whole", stop=After(1)).data == whole.data  # nothing is left to do


@pytest.mark.parametrize("preset", list(PRESETS))
def test_in_slices_every_preset_ends_with_the_bytes_of_one_that_was_left_alone(
    capture: Capture, tmp_path: Path, preset: str
) -> None:
    """A slice leaves a checkpoint and no file; each goes on by one iteration at least, however short it is. What else
    the process does in between, also with the number of threads, changes nothing."""

    def meddle(_progress: object) -> None:
        torch.set_num_threads(1 + torch.get_num_threads() % 2)
        torch.manual_seed(0)

    options = replace(OPTIONS, iterations=24, layers=2, preset=preset)
    whole = train(capture, options)
    for done in (7, 14, 21):
        with pytest.raises(Suspended) as caught:
            train(capture, options, tmp_path, meddle, leave=After(7))
        assert caught.value.progress.iteration == done
    assert train(capture, options, tmp_path, leave=After(7)).data == whole.data


def test_who_is_cut_off_while_the_file_is_made_has_a_draft_and_goes_on(
    capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The draft is a whole file of the same scene."""
    options = replace(OPTIONS, iterations=12, layers=2)

    def cut_off(*_args: object, **_more: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(smallest, "with_predictors", cut_off)
        with pytest.raises(KeyboardInterrupt):
            train(capture, options, tmp_path)
    draft = (tmp_path / DRAFT).read_bytes()
    assert scarfmt.validate(draft).valid
    whole = train(capture, options, tmp_path)
    assert train(capture, options).data == whole.data
    kept, written = (scarfmt.decode_scene(data) for data in (draft, whole.data))
    assert np.array_equal(kept.anchors, written.anchors)
    discard_checkpoints(tmp_path)
    assert not (tmp_path / DRAFT).exists()


def test_a_file_says_what_was_held_out_and_whether_it_converged(
    capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = replace(OPTIONS, iterations=12, layers=2)
    names = [photo.camera.name for photo in capture.test]
    with pytest.warns(InputWarning, match=r"not converged: 12 iterations saw each photo 2\.0 times"):
        short = train(capture, options, tmp_path)
    assert (list(short.held_out), short.converged) == (names, False)
    found = scarfmt.inspect(short.data, metadata=True)["metadata"]["training"]
    assert found == {"iterations": 12, "held_out": names, "converged": False}
    assert (tmp_path / HELD_OUT).read_text().split() == names
    monkeypatch.setattr(run, "_LEAST_SEEN", 1)
    monkeypatch.setattr(run, "_LEAST_ITERATIONS", 1)
    assert train(capture, options).converged


@pytest.mark.parametrize("preset", list(PRESETS))
def test_the_same_scene_with_any_number_of_threads(capture: Capture, preset: str) -> None:
    """Of more anchors than torch sums up by one thread."""
    points = np.random.default_rng(0).normal(size=(3000, 3)) * 0.4
    many, files = replace(capture, points=points), []
    for threads in (1, 4):
        with reproducible(torch.device("cpu")):
            trainer = make_trainer(many, replace(OPTIONS, layers=2, preset=preset))
            torch.set_num_threads(threads)
            for iteration in range(12):
                trainer.step(iteration / 12)
            trainer.finish()
            files.append(write_scene(trainer.quantise()))
        torch.set_num_threads(1)
    assert files[0] == files[1]


def test_pictures_beside_their_photos_are_told_once_and_in_the_log(
    capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """When a quarter of the run is over and each photo was seen; before, nothing has found its place."""
    monkeypatch.setattr(run, "_CHECK_ITERATIONS", 5)
    monkeypatch.setattr(run, "_LEAST_SEEN", 0)
    monkeypatch.setattr(run, "displacement", lambda pairs: 0.1 * sum(1 for _ in pairs))
    with pytest.warns(InputWarning, match=r"0\.60 pixels") as told:
        trained = train(capture, replace(OPTIONS, iterations=20, layers=2), tmp_path)
    assert len([one for one in told if "pixels" in str(one.message)]) == 1
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
