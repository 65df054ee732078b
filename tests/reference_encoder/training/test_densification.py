"""Growth and pruning: anchors where slots pull on the picture, on nested grids, none twice."""

import torch

from reference_encoder.training.anchors import SLOTS
from reference_encoder.training.densification import AnchorStatistics, densify, inherit_latents


def _statistics(pull: torch.Tensor, drawn: int = 50) -> AnchorStatistics:
    statistics = AnchorStatistics.of(len(pull))
    statistics.gradient += pull[:, None] * drawn
    statistics.drawn += drawn
    return statistics


def _places(points: torch.Tensor) -> torch.Tensor:
    return points[:, None].expand(-1, SLOTS, -1).double()


def _generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def test_only_slots_that_pull_ask() -> None:
    """Below the limit nothing grows; above it, an anchor appears at the cell of the slot."""
    lattice = torch.tensor([[0, 0, 0], [100, 0, 0]])
    places = _places(torch.tensor([[20.0, 0, 0], [120.0, 0, 0]]))
    growth = densify(lattice, places, _statistics(torch.tensor([0.0, 1e-3])), 2e-4, 40, _generator())
    assert len(growth.lattice) > 0
    assert bool((growth.lattice[:, 0] >= 112).all())
    assert bool((growth.parents == 1).all())


def test_new_anchors_lie_on_their_grids_and_nowhere_twice() -> None:
    """Cells of 16, 4 and 1 voxels: every new anchor is on the grid of its size, and no two share a place."""
    generator = _generator()
    points = 300 * torch.rand(200, 3, generator=generator)
    lattice = torch.unique(points.round().long(), dim=0)
    places = _places(points[: len(lattice)] + 20 * torch.rand(len(lattice), 3, generator=generator))
    growth = densify(lattice, places, _statistics(torch.full((len(lattice),), 1e-2)), 2e-4, 40, generator)
    assert bool((growth.lattice % growth.size[:, None] == 0).all())
    assert set(growth.size.tolist()) == {16, 4, 1}
    everything = torch.cat([lattice, growth.lattice])
    assert len(torch.unique(everything, dim=0)) == len(everything)


def test_slots_seen_too_seldom_are_not_judged_and_keep_their_counters() -> None:
    """A gradient from few pictures says little: it goes on being added up."""
    statistics = _statistics(torch.tensor([1.0]), drawn=10)
    growth = densify(torch.zeros(1, 3).long(), _places(torch.ones(1, 3)), statistics, 2e-4, 40, _generator())
    assert len(growth.lattice) == 0
    assert bool((statistics.drawn == 10).all())


def test_new_anchors_inherit_the_largest_of_those_that_asked() -> None:
    """Latents of a new anchor: component by component the largest of the anchors whose slots asked for it."""
    lattice = torch.tensor([[0, 0, 0], [1, 0, 0]])
    places = _places(torch.tensor([[64.0, 0, 0], [64.0, 0, 0]]))
    growth = densify(lattice, places, _statistics(torch.ones(2)), 2e-4, 40, _generator())
    latent = torch.tensor([[1.0, -5.0], [-2.0, 3.0]])
    asked = [set(growth.parents[growth.asking == n].tolist()) for n in range(len(growth.lattice))]
    for n, parents in enumerate(asked):
        assert torch.equal(inherit_latents(latent, growth)[n], latent[list(parents)].amax(dim=0))


def test_anchors_that_hardly_show_are_found_once_seen_often() -> None:
    """Pruning looks at the mean opacity over views, and only after enough of them."""
    statistics = AnchorStatistics.of(3)
    statistics.seen += torch.tensor([100.0, 100.0, 10.0])
    statistics.opacity += torch.tensor([0.1, 50.0, 0.0])
    assert statistics.unseen(80).tolist() == [True, False, False]
    assert statistics.seen.tolist() == [0.0, 0.0, 10.0]


def test_nothing_grows_beyond_what_a_file_can_have() -> None:
    """A slot that flew off asks in vain: positions of a file are cells of a lattice of limited size."""
    statistics = AnchorStatistics.of(2)
    statistics.drawn[:] = 100
    statistics.gradient[:] = 100.0
    places = torch.full((2, 10, 3), 40.0, dtype=torch.float64)
    places[1] = 1e9
    lattice = torch.tensor([[0, 0, 0], [1, 1, 1]])
    found = densify(lattice, places, statistics, 1e-4, 10, torch.Generator().manual_seed(0))
    assert len(found.lattice)
    assert found.lattice.max() <= 48
    assert set(found.parents.tolist()) == {0}
