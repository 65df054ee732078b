"""Many views of one scene, each by a thread of its own."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import numba

from scarfmt.render.camera import Camera
from scarfmt.render.jit import one_thread

T = TypeVar("T")

_AHEAD = 2
"""Results a thread may be ahead of who takes them: those of large scenes are large."""


def each_view(draw: Callable[[Camera], T], cameras: Iterable[Camera]) -> Iterator[T]:
    """The result of `draw` for each camera, in order. Numba's threads draw several views at once.

    Args:
        draw: may be called by several threads at once; what it calls of :mod:`scarfmt.render` runs on one thread each.
        cameras: the views.
    """

    def alone(camera: Camera) -> T:
        with one_thread():
            return draw(camera)

    threads = numba.get_num_threads()
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[T]] = deque()
        for camera in cameras:
            waiting.append(pool.submit(alone, camera))
            if len(waiting) > _AHEAD * threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
