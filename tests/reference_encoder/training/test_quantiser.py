"""The quantiser of training: what it chooses, how books follow, and where gradients go."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from reference_encoder.latent.gradient import rotation_trick
from reference_encoder.training.quantiser import Quantiser
from scarfmt.errors import InvalidInput


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Threads only get in each other's way at this size."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _features(count: int = 600, width: int = 8) -> torch.Tensor:
    """Clusters in a space of four of the dimensions."""
    generator = torch.Generator().manual_seed(5)
    centres = torch.randn(20, 4, generator=generator) @ torch.randn(4, width, generator=generator)
    drawn = torch.randint(20, (count,), generator=generator)
    return centres[drawn] + 0.1 * torch.randn(count, width, generator=generator) + 3


def _started(stages: int = 3, **more: object) -> tuple[Quantiser, torch.Tensor]:
    f = _features()
    quantiser = Quantiser(6, 8, stages, 16, **more)  # type: ignore[arg-type]
    quantiser.fit(f, torch.ones(len(f)))
    quantiser.start(quantiser.project(f), torch.ones(len(f)))
    return quantiser, f


def test_books_learn_what_a_random_cut_of_them_does_not_know() -> None:
    """Every stage leaves less, and three stages of 16 codewords nearly nothing of clusters."""
    quantiser, f = _started()
    spread = float((f - f.mean(0)).square().mean())
    errors = [float((quantiser(f, stages).features.detach() - f).square().mean()) / spread for stages in range(4)]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 0.9
    assert errors[3] < 0.02


def test_training_lowers_the_loss() -> None:
    """With the paper's networks, from where the start left them."""
    quantiser, f = _started(projector="paper")
    optimiser = torch.optim.Adam(quantiser.network_parameters(), lr=2e-3)
    losses = []
    for _ in range(60):
        made = quantiser(f, 3)
        optimiser.zero_grad()
        made.loss.backward()
        optimiser.step()
        quantiser.update(made.encoded, made.indices)
        losses.append(float(made.loss.detach()))
    assert sum(losses[-5:]) < 0.9 * sum(losses[:5])


def test_linear_networks_start_at_the_best_there_are() -> None:
    """No linear pair of four dimensions reconstructs better than principal axes; distances are those of features."""
    f = _features()
    quantiser = Quantiser(4, 8, 1, 4)
    quantiser.fit(f, torch.ones(len(f)))
    z = quantiser.project(f)
    singular = torch.linalg.svdvals(f - f.mean(0))
    left = float((quantiser.decode(z) - f).detach().square().sum())
    assert left == pytest.approx(float(singular[4:].square().sum()), rel=1e-3)
    decoded = quantiser.decode(z)
    torch.testing.assert_close(torch.cdist(z, z), torch.cdist(decoded, decoded), atol=0.02, rtol=0)


def test_later_stages_share_one_book() -> None:
    quantiser, _ = _started(stages=4)
    assert len(quantiser.books) == 2
    assert quantiser.book(0) is not quantiser.book(1)
    assert quantiser.book(1) is quantiser.book(2) is quantiser.book(3)
    one = torch.tensor([[0, 5, 0, 0], [0, 0, 5, 0], [0, 0, 0, 5]])
    sums = quantiser.look_up(one)
    assert torch.equal(sums, sums[:1].expand(3, -1))


def test_the_shared_book_learns_from_all_later_stages() -> None:
    """A codeword that only stage 3 chose moves."""
    quantiser, _ = _started()
    before = quantiser.book(1).words.detach().clone()
    z = torch.full((50, 6), 2.0)
    indices = torch.tensor([[0, 0, 7]]).expand(50, 3)
    quantiser.update(z, indices)
    moved = (quantiser.book(1).words - before).abs().sum(1) > 0
    assert bool(moved[7])


def test_sums_are_of_the_stages_asked_for() -> None:
    """One number for all, or one an anchor; none gives zeros."""
    quantiser, f = _started()
    indices = quantiser.choose(quantiser.project(f))[:4]
    per_anchor = quantiser.look_up(indices, torch.tensor([0, 1, 2, 3]))
    for row in range(4):
        torch.testing.assert_close(per_anchor[row], quantiser.look_up(indices, row)[row])
    assert not per_anchor[0].any()


def test_the_gradient_is_that_of_the_rotation_trick() -> None:
    """By its definition (paper §3.3), through the sum of codewords; none reaches closed books."""
    quantiser, f = _started()
    x = f[:20].clone().requires_grad_(True)
    made = quantiser(x, 2)
    (slope,) = torch.autograd.grad(made.latent.square().sum(), x)
    z = quantiser.project(x)
    expected = rotation_trick(z, quantiser.look_up(made.indices, 2))
    torch.testing.assert_close(slope, torch.autograd.grad(expected.square().sum(), x)[0])
    assert not quantiser.book(0).words.requires_grad


