"""The loop: when masks are decided, what settles when, from where networks look."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
import torch

from reference_encoder.training.capture import Capture
from reference_encoder.training.evaluate import quality
from reference_encoder.training.iterate import iterate
from reference_encoder.training.options import TrainOptions
from reference_encoder.training.presets import PRESETS, Curriculum, moment
from reference_encoder.training.run import camera_spacing, make_trainer
from reference_encoder.training.trainer import Trainer
from tests.reference_encoder.training import small

OPTIONS = TrainOptions(iterations=60, layers=2)


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


@pytest.mark.parametrize(("iterations", "least", "most"), [(500, 2, 4), (4_000, 19, 19), (40_000, 19, 19)])
def test_masks_are_decided_at_the_same_pace_however_long_a_run_is(
    capture: Capture, iterations: int, least: int, most: int
) -> None:
    """Parts of the run lie between decisions; a run too short for all takes fewer, so that values can answer."""
    found = _decisions(make_trainer(capture, OPTIONS), iterations)
    assert least <= len(found) <= most
    assert min(late - early for (early, _), (late, _) in pairwise(found)) >= 100
    if most == 19:
        assert [masks for _, masks in found] == pytest.approx([(k + 1) / 20 for k in range(19)], abs=0.02)


def test_values_settle_on_their_mean_before_networks_are_fitted(capture: Capture) -> None:
    """Then nothing of an anchor moves any more, and the means of the networks come last."""
    trainer = make_trainer(capture, OPTIONS)
    trainer.decided = 1.0
    seen = []
    for iteration in range(57):
        trainer.step(iteration / 60)
        if trainer.averaging.count:
            seen.append(trainer.state.anchors.latent.detach().clone())
    assert len(seen) == 4  # 0.87 to 0.95 of 60
    trainer.step(57 / 60)
    mean = torch.stack(seen).mean(dim=0)
    assert torch.allclose(trainer.state.anchors.latent, mean, atol=1e-6)
    for iteration in (58, 59):
        trainer.step(iteration / 60)
    assert trainer.averaging.count == 1
    trainer.finish()
    assert trainer.averaging.count == 0
    assert torch.allclose(trainer.state.anchors.latent, mean, atol=1e-6)


def test_networks_look_from_about_the_camera() -> None:
    """Pictures of a camera change with the place from where networks look; the camera itself stays."""
    camera, black = small.camera(), torch.zeros(3)
    target = torch.zeros(camera.height, camera.width, 3, dtype=torch.uint8)
    now = replace(moment(Curriculum(), 0.2), noisy=False, gathers=False)
    losses = []
    for camera_jitter in (0.0, 0.0, 0.5, 0.5):
        state = small.state()
        view = small.view(camera, target)
        losses.append(iterate(state, view, now, state.plan.count - 1, 0.0, camera_jitter, black)[0])
    assert losses[0] == losses[1] != losses[2] == losses[3]
    assert losses[2] == pytest.approx(losses[0], rel=0.5)


def test_how_far_networks_wander_is_told_by_the_distance_of_cameras(capture: Capture) -> None:
    """Not in the paper's own recipe; and pictures that are measured are taken from where the camera is."""
    eyes = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 2, 0], [1, 2, 4], [9, 9, 9]])
    assert camera_spacing(eyes) == pytest.approx(2.0)
    assert camera_spacing(eyes[:1]) == 0.0
    centres = torch.stack([torch.from_numpy(photo.camera.centre) for photo in capture.train])
    trainer = make_trainer(capture, OPTIONS)
    assert trainer.camera_jitter == pytest.approx(PRESETS["default"].camera_jitter * camera_spacing(centres))
    assert make_trainer(capture, replace(OPTIONS, preset="paper")).camera_jitter == 0.0
    once, again = (quality(trainer.state, trainer.views[:1], None, torch.zeros(3)) for _ in range(2))
    assert once == again
