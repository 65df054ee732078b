"""The loop: when masks are decided, what settles when, from where networks look."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from itertools import pairwise

import pytest
import torch

from reference_encoder.training import trainer as module
from reference_encoder.training.capture import Capture, load_capture
from reference_encoder.training.curriculum import Curriculum, moment
from reference_encoder.training.evaluate import quality
from reference_encoder.training.iterate import Mode, iterate
from reference_encoder.training.options import TrainOptions
from reference_encoder.training.recipe import RECIPES
from reference_encoder.training.run import begun, spacing
from reference_encoder.training.similarity import Target
from reference_encoder.training.trainer import Trainer
from tests.reference_encoder.training import captures, small

OPTIONS = TrainOptions(iterations=60, layers=2)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    """Eight small photos of a few Gaussians."""
    return load_capture(captures.own(tmp_path_factory.mktemp("capture")), hold_out=4)


def _decisions(trainer: Trainer, iterations: int) -> list[tuple[int, float]]:
    """Iteration and `Moment.masks` of the decisions of a run in which nothing else happens."""
    taken = []
    for iteration in range(iterations):
        now = moment(trainer.curriculum, iteration / iterations)
        trainer.iteration = iteration
        if trainer._decision_due(now):
            trainer.decided, trainer.decided_at = now.masks, iteration
            taken.append((iteration, now.masks))
    return taken


def test_long_runs_decide_as_often_as_short_ones(capture: Capture) -> None:
    """Parts of the run lie between decisions, so that masks close at the same pace in it, however long it is."""
    for iterations in (4_000, 40_000):
        shares = [masks for _, masks in _decisions(begun(capture, OPTIONS), iterations)]
        assert shares == pytest.approx([(number + 1) / 20 for number in range(19)], abs=0.02)


def test_decisions_leave_values_some_iterations(capture: Capture) -> None:
    """A run too short for all decisions takes fewer."""
    found = [iteration for iteration, _ in _decisions(begun(capture, OPTIONS), 500)]
    assert 2 <= len(found) <= 4
    assert min(late - early for early, late in pairwise(found)) >= 100


def test_the_last_layer_closes_at_an_even_pace(capture: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a decision may close grows with the time since the one before."""
    monkeypatch.setattr(module, "_LEFT", 0.01)
    trainer = begun(capture, replace(OPTIONS, lambda_=1000.0))
    kept: list[float] = []
    follow = trainer.prices.follow

    def told(*args: object) -> list[float]:
        kept.append(args[-1])  # type: ignore[arg-type]
        return follow(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(trainer.prices, "follow", told)
    trainer.step(0.0)
    for masks in (0.5, 0.75):
        trainer._decide_masks(1.0, masks)
    assert kept == pytest.approx([0.1, 0.01**0.25])
    assert (trainer.decided, trainer.decided_at) == (0.75, trainer.iteration)


def test_values_settle_on_their_mean_before_networks_are_fitted(capture: Capture) -> None:
    """Then nothing of an anchor moves any more, and the means of the networks come last."""
    trainer = begun(capture, OPTIONS)
    trainer.decided = 1.0
    seen = []
    for iteration in range(57):
        trainer.step(iteration / 60)
        if trainer.averages.count:
            seen.append(trainer.state.anchors.latent.detach().clone())
    assert len(seen) == 4  # 0.87 to 0.95 of 60
    trainer.step(57 / 60)
    mean = torch.stack(seen).mean(dim=0)
    assert torch.allclose(trainer.state.anchors.latent, mean, atol=1e-6)
    for iteration in (58, 59):
        trainer.step(iteration / 60)
    assert trainer.averages.count == 1
    trainer.settle()
    assert trainer.averages.count == 0
    assert torch.allclose(trainer.state.anchors.latent, mean, atol=1e-6)


def test_a_checkpoint_among_means_goes_on_to_the_same_values(capture: Capture) -> None:
    """Also where half of the mean was taken before an interruption."""
    whole = begun(capture, OPTIONS)
    for iteration in range(55):
        whole.step(iteration / 60)
    kept = deepcopy(whole.checkpoint())
    second = begun(capture, OPTIONS)
    second.resume(kept)
    assert second.averages.count == whole.averages.count == 2
    for trainer in (whole, second):
        for iteration in range(55, 60):
            trainer.step(iteration / 60)
        trainer.settle()
    for name, values in whole.state.descent.parameters.items():
        assert torch.equal(values, second.state.descent.parameters[name]), name


def test_networks_look_from_about_the_camera() -> None:
    """Pictures of a camera change with the place from where networks look; the camera itself stays."""
    camera, black = small.camera(), torch.zeros(3)
    target = Target.of(torch.zeros(camera.height, camera.width, 3, dtype=torch.uint8))
    now = moment(Curriculum(), 0.2)
    losses = []
    for wander in (0.0, 0.0, 0.5, 0.5):
        state = small.state()
        mode = Mode(state.plan.count - 1, replace(now, noisy=False), False, 0.0, 0.2, wander)
        losses.append(iterate(state, camera, target, mode, black).loss)
    assert losses[0] == losses[1] != losses[2] == losses[3]
    assert losses[2] == pytest.approx(losses[0], rel=0.5)


def test_how_far_networks_wander_is_told_by_the_distance_of_cameras(capture: Capture) -> None:
    """Not in the paper's own recipe; and pictures that are measured are taken from where the camera is."""
    eyes = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 2, 0], [1, 2, 4], [9, 9, 9]])
    assert spacing(eyes) == pytest.approx(2.0)
    assert spacing(eyes[:1]) == 0.0
    centres = torch.stack([torch.from_numpy(photo.camera.centre) for photo in capture.train])
    trainer = begun(capture, OPTIONS)
    assert trainer.wander == pytest.approx(RECIPES["default"].wander * spacing(centres))
    assert begun(capture, replace(OPTIONS, preset="paper")).wander == 0.0
    once, again = (quality(trainer.state, trainer.views[:1], None, torch.zeros(3)) for _ in range(2))
    assert once == again
