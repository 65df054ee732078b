"""Anchors lie on a lattice that a file can have."""

import pytest
import torch

from reference_encoder.training.anchors import REACH, Frame, within_reach


def test_points_far_apart_get_a_coarser_voxel() -> None:
    """One stray point among many close ones must not make a lattice that no file can have."""
    points = torch.tensor([[0.0, 0, 0], [1, 2, 3]], dtype=torch.float64)
    assert Frame.round(points, 0.01).voxel == 0.01
    far = torch.cat([points, torch.tensor([[1e7, 0, 0]], dtype=torch.float64)])
    frame = Frame.round(far, 0.01)
    assert frame.voxel == pytest.approx(1e7 / REACH)
    assert within_reach(torch.round((far - frame.origin) / frame.voxel).long()).all()


def test_what_is_beyond_reach_is_told() -> None:
    points = torch.tensor([[0, 0, 0], [-REACH, 0, 0], [0, 2 * REACH, 0], [REACH, REACH, -5]])
    assert within_reach(points).tolist() == [True, False, False, True]
