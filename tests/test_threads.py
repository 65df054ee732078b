"""Many items, a thread each: the same results, in order, and not far ahead of who takes them."""

from __future__ import annotations

import threading
from functools import partial

import numpy as np
import pytest

from scarfmt.errors import InvalidInput
from scarfmt.render.camera import orbit_cameras
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render
from scarfmt.threads import count_threads, map_threads
from tests.render.scenes import random_scene


@pytest.mark.parametrize("threads", [1, 3])
def test_pictures_are_those_of_one_after_the_other_in_order(threads: int) -> None:
    """Bit for bit: threads that draw share nothing that one of them changes."""
    drawable = Drawable.of(random_scene(4, 400))
    cameras = orbit_cameras(drawable.scene, 9, width=48, height=40)
    drawn = list(map_threads(partial(render, drawable), cameras, threads))
    assert len(drawn) == len(cameras)
    assert len({picture.tobytes() for picture in drawn}) > 1
    for picture, camera in zip(drawn, cameras, strict=True):
        np.testing.assert_array_equal(picture, render(drawable, camera))


@pytest.mark.parametrize("threads", [1, 2])
def test_results_are_made_on_so_many_threads_and_not_far_ahead(threads: int) -> None:
    """A caller that takes the first result does not cause all others to be kept; one thread is the caller's."""
    seen: list[int] = []

    def work(item: int) -> int:
        seen.append(threading.get_ident())
        return item

    results = map_threads(work, range(200), threads)
    assert next(results) == 0
    assert len(seen) < 200
    assert list(results) == list(range(1, 200))
    assert (threading.get_ident() in seen) == (threads == 1)
    assert len(set(seen)) <= threads


def test_as_many_threads_as_the_environment_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """`OMP_NUM_THREADS` counts where it is a number above zero."""
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert count_threads() == 7
    for other in ("0", "many", ""):
        monkeypatch.setenv("OMP_NUM_THREADS", other)
        assert count_threads() >= 1


def test_an_error_reaches_who_asked() -> None:
    """The error is that of an item that cannot be done; earlier ones raise none."""
    scene = random_scene(4, 20)
    wrong = np.zeros((3, 3))
    with pytest.raises(InvalidInput, match="colours"):
        list(map_threads(partial(render, scene, colours=wrong), orbit_cameras(scene, 2), 2))
