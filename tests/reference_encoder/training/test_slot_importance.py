"""Masks: a slot is shown where leaving it out would be seen more than its bits are worth."""

from dataclasses import replace

import pytest
import torch

from reference_encoder.training.evaluate import draw
from reference_encoder.training.slot_importance import SlotImportance, first_layers, measure_importance
from tests.reference_encoder.training import small


def test_worth_is_what_leaving_a_slot_out_changes() -> None:
    """Estimates from random signs agree with pictures drawn without the slot, for the slots that matter most."""
    state, camera, black = small.state(30), small.camera(), torch.zeros(3)
    target = torch.zeros(camera.height, camera.width, 3, dtype=torch.uint8)
    views = [small.view(camera, target)] * 300
    found = measure_importance(state, views, black)
    whole = draw(state, camera, 2, black)
    first = state.anchors.first.clone()
    best = found.benefit.flatten().argsort(descending=True)[:5].tolist()
    energies = []
    for slot in best:
        state.anchors.first = first.clone()
        state.anchors.first.view(-1)[slot] = state.plan.count
        energies.append(float(((draw(state, camera, 2, black) - whole) ** 2).mean()))
    estimates = found.benefit.flatten()[best]
    scale = float(estimates.sum()) / sum(energies)
    for estimate, energy in zip(estimates.tolist(), energies, strict=True):
        assert estimate == pytest.approx(scale * energy, rel=0.35)


def test_what_is_worth_nothing_is_shown_by_no_layer() -> None:
    """A slot that no picture misses closes at any price; an anchor pays for itself by all of its slots together."""
    benefit = torch.zeros(3, 10)
    benefit[0, 0], benefit[1, :5], benefit[2, 0] = 100.0, 20.0, 20.0
    found = SlotImportance(benefit, torch.full((3, 10), 10.0), (torch.full((3,), 40.0),))
    first = first_layers(found, [1.0], benefit >= 0)
    assert first[0].tolist() == [0] + [1] * 9
    assert first[1].tolist() == [0] * 5 + [1] * 5
    assert first[2].tolist() == [1] * 10


def test_layers_only_ever_open() -> None:
    """A slot shown by an earlier, dearer layer is shown by later ones; a slot that is not allowed is never shown."""
    generator = torch.Generator().manual_seed(1)
    benefit = torch.exp(3 * torch.randn(200, 10, generator=generator))
    found = SlotImportance(benefit, torch.full((200, 10), 12.0), (torch.full((200,), 50.0),) * 3)
    allowed = torch.rand(200, 10, generator=generator) < 0.8
    prices = [0.3, 0.1, 0.02]
    first = first_layers(found, prices, allowed)
    counts = [int((first <= layer).sum()) for layer in range(3)]
    assert counts == sorted(counts)
    assert bool((first[~allowed] == 3).all())
    dearer = first_layers(found, [2 * price for price in prices], allowed)
    assert bool((dearer >= first).all())


def test_a_view_of_nothing_says_nothing() -> None:
    """A camera that looks away finds no slot worth anything, and fails nowhere."""
    state, camera = small.state(20), small.camera()
    pose = camera.world_to_camera.copy()
    pose[2, 3] = -50.0
    target = torch.zeros(camera.height, camera.width, 3, dtype=torch.uint8)
    found = measure_importance(state, [small.view(replace(camera, world_to_camera=pose), target)], torch.zeros(3))
    assert float(found.benefit.sum()) == 0


def test_what_few_photos_show_is_remembered() -> None:
    """A slot that today's photos do not show is worth what those before said, by all photos looked at."""
    state, camera, black = small.state(20), small.camera(), torch.zeros(3)
    target = torch.full((camera.height, camera.width, 3), 90, dtype=torch.uint8)
    away = camera.world_to_camera.copy()
    away[2, 3] = -50.0
    first = measure_importance(state, [small.view(camera, target)], black)
    energy = state.statistics.energy.clone()
    shown = energy > 0
    assert bool(shown.any())
    later = measure_importance(state, [small.view(replace(camera, world_to_camera=away), target)] * 3, black)
    assert torch.equal(state.statistics.energy, 0.7 * energy)
    assert state.statistics.looked.tolist() == pytest.approx([3.7] * len(state.anchors))
    assert torch.equal(later.benefit > 0, first.benefit > 0)
    assert float(state.statistics.select(torch.arange(3), 2).looked[3:].sum()) == 0
