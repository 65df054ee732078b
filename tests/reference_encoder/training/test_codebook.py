"""A codebook finds clusters, follows what it serves, and wastes no codewords."""

from __future__ import annotations

import torch

from reference_encoder.training.codebook import Codebook


def _generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def _clusters(count: int = 6, each: int = 50) -> tuple[torch.Tensor, torch.Tensor]:
    """Centres far apart, and vectors close round them."""
    centres = 20 * torch.randn(count, 4, generator=_generator(1))
    return centres, centres.repeat(each, 1) + 0.1 * torch.randn(count * each, 4, generator=_generator(2))


def test_kmeans_finds_clusters() -> None:
    """Every centre has a codeword at its place, and the first codeword is the zero vector."""
    centres, x = _clusters()
    book = Codebook(13, 4)
    book.fit(x, torch.ones(len(x)), _generator())
    assert float(torch.cdist(centres, book.words).min(1).values.max()) < 0.2
    assert not book.words[0].any()


def test_kmeans_goes_where_the_weight_is() -> None:
    """One codeword for two clusters takes the place of the heavy one."""
    x = torch.tensor([[1.0, 0.0]] * 10 + [[0.0, 1.0]] * 10)
    book = Codebook(2, 2)
    book.fit(x, torch.tensor([100.0] * 10 + [1.0] * 10), _generator())
    assert float((book.words[1] - torch.tensor([1.0, 0.0])).norm()) < 0.05


def test_fewer_vectors_than_codewords_are_enough() -> None:
    x = torch.eye(3)
    book = Codebook(16, 3)
    book.fit(x, torch.ones(3), _generator())
    torch.testing.assert_close(book.words[book.nearest(x)], x)


def test_moving_averages_are_those_of_sums_and_masses() -> None:
    """The codeword that an average of sums over an average of counts would have."""
    x, codes = torch.randn(40, 3, generator=_generator(3)), torch.arange(40) % 4
    book = Codebook(4, 3)
    sums, mass = torch.zeros(4, 3), torch.ones(4)
    for part in (slice(0, 40), slice(0, 20), slice(20, 40)):
        book.learn(x[part], codes[part], _generator())
        gain = 0.01 * 4 / len(x[part])
        sums = 0.99 * sums + gain * torch.zeros(4, 3).index_add_(0, codes[part], x[part])
        mass = 0.99 * mass + gain * torch.bincount(codes[part], minlength=4)
    torch.testing.assert_close(book.words[1:].detach(), (sums / mass[:, None])[1:])


def test_stale_codewords_restart_at_vectors_of_the_batch() -> None:
    """Codewords far from everything: after a while all serve something."""
    book = Codebook(16, 3)
    with torch.no_grad():
        book.words[1:] = 1e3
    generator = _generator()
    x = torch.randn(500, 3, generator=generator)
    for _ in range(900):
        book.learn(x, book.nearest(x), generator)
    assert len(torch.unique(book.nearest(x))) >= 14
    assert float(book.words.norm(dim=1).max()) < 5


def test_a_price_moves_the_choice() -> None:
    book = Codebook(2, 1)
    with torch.no_grad():
        book.words[1] = 1.0
    x = torch.tensor([[0.6], [0.9]])
    assert book.nearest(x).tolist() == [1, 1]
    assert book.nearest(x, torch.tensor([0.0, 0.5])).tolist() == [0, 1]
    assert len(book.nearest(x[:0])) == 0
