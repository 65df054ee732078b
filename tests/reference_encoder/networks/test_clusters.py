"""Order of codewords for the two-level head."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_encoder.networks.clusters import arrange, cluster
from scarfmt.scene.codebooks import Codebooks


def _words(count: int, seed: int = 0) -> NDArray[np.int64]:
    words = np.random.default_rng(seed).integers(-99, 100, (count, 5))
    words[count // 2] = 0
    return words


def test_clusters_are_a_permutation_cut_into_pieces_of_like_size() -> None:
    for count in (48, 100, 1024):
        found = cluster(_words(count), np.arange(count))
        assert sorted(found.order.tolist()) == list(range(count))
        assert sum(found.sizes) == count
        assert max(found.sizes[1:]) - min(found.sizes[1:]) <= 1
        assert abs(len(found.sizes) - np.sqrt(count)) < 3


def test_clusters_of_one_size_lie_side_by_side() -> None:
    """The evaluator takes a run of equal clusters at a time."""
    sizes = cluster(_words(200), np.ones(200, np.int64)).sizes
    assert list(sizes) == sorted(sizes)


def test_the_zero_codeword_is_a_cluster_of_its_own() -> None:
    found = cluster(_words(100), np.ones(100, np.int64))
    assert found.sizes[0] == 1
    assert not _words(100)[found.order[0]].any()


def test_like_codewords_share_clusters() -> None:
    """Two clouds far apart are never mixed in one cluster."""
    words = _words(64) // 10
    words[32:] += 1000
    found = cluster(words, np.ones(64, np.int64))
    assert len(found.sizes) == 8
    for members in np.split(found.order, np.cumsum(found.sizes)[:-1]):
        assert len(set((members >= 32).tolist())) == 1


def test_within_a_cluster_the_most_used_come_first() -> None:
    uses = np.random.default_rng(3).integers(0, 1000, 100)
    found = cluster(_words(100), uses)
    for members in np.split(found.order, np.cumsum(found.sizes)[:-1]):
        assert (np.diff(uses[members]) <= 0).all()


def test_a_small_book_is_coded_flat_in_its_own_order() -> None:
    found = cluster(_words(20), np.ones(20, np.int64))
    assert found.sizes == ()
    assert found.order.tolist() == list(range(20))


def test_renumbered_indices_name_the_same_codewords() -> None:
    books = Codebooks(_words(90, 1), _words(20, 2))
    arranged, found = arrange(books, (np.ones(90, np.int64), np.ones(20, np.int64)))
    assert (arranged.coarse[found[0].ranks] == books.coarse).all()
    assert (arranged.residual[found[1].ranks] == books.residual).all()


def test_equal_books_give_equal_orders() -> None:
    first, second = (cluster(_words(300), np.arange(300)) for _ in range(2))
    assert first.order.tolist() == second.order.tolist()
    assert first.sizes == second.sizes
