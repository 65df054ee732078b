"""Several items at once, a thread each: C and most of NumPy work without Python's lock."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

S = TypeVar("S")
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


def map_threads(function: Callable[[S], T], items: Iterable[S], threads: int | None = None) -> Iterator[T]:
    """The result of `function` for each item, in order; several are worked on at once.

    Args:
        function: may be called by several threads at once.
        items: taken one after the other, by the caller's thread.
        threads: None for :func:`count_threads`.
    """
    threads = threads or count_threads()
    if threads == 1:
        yield from map(function, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        ahead: deque[Future[T]] = deque()
        try:
            for item in items:
                ahead.append(pool.submit(function, item))
                if len(ahead) > _AHEAD * threads:
                    yield ahead.popleft().result()
            while ahead:
                yield ahead.popleft().result()
        finally:
            for future in ahead:
                future.cancel()
