"""How good a coarse layer looks: colours and worst regions count."""

from __future__ import annotations

import numpy as np
import pytest

from reference_encoder.judge.preview_quality import PreviewJudge, preview_error
from reference_encoder.options import EncodeOptions
from scarfmt.arrays import F32
from scarfmt.render.viewpoints import KINDS, Surroundings, viewpoints
from tests.render.scenes import random_scene


def grey(value: float = 0.5) -> F32:
    """A picture of one brightness."""
    return np.full((24, 32, 3), value, np.float32)


def test_an_even_error_counts_as_in_the_psnr() -> None:
    """A picture that is everywhere a tenth too bright has a squared error of a hundredth."""
    assert preview_error(grey(0.6), grey(0.5)) == pytest.approx(0.01, rel=1e-5)


def test_noise_is_forgiven_and_a_hole_is_not() -> None:
    """At equal squared errors noise of single pixels counts about half, and noise in a single block twice and more."""
    draw = np.random.default_rng(1)
    noisy = grey() + 0.1 * draw.choice([-1.0, 1.0], (24, 32, 3)).astype(np.float32)
    holed = grey()
    holed[:8, :8] += np.float32(0.1 * np.sqrt(12))
    mean = 0.01
    assert preview_error(noisy, grey()) < 0.55 * mean
    assert preview_error(holed, grey()) > 2 * mean


def test_views_of_all_kinds_are_looked_at() -> None:
    """Each kind has as many views. The scene itself looks perfect, and no view counts for more than the maximum."""
    scene = random_scene(1, 300, 0)
    looks = PreviewJudge.of(scene, EncodeOptions(frame="-y", seed=3))
    counts = [sum(camera.name.startswith(kind) for camera in looks.cameras) for kind in KINDS]
    assert len(set(counts)) == 1
    assert looks.psnr_db(scene, 35.0) == 35.0
    assert looks.psnr_db(scene.take(np.arange(150)), 35.0) < 35.0


def test_a_fence_of_cameras_is_not_left() -> None:
    """If only the given cameras count, layers are judged from those, in small pictures."""
    scene = random_scene(1, 300, 0)
    given = [view.scaled(2) for view in viewpoints(Surroundings.of(scene, "-y"), "orbit", 30, 5)]
    looks = PreviewJudge.of(scene, EncodeOptions(cameras=given, only_cameras=True))
    centres = {camera.centre.tobytes() for camera in given}
    assert 10 <= len(looks.cameras) <= 12
    assert {camera.centre.tobytes() for camera in looks.cameras} <= centres
    assert {camera.width for camera in looks.cameras} == {160}
