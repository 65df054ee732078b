"""Features as codewords: the curriculum's mixture, its gradients, what the file gets (paper §3.6)."""

from dataclasses import replace

import pytest
import torch

from reference_encoder.training.presets import Curriculum, Moment, moment
from reference_encoder.training.vq_features import VqFeatures
from tests.reference_encoder.training import small

SOFT = moment(Curriculum(), 0.5)
ROWS = torch.arange(200)


def _file(vectors: VqFeatures, latent: torch.Tensor, stages: int) -> torch.Tensor:
    """Features of codewords chosen now by distortion alone."""
    z = vectors.quantiser.project(latent)
    return vectors.quantiser.decode(vectors.quantiser.look_up(vectors.quantiser.choose(z), stages)).detach()


def _begun() -> tuple[VqFeatures, torch.Tensor]:
    state = small.state(200, vectors=True)
    latent = state.anchors.latent.detach()
    state.vectors.begin(latent, torch.ones(len(latent)))
    return state.vectors, latent


@pytest.mark.parametrize("beta", [0.0, 0.3, 1.0])
def test_injection_mixes_and_passes_the_gradient(beta: float) -> None:
    """Forward f + beta (f_q - f); backward the picture steers f by the share that the curriculum says."""
    vectors, latent = _begun()
    now: Moment = replace(SOFT, beta=beta, feature_gradient=0.25)
    given = latent.clone().requires_grad_()
    shown = vectors.features(given, ROWS, 1, now)
    quantised = _file(vectors, latent, 1)
    assert torch.allclose(shown, latent + beta * (quantised - latent), atol=1e-5)
    shown.sum().backward()
    assert torch.allclose(given.grad, torch.full_like(latent, 0.25))


def test_in_the_hard_phase_pictures_move_books_and_decoder() -> None:
    """Once open, gradients reach codewords, decoder and features; before that no codeword."""
    vectors, latent = _begun()
    vectors.open()
    given = latent.clone().requires_grad_()
    vectors.features(given, ROWS, 2, replace(SOFT, hard=True)).square().sum().backward()
    assert float(given.grad.abs().sum()) > 0
    assert all(p.grad is not None and float(p.grad.abs().sum()) > 0 for p in vectors.quantiser.books.parameters())


def test_more_stages_say_more() -> None:
    """A later layer is nearer to the features, and costs more bits."""
    vectors, latent = _begun()
    errors = [float((vectors.features(latent, ROWS, layer, None) - latent).square().mean()) for layer in (0, 2)]
    assert errors[1] < errors[0]
    assert 0 < vectors.index_bits(0) < vectors.index_bits(2)


def test_codewords_are_chosen_in_turns() -> None:
    """Codewords of new features are up to date after eight looks, an eighth at each; anchors that are added get some at
    once."""
    vectors, latent = _begun()
    vectors.features(latent, ROWS, 1, SOFT)
    moved = latent.flip(0)
    found = []
    for _ in range(8):
        shown = vectors.features(moved, ROWS, 1, replace(SOFT, beta=1.0))
        fresh = _file(vectors, moved, vectors.stages[1])
        found.append(int((shown - fresh).abs().amax(dim=1).lt(1e-5).sum()))
    assert found == sorted(found)
    assert found[0] < 100
    assert found[-1] == 200
    kept = torch.arange(0, 200, 2)
    vectors.rearrange(kept, 3)
    densify = torch.cat([moved[kept], latent[:3]])
    shown = vectors.features(densify, torch.arange(103), 1, replace(SOFT, beta=1.0))
    assert torch.allclose(shown, _file(vectors, densify, vectors.stages[1]), atol=1e-5)


def test_a_photo_that_sees_nothing_teaches_nothing() -> None:
    """What early layers show may be out of its view."""
    vectors, latent = _begun()
    before = vectors.quantiser.uses.clone()
    vectors.features(latent[:0], ROWS[:0], 0, SOFT)
    vectors.step()
    assert vectors.distortion == 0
    assert torch.equal(vectors.quantiser.uses, before)
