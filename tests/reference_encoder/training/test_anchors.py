"""Anchors lie on a lattice that a file can have."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference_encoder.training.anchors import REACH, AnchorLattice, distinct, within_reach


def test_points_far_apart_get_a_coarser_voxel() -> None:
    """One stray point among many close ones must not make a lattice that no file can have."""
    points = torch.tensor([[0.0, 0, 0], [1, 2, 3]], dtype=torch.float64)
    assert AnchorLattice.round(points, 0.01).voxel == 0.01
    far = torch.cat([points, torch.tensor([[1e7, 0, 0]], dtype=torch.float64)])
    frame = AnchorLattice.round(far, 0.01)
    assert frame.voxel == pytest.approx(1e7 / REACH)
    assert within_reach(torch.round((far - frame.origin) / frame.voxel).long()).all()


def test_what_is_beyond_reach_is_told() -> None:
    points = torch.tensor([[0, 0, 0], [-REACH, 0, 0], [0, 2 * REACH, 0], [REACH, REACH, -5]])
    assert within_reach(points).tolist() == [True, False, False, True]


@given(st.integers(1, 200), st.integers(0, 100), st.integers(1, 40))
def test_points_are_the_distinct_rows(count: int, seed: int, side: int) -> None:
    """Boxes of any shape, negative numbers too: same rows, same order, same numbers, same counts."""
    generator = torch.Generator().manual_seed(seed)
    points = torch.randint(-side, side, (count, 3), generator=generator) * torch.tensor([1, 3, 2**20])
    found = distinct(points)
    rows, which, counts = torch.unique(points, dim=0, return_inverse=True, return_counts=True)
    assert torch.equal(found[0], rows)
    assert torch.equal(found[1], which)
    assert torch.equal(found[2], counts)