def test_open_books_get_the_gradient_of_pictures() -> None:
    """Codewords in use get gradients, the zero vector does not; moving averages then leave them alone."""
    quantiser, f = _started()
    quantiser.open_books()
    made = quantiser(f)
    made.features.square().sum().backward()
    slope = quantiser.book(0).words.grad
    assert slope is not None
    used = torch.unique(made.indices[:, 0])
    assert bool((slope[used[used > 0]] != 0).any(1).all())
    assert not slope[0].any()
    before = quantiser.book(0).words.detach().clone()
    quantiser.update(made.encoded, made.indices)
    assert torch.equal(quantiser.book(0).words, before)


def test_the_loss_of_detached_features_reaches_the_networks_alone() -> None:
    quantiser, f = _started(projector="paper")
    quantiser(f).loss.backward()
    assert all(parameter.grad is not None for parameter in quantiser.network_parameters())
    assert all(parameter.grad is None for parameter in quantiser.book_parameters())


def _bits_and_error(quantiser: Quantiser, f: torch.Tensor, lambda_: float) -> tuple[float, float]:
    z, prices = quantiser.project(f), quantiser.bits()
    indices = quantiser.choose(z, prices, lambda_)
    spent = sum(float(prices[stage][indices[:, stage]].sum()) for stage in range(3))
    return spent, float((z - quantiser.look_up(indices)).detach().square().sum())


def test_a_larger_lambda_spends_fewer_bits_on_a_larger_error() -> None:
    quantiser, f = _started()
    found = [_bits_and_error(quantiser, f, lambda_) for lambda_ in (0.0, 0.01, 0.1, 30.0)]
    bits, errors = [one[0] for one in found], [one[1] for one in found]
    assert bits == sorted(bits, reverse=True)
    assert errors == sorted(errors)
    assert bits[-1] < 0.8 * bits[0]


def test_lambda_may_differ_from_anchor_to_anchor() -> None:
    quantiser, f = _started()
    z, prices = quantiser.project(f), quantiser.bits()
    mixed = quantiser.choose(z, prices, torch.where(torch.arange(len(f)) % 2 == 0, 0.0, 1.0))
    assert torch.equal(mixed[::2], quantiser.choose(z)[::2])
    assert torch.equal(mixed[1::2], quantiser.choose(z, prices, 1.0)[1::2])


def test_indices_chosen_earlier_are_taken_as_they_are() -> None:
    """Given indices are kept even if other codewords are nearer now."""
    quantiser, f = _started()
    indices = torch.full((len(f), 3), 4)
    made = quantiser(f, indices=indices)
    assert torch.equal(made.indices, indices)
    assert torch.equal(made.latent, quantiser.look_up(indices))


def test_prices_follow_what_is_used() -> None:
    """A codeword that was used alone for a while is nearly free, and an unused one costs more than before."""
    quantiser, f = _started()
    quantiser.open_books()
    for _ in range(600):
        quantiser.update(quantiser.project(f), torch.ones(len(f), 3, dtype=torch.int64))
    assert float(quantiser.bits()[:, 1].max()) < 0.05
    assert float(quantiser.bits()[:, 2].min()) > 6


def test_a_checkpoint_goes_on_as_if_nothing_had_happened() -> None:
    """Restarts draw at random: the generator is part of the state."""
    quantiser, f = _started()
    other = Quantiser(6, 8, 3, 16, seed=9)
    other.load_state_dict(quantiser.state_dict())
    for one in (quantiser, other):
        with torch.no_grad():
            one.book(1).mass[5:9] = 0.0
        made = one(f)
        one.update(made.encoded, made.indices)
    assert quantiser.restarts == other.restarts > 0
    assert torch.equal(quantiser.book(1).words, other.book(1).words)


def test_equal_seeds_give_equal_books() -> None:
    one, other = _started(projector="paper")[0], _started(projector="paper")[0]
    assert torch.equal(one.book(1).words, other.book(1).words)


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_equal_features_come_back(weight: float) -> None:
    """A scene of one colour, and one that nobody sees, need no codeword but zero."""
    f = torch.full((30, 8), 2.5)
    quantiser = Quantiser(6, 8, 2, 8)
    quantiser.fit(f, torch.full((30,), weight))
    quantiser.start(quantiser.project(f), torch.full((30,), weight))
    torch.testing.assert_close(quantiser(f).features, f)


@pytest.mark.parametrize(
    ("dimension", "stages", "codewords", "estimator", "projector"),
    [
        (9, 2, 8, "rotation", "linear"),
        (6, 9, 8, "rotation", "linear"),
        (6, 2, 1, "rotation", "linear"),
        (6, 2, 8, "gumbel", "linear"),
        (6, 2, 8, "rotation", "deep"),
    ],
)
def test_what_the_format_cannot_say_is_refused(
    dimension: int, stages: int, codewords: int, estimator: str, projector: str
) -> None:
    with pytest.raises(InvalidInput) as caught:
        Quantiser(dimension, 8, stages, codewords, estimator=estimator, projector=projector)
    assert caught.value.refusal == "input-options"
