"""Many views, a thread each: the same pictures, in order."""

from __future__ import annotations

import threading
from functools import partial

import numpy as np
import pytest

from scarfmt.arrays import F32
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import Camera, orbit_cameras
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render
from scarfmt.render.threads import each_view
from tests.render.scenes import random_scene


def test_pictures_are_those_of_all_threads_together_in_order() -> None:
    """Bit for bit: the two ways that kernels are compiled do the same arithmetic."""
    drawable = Drawable.of(random_scene(4, 400))
    cameras = orbit_cameras(drawable.scene, 9, width=48, height=40)
    drawn = list(each_view(partial(render, drawable), cameras))
    assert len(drawn) == len(cameras)
    assert len({picture.tobytes() for picture in drawn}) > 1
    for picture, camera in zip(drawn, cameras, strict=True):
        np.testing.assert_array_equal(picture, render(drawable, camera))


def test_views_are_drawn_by_other_threads_and_not_far_ahead() -> None:
    """A caller that takes the first picture does not cause all others to be kept."""
    scene = random_scene(4, 20)
    seen: list[int] = []

    def draw(camera: Camera) -> F32:
        seen.append(threading.get_ident())
        return render(scene, camera)

    views = each_view(draw, orbit_cameras(scene, 200, width=16, height=16))
    next(views)
    assert threading.get_ident() not in seen
    assert len(seen) < 200
    assert len(list(views)) == 199


def test_an_error_reaches_who_asked() -> None:
    """The error is that of a view that cannot be drawn; earlier views raise none."""
    scene = random_scene(4, 20)
    wrong = np.zeros((3, 3))
    with pytest.raises(InvalidInput, match="colours"):
        list(each_view(partial(render, scene, colours=wrong), orbit_cameras(scene, 2)))
