"""The values of neighbours: means over cells of all others, towards the mean of all."""

import torch
from hypothesis import example, given
from hypothesis import strategies as st

from reference_encoder.training.neighbours import OCCUPANCIES, Neighbours, columns


def test_means_are_of_the_others_in_the_cell() -> None:
    """An anchor does not see itself: its own value would be the answer."""
    lattice = torch.tensor([[0, 0, 0], [1, 0, 0], [0, 1, 0], [900, 900, 900]])
    values = torch.tensor([[1.0], [2.0], [6.0], [100.0]])
    neighbours = Neighbours((torch.tensor([0, 0, 0, 1]),), (torch.tensor([3.0, 1.0]),))
    around = neighbours.around(values)
    overall = float(values.mean())
    assert torch.allclose(around[0], torch.tensor([(2.0 + 6.0 + overall) / 3, torch.log1p(torch.tensor(2.0))]))
    assert torch.allclose(around[3], torch.tensor([overall, 0.0]))
    changed = values.clone()
    changed[0] += 4
    difference = neighbours.around(changed)[0, 0] - around[0, 0]
    assert torch.allclose(difference, torch.tensor(1.0 / 3))  # by the mean of all, not as its own neighbour
    assert len(Neighbours.of(lattice).cells) == len(OCCUPANCIES)


@given(st.integers(1, 300), st.integers(0, 100))
@example(2, 20)  # lies on two sides of 32
def test_cells_hold_as_many_as_they_shall(count: int, seed: int) -> None:
    """Cells are the smallest that hold enough on average; the whole scene is one if it has too few."""
    generator = torch.Generator().manual_seed(seed)
    lattice = torch.unique(torch.randint(0, 64, (count, 3), generator=generator), dim=0)
    neighbours = Neighbours.of(lattice)
    for counts, occupancy in zip(neighbours.counts, OCCUPANCIES, strict=True):
        assert int(counts.sum()) == len(lattice)
        assert len(counts) == 1 or len(lattice) >= occupancy * len(counts)
    assert neighbours.around(torch.randn(len(lattice), 5)).shape == (len(lattice), columns(5))
