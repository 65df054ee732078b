"""The example scene and its cameras."""

from __future__ import annotations

import numpy as np

from scarfmt.formats import load
from scarfmt.render.capture import load_cameras
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from tests.conftest import REPOSITORY

EXAMPLES = REPOSITORY / "examples"


def example() -> GaussianScene:
    scene = load(EXAMPLES / "plush-toys.ply")
    assert isinstance(scene, GaussianScene)
    assert not scene.invalid_rows().any()
    return scene


def test_the_encoder_does_not_know_the_views_it_is_judged_from() -> None:
    """Figures from views the encoder was tuned for would flatter it."""
    known = {camera.name for camera in load_cameras(EXAMPLES / "plush-toys.cameras.json")}
    judged = {camera.name for camera in load_cameras(EXAMPLES / "plush-toys.views.json")}
    assert len(known) == len(judged) == 8
    assert not known & judged


def test_the_cameras_look_at_the_toys() -> None:
    """From a wrong pose the picture is black or fog: neither bright in the middle nor rich in contrast."""
    camera = load_cameras(EXAMPLES / "plush-toys.views.json")[0]
    middle = render(example(), camera)[90:270, 120:360]
    assert float(middle.mean()) > 0.2
    assert float(np.std(middle)) > 0.15
