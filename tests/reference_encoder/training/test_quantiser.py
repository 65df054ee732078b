"""The quantiser of training: what it chooses, how books follow, and where gradients go."""

from __future__ import annotations

import pytest
import torch

from reference_encoder.training.quantiser import Quantiser, rotation_trick


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


def _quantised(quantiser: Quantiser, f: torch.Tensor, stages: int = 3) -> tuple[torch.Tensor, ...]:
    """Features, loss, latents without gradient, indices."""
    encoded = quantiser.project(f)
    indices = quantiser.choose(encoded)
    return *quantiser(f, encoded, indices, stages), encoded.detach(), indices


def test_books_learn_what_a_random_cut_of_them_does_not_know() -> None:
    """Every stage leaves less, and three stages of 16 codewords nearly nothing of clusters."""
    quantiser, f = _started()
    spread = float((f - f.mean(0)).square().mean())
    errors = [float((_quantised(quantiser, f, stages)[0].detach() - f).square().mean()) / spread for stages in range(4)]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 0.9
    assert errors[3] < 0.02


def test_training_lowers_the_loss() -> None:
    """With the paper's networks, from where the start left them."""
    quantiser, f = _started(linear=False)
    optimiser = torch.optim.Adam(quantiser.network_parameters(), lr=2e-3)
    losses = []
    for _ in range(60):
        _, loss, encoded, indices = _quantised(quantiser, f)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        quantiser.update(encoded, indices)
        losses.append(float(loss.detach()))
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


@pytest.mark.parametrize("linear", [True, False])
def test_the_gradient_goes_straight_through_or_is_that_of_the_rotation_trick(linear: bool) -> None:
    """By its definition (paper §3.3), through the sum of codewords; none reaches closed books."""
    quantiser, f = _started(linear=linear)
    x = f[:20].clone().requires_grad_(True)
    features, _, _, indices = _quantised(quantiser, x, 2)
    (slope,) = torch.autograd.grad(features.square().sum(), x)
    z, words = quantiser.project(x), quantiser.look_up(indices, 2)
    expected = quantiser.decode(z + (words - z).detach() if linear else rotation_trick(z, words))
    torch.testing.assert_close(slope, torch.autograd.grad(expected.square().sum(), x)[0])
    assert not quantiser.book(0).words.requires_grad


def test_open_books_get_the_gradient_of_pictures() -> None:
    """Codewords in use get gradients, the zero vector does not; moving averages then leave them alone."""
    quantiser, f = _started()
    quantiser.open_books()
    features, _, encoded, indices = _quantised(quantiser, f)
    features.square().sum().backward()
    slope = quantiser.book(0).words.grad
    used = torch.unique(indices[:, 0])
    assert bool((slope[used[used > 0]] != 0).any(1).all())
    assert not slope[0].any()
    before = quantiser.book(0).words.detach().clone()
    quantiser.update(encoded, indices)
    assert torch.equal(quantiser.book(0).words, before)


def test_the_loss_of_detached_features_reaches_the_networks_alone() -> None:
    quantiser, f = _started(linear=False)
    _quantised(quantiser, f)[1].backward()
    assert all(parameter.grad is not None for parameter in quantiser.network_parameters())
    assert all(parameter.grad is None for parameter in quantiser.books.parameters())


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
    before = quantiser.book(1).words[5:9].clone()
    for one in (quantiser, other):
        with torch.no_grad():
            one.book(1).mass[5:9] = 0.0
        one.update(*_quantised(one, f)[2:])
    assert not torch.equal(quantiser.book(1).words[5:9], before)
    assert torch.equal(quantiser.book(1).words, other.book(1).words)


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_equal_features_come_back(weight: float) -> None:
    """A scene of one colour, and one that nobody sees, need no codeword but zero."""
    f = torch.full((30, 8), 2.5)
    quantiser = Quantiser(6, 8, 2, 8)
    quantiser.fit(f, torch.full((30,), weight))
    quantiser.start(quantiser.project(f), torch.full((30,), weight))
    torch.testing.assert_close(_quantised(quantiser, f, 2)[0], f)


def _pair(seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    e, q = torch.randn(2, 1, 6, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return e, 3 * q


def _jacobian(e: torch.Tensor, q: torch.Tensor) -> torch.Tensor:
    return torch.autograd.functional.jacobian(lambda x: rotation_trick(x[None], q)[0], e[0])  # type: ignore[no-any-return]


@pytest.mark.parametrize("seed", range(5))
def test_rotation_jacobian_is_a_rotation_times_the_length_ratio_and_maps_e_to_q(seed: int) -> None:
    """Forward is the codeword; what is orthogonal to both is left alone."""
    e, q = _pair(seed)
    torch.testing.assert_close(rotation_trick(e, q), q, rtol=0, atol=1e-14)
    jacobian = _jacobian(e, q)
    rotation = jacobian / (q.norm() / e.norm())
    torch.testing.assert_close(rotation @ rotation.T, torch.eye(6, dtype=torch.float64))
    torch.testing.assert_close(torch.linalg.det(rotation), torch.tensor(1.0, dtype=torch.float64))
    torch.testing.assert_close(jacobian @ e[0], q[0])
    across = torch.linalg.svd(torch.cat([e, q])).Vh[2:]
    torch.testing.assert_close(across @ rotation.T, across)


def test_opposite_vectors_give_a_reflection_not_nan() -> None:
    e, _ = _pair(4)
    jacobian = _jacobian(e, -2 * e)
    torch.testing.assert_close(jacobian @ jacobian.T, 4 * torch.eye(6, dtype=torch.float64))
    torch.testing.assert_close(jacobian @ e[0], -2 * e[0])


@pytest.mark.parametrize("zero", ["e", "q"])
def test_zero_vectors_go_straight_through(zero: str) -> None:
    e, q = _pair(5)
    e, q = (torch.zeros_like(e), q) if zero == "e" else (e, torch.zeros_like(q))
    torch.testing.assert_close(rotation_trick(e, q), q)
    torch.testing.assert_close(_jacobian(e, q), torch.eye(6, dtype=torch.float64))
