"""The integers of a trained quantiser: they say what it said, and the decoder can go on learning from them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from reference_encoder.training.quantiser import Quantiser
from reference_encoder.training.vq_features import ExportedLatents, export_latents
from scarfmt.blocks.codebooks import pack_codebooks, unpack_codebooks
from scarfmt.blocks.mlp import pack_networks, unpack_networks


def _trained(projector: str) -> tuple[Quantiser, torch.Tensor, torch.Tensor, torch.Tensor]:
    """A quantiser, features, indices and stages that differ from anchor to anchor."""
    generator = torch.Generator().manual_seed(1)
    f = torch.randn(500, 3, generator=generator) @ torch.randn(3, 10, generator=generator)
    quantiser = Quantiser(5, 10, 3, 32, linear=projector == "linear")
    quantiser.fit(f, torch.ones(500))
    z = quantiser.project(f).detach()
    quantiser.start(z, torch.ones(500))
    return quantiser, f, quantiser.choose(z), torch.arange(500) % 4


def _exported(projector: str) -> tuple[ExportedLatents, torch.Tensor, torch.Tensor, torch.Tensor]:
    """The export, the float model's features, the exported features, and the stages."""
    quantiser, f, indices, stages = _trained(projector)
    with torch.no_grad():
        smooth = quantiser.decode(quantiser.look_up(indices, stages))
    return export_latents(quantiser, f, indices, stages), smooth, f, stages


def _assert_close(made: ExportedLatents, smooth: torch.Tensor, f: torch.Tensor, stages: torch.Tensor) -> None:
    sums = made.codebooks.latents(made.indices.astype(np.int64), stages.numpy())
    error = made.decoder.apply(sums.astype(np.float32)) - smooth.numpy()
    assert np.sqrt(np.square(error).mean()) < 0.012 * float(f.std())
    # Half a unit a stage and dimension, and what weights of 12 bits round.
    (decoder,) = made.decoder.layers[-1:]
    if len(made.decoder.layers) == 1:
        bound = 1.5 * np.abs(decoder.matrix).sum(axis=1) + decoder.scales / 2 * np.abs(sums).sum(axis=1).max()
        assert (np.abs(error) <= bound + 1e-5).all()


@pytest.mark.parametrize("projector", ["linear", "paper"])
def test_integers_say_what_the_float_model_said(projector: str) -> None:
    """To about a hundredth of the spread, root mean square, through books and decoder as a file holds them."""
    made, smooth, f, stages = _exported(projector)
    _assert_close(made, smooth, f, stages)
    books = unpack_codebooks(pack_codebooks({0: made.codebooks.coarse, 1: made.codebooks.residual}))
    assert np.array_equal(books[1], made.codebooks.residual)
    (decoder,) = unpack_networks(pack_networks((made.decoder,)))
    assert decoder.layers[0].weights.dtype == np.int16
    assert len(made.decoder.layers) == (1 if projector == "linear" else 2)


def test_unused_codewords_are_not_written() -> None:
    """A step that an anchor does not receive has index 0."""
    quantiser, f, indices, stages = _trained("linear")
    indices = indices % 5
    made = export_latents(quantiser, f, indices, stages)
    assert made.codebooks.sizes <= (5, 5)
    assert not made.indices[np.arange(3) >= stages.numpy()[:, None]].any()
    with torch.no_grad():
        smooth = quantiser.decode(quantiser.look_up(indices, stages))
    _assert_close(made, smooth, f, stages)


def test_dimensions_are_sorted_and_latents_are_in_lattice_units() -> None:
    """The first dimension spreads most; the projector's latents are near their codewords."""
    quantiser, f, indices, stages = _trained("linear")
    made = export_latents(quantiser, f, indices, stages)
    latents = made.coordinates.latents(quantiser.project(f).detach().numpy())
    spread = latents.std(axis=0)
    assert (np.diff(spread) <= 1e-3 * spread[0]).all()
    sums = made.codebooks.latents(made.indices.astype(np.int64), stages.numpy())
    full = stages.numpy() == 3
    assert np.square(latents - sums)[full].sum() < 0.05 * np.square(latents)[full].sum()


def test_coordinates_can_be_kept() -> None:
    """Codewords that moved a little get integers near those they had: an index network goes on from where it was."""
    quantiser, f, indices, stages = _trained("paper")
    first = export_latents(quantiser, f, indices, stages)
    with torch.no_grad():
        quantiser.book(0).words.mul_(1.02)
    second = export_latents(quantiser, f, indices, stages, first.coordinates)
    moved = second.codebooks.coarse - np.rint(1.02 * first.codebooks.coarse)
    assert np.abs(moved).max() <= 2
    assert second.coordinates is first.coordinates
