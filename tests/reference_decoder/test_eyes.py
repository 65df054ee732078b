"""Camera places for anchors whose captures are unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from reference_decoder.eyes import default_views

from .models import random_model


def test_views_stand_round_the_anchors_and_look_at_them() -> None:
    """Further than the median anchor, within three times that, mostly above; each has the middle before it."""
    model = random_model(anchors=400)
    moved = replace(model, anchors=100 * model.anchors + 1e4)
    for scene in (model, moved):
        middle = np.median(scene.anchors, axis=0)
        radius = np.median(np.linalg.norm(scene.anchors - middle, axis=1))
        views = default_views(scene, 40)
        away = np.array([view.centre for view in views]) - middle
        distance = np.linalg.norm(away, axis=1) / radius
        assert (distance > 0.99).all()
        assert (distance < 3.01).all()
        assert len(np.unique(np.sign(away[:, [0, 2]]), axis=0)) == 4
        ahead = [view.world_to_camera[2, :3] @ (middle - view.centre) for view in views]
        assert min(ahead) > 0


def test_one_anchor_is_looked_at_too() -> None:
    views = default_views(random_model(anchors=1))
    assert all(np.isfinite(view.world_to_camera).all() for view in views)
