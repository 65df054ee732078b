"""The start of a training without points: in front of the cameras, and the same for the same cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from reference_encoder.training.start import drawn_points
from scarfmt.render.capture.seen import in_view
from tests.reference_encoder.training.captures import cameras, scene


def test_points_lie_where_a_ring_of_cameras_looks() -> None:
    found = drawn_points(cameras())
    assert len(found.positions) > 1000
    seen = np.mean([in_view(found.positions, camera) for camera in cameras()], axis=0)
    assert seen.min() >= 1 / 3
    spread = np.abs(found.positions - found.positions.mean(axis=0)).max()
    np.testing.assert_allclose(found.positions.mean(axis=0), scene().positions.mean(axis=0), atol=0.3 * spread)
    np.testing.assert_array_equal(found.positions, drawn_points(cameras()).positions)


def test_cameras_that_look_the_same_way_see_them_too() -> None:
    """Parallel axes meet nowhere."""
    row = []
    for step in range(4):
        pose = np.eye(4)
        pose[0, 3] = step
        row.append(replace(cameras()[0], world_to_camera=pose))
    found = drawn_points(row)
    assert len(found.positions) > 1000
    assert np.isfinite(found.positions).all()
    assert in_view(found.positions, row[0]).any()
