"""Many views, a thread each: the compiled renderer draws without Python's lock."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from scarfmt.render.camera import Camera

T = TypeVar("T")

_AHEAD = 2
"""Results a thread may be ahead of who takes them: those of large scenes are large."""


def count_threads() -> int:
    """Threads to use: `OMP_NUM_THREADS` if it is set, else the processors that this process may use."""
    said = os.environ.get("OMP_NUM_THREADS", "")
    if said.isdecimal() and int(said) > 0:
        return int(said)
    affinity = getattr(os, "sched_getaffinity", None)  # not on all systems
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def each_view(draw: Callable[[Camera], T], cameras: Iterable[Camera]) -> Iterator[T]:
    """The result of `draw` for each camera, in order; several views are drawn at once.

    Args:
        draw: may be called by several threads at once.
        cameras: the views.
    """
    threads = count_threads()
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[T]] = deque()
        for camera in cameras:
            waiting.append(pool.submit(draw, camera))
            if len(waiting) > _AHEAD * threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
