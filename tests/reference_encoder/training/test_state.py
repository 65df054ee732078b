"""A scene in training: what is rounded is what the file has, and structure changes move nothing else."""

import torch

from reference_encoder.training.anchors import Anchors
from tests.reference_encoder.training import small


def test_rounded_values_are_the_integers_of_the_file() -> None:
    """Training's last layer sees v * width of the integers that are written; earlier ones the cells round them."""
    state = small.state()
    rows = torch.arange(len(state.anchors))
    assert bool((state.missing(rows, 2) == 0).all())
    integers, offsets = state.integers(rows, state.missing(rows, 2))
    widths = torch.exp(state.log_widths.detach())
    last = state.price(rows, 2, True)
    assert torch.allclose(last.values, integers * widths)
    assert torch.allclose(last.offsets, offsets * torch.exp(state.log_offset_widths.detach()))
    first = state.price(rows, 0, True)
    assert torch.allclose(first.values[:, :6], torch.round(integers[:, :6] / 3) * 3 * widths[:6])


def test_anchors_of_the_last_layer_alone_have_cells_three_times_as_wide() -> None:
    """What is worth least is coarse: in training, in its noise, in its price and in the integers of the file alike."""
    state = small.state()
    state.anchors.first[:] = torch.where(torch.arange(len(state.anchors)) % 2 == 0, 0, 2)[:, None]
    rows = torch.arange(len(state.anchors))
    widths = torch.exp(state.log_widths.detach())
    cells = widths * torch.where(rows % 2 == 0, 1.0, 3.0)[:, None]
    integers, _ = state.integers(rows, state.missing(rows, 2))
    last = state.price(rows, 2, True)
    assert torch.allclose(last.values, integers * cells)
    assert torch.equal(last.widths.detach(), cells)
    exact = torch.cat([state.anchors.scaling, state.anchors.latent], dim=1)
    off = (state.price(rows, 2, False).values - exact).abs()
    assert bool((off <= 0.5 * cells + 1e-5).all())
    assert bool((off > 0.5 * widths)[1::2].any())


def test_noise_stays_within_a_cell() -> None:
    """Noise stands for rounding: never more than half a cell of the layer."""
    state = small.state()
    state.anchors.first[:] = 0
    rows = torch.arange(len(state.anchors))
    for layer, coarseness in ((0, 3.0), (2, 1.0)):
        noisy = state.price(rows, layer, False).values
        exact = torch.cat([state.anchors.scaling, state.anchors.latent], dim=1)
        assert bool(((noisy - exact).abs() <= 0.5 * coarseness * torch.exp(state.log_widths) + 1e-5).all())


def test_anchors_come_and_go_without_moving_others() -> None:
    """Rows kept stay as they are, in all that is learnt and remembered of them."""
    state = small.state()
    rows = torch.tensor([5, 2, 9])
    before = state.anchors.select(rows)
    fresh = Anchors.fresh(torch.zeros(2, 3).long(), torch.zeros(2), torch.zeros(2, small.LATENT))
    state.rearrange(rows, fresh)
    assert len(state.anchors) == 5
    after = state.anchors.select(torch.arange(3))
    assert all(torch.equal(getattr(before, name), getattr(after, name)) for name in vars(before))
    assert len(state.statistics.seen) == 5


def test_in_view_are_the_anchors_that_a_layer_shows() -> None:
    """Of those that the last layer has in view, each that an earlier one shows a slot of."""
    state, camera = small.state(400), small.camera()
    everyone = state.in_view(camera, state.plan.count - 1)
    early = state.in_view(camera, 0)
    assert 0 < len(early) < len(everyone)
    assert torch.equal(early, everyone[state.find_shown(everyone, 0).any(dim=1)])
