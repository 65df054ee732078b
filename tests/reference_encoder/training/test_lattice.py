"""Distinct points are those that torch finds among rows, in its order."""

import torch
from hypothesis import given
from hypothesis import strategies as st

from reference_encoder.training.lattice import Distinct


@given(st.integers(1, 200), st.integers(0, 100), st.integers(1, 40))
def test_points_are_the_distinct_rows(count: int, seed: int, side: int) -> None:
    """Boxes of any shape, negative numbers too: same rows, same order, same numbers, same counts."""
    generator = torch.Generator().manual_seed(seed)
    points = torch.randint(-side, side, (count, 3), generator=generator) * torch.tensor([1, 3, 2**20])
    found = Distinct.of(points)
    rows, which, counts = torch.unique(points, dim=0, return_inverse=True, return_counts=True)
    assert torch.equal(found.points, rows)
    assert torch.equal(found.which, which)
    assert torch.equal(found.counts, counts)
