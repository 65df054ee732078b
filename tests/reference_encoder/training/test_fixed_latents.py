"""The integers of a trained quantiser: they say what it said, and the decoder can go on learning from them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from reference_encoder.training.fixed_latents import Exported, FixedLatents, export
from reference_encoder.training.quantiser import Quantiser
from scarfmt.blocks.codebooks import pack_codebooks, unpack_codebooks
from scarfmt.blocks.mlp import pack_networks, unpack_networks


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Threads only get in each other's way at this size."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _trained(projector: str) -> tuple[Quantiser, torch.Tensor, torch.Tensor, torch.Tensor]:
    """A quantiser, features, indices and stages that differ from anchor to anchor."""
    generator = torch.Generator().manual_seed(1)
    f = torch.randn(500, 3, generator=generator) @ torch.randn(3, 10, generator=generator)
    quantiser = Quantiser(5, 10, 3, 32, projector=projector)
    quantiser.fit(f, torch.ones(500))
    z = quantiser.project(f).detach()
    quantiser.start(z, torch.ones(500))
    return quantiser, f, quantiser.choose(z), torch.arange(500) % 4


def _exported(projector: str) -> tuple[Exported, torch.Tensor, torch.Tensor, torch.Tensor]:
    """The export, the float model's features, the exported features, and the stages."""
    quantiser, f, indices, stages = _trained(projector)
    with torch.no_grad():
        smooth = quantiser.decode(quantiser.look_up(indices, stages))
    return export(quantiser, f, indices, stages), smooth, f, stages


def _assert_close(made: Exported, smooth: torch.Tensor, f: torch.Tensor, stages: torch.Tensor) -> None:
    error = made.features(stages.numpy()) - smooth.numpy()
    assert np.sqrt(np.square(error).mean()) < 0.012 * float(f.std())
    # Half a unit a stage and dimension, and what weights of 12 bits round.
    (decoder,) = made.decoder.layers[-1:]
    if len(made.decoder.layers) == 1:
        bound = 1.5 * np.abs(decoder.matrix).sum(axis=1) + decoder.scales / 2 * np.abs(made.latents).sum(axis=1).max()
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
    made = export(quantiser, f, indices, stages)
    assert made.codebooks.sizes <= (5, 5)
    assert not made.indices[np.arange(3) >= stages.numpy()[:, None]].any()
    with torch.no_grad():
        smooth = quantiser.decode(quantiser.look_up(indices, stages))
    _assert_close(made, smooth, f, stages)


def test_dimensions_are_sorted_and_latents_are_in_lattice_units() -> None:
    """The first dimension spreads most; the projector's latents are near their codewords."""
    made, _, _, _ = _exported("linear")
    spread = made.latents.std(axis=0)
    assert (np.diff(spread) <= 1e-3 * spread[0]).all()
    sums = made.codebooks.latents(made.indices.astype(np.int64), np.arange(500) % 4)
    full = np.arange(500) % 4 == 3
    assert np.square(made.latents - sums)[full].sum() < 0.05 * np.square(made.latents)[full].sum()


def test_the_decoder_goes_on_learning_from_integers() -> None:
    """The model decodes what a file would give, before and after; the indices stay."""
    made, _, f, stages = _exported("paper")
    fixed, rows = FixedLatents(made), torch.arange(500)
    np.testing.assert_allclose(fixed(rows, stages).detach(), made.features(stages.numpy()), atol=1e-4)
    optimiser = torch.optim.Adam(fixed.parameters(), lr=1e-3)
    losses = []
    for _ in range(40):
        loss = (fixed(rows, stages) - f).abs().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < losses[0]
    sums = made.codebooks.latents(made.indices.astype(np.int64), stages.numpy())
    stored = fixed.stored().apply(sums.astype(np.float32))
    np.testing.assert_allclose(fixed(rows, stages).detach(), stored, atol=1e-4)


def test_the_latent_channel_is_added_in_lattice_units() -> None:
    """SPEC R-9.2-2: sum of codewords plus value of LATENT."""
    made, _, _, _ = _exported("linear")
    fixed, rows = FixedLatents(made), torch.arange(7)
    sums = made.codebooks.latents(made.indices[:7].astype(np.int64), np.full(7, 2))
    found = fixed(rows, 2, torch.full((7, made.codebooks.dimension), 3.5)).detach()
    np.testing.assert_allclose(found, made.decoder.apply(sums + 3.5), atol=1e-4)


def test_fixed_latents_come_back_from_a_checkpoint() -> None:
    fixed = FixedLatents(_exported("paper")[0])
    with torch.no_grad():
        fixed.biases[0] += 0.25
    again = FixedLatents.of_state(fixed.state_dict())
    rows = torch.arange(500)
    assert torch.equal(again(rows, 3), fixed(rows, 3))


def test_coordinates_can_be_kept() -> None:
    """Codewords that moved a little get integers near those they had: an index network goes on from where it was."""
    quantiser, f, indices, stages = _trained("paper")
    first = export(quantiser, f, indices, stages)
    with torch.no_grad():
        quantiser.book(0).words.mul_(1.02)
    second = export(quantiser, f, indices, stages, first.coordinates)
    moved = second.codebooks.coarse - np.rint(1.02 * first.codebooks.coarse)
    assert np.abs(moved).max() <= 2
    assert second.coordinates is first.coordinates
