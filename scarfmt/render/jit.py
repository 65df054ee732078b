"""One place for numba's options, so that every kernel is compiled and typed alike; and many views, a thread each."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from types import FunctionType
from typing import Any, TypeVar, cast

import numba

from scarfmt.render.camera import Camera

_Function = TypeVar("_Function", bound=Callable[..., Any])

# Some numba threading layers abort the process when two Python threads enter them at once.
_entered = threading.Lock()
_mode = threading.local()


class Kernel:
    """A function compiled twice: with its `numba.prange` loops on all threads, and for one thread.

    Of many small pictures each is drawn by one thread: threads that share a small picture wait for each other longer
    than they draw. Both variants do the same arithmetic in the same order.
    """

    def __init__(self, function: FunctionType) -> None:
        # The name tells the two apart in numba's cache, which does not look at options.
        alone = FunctionType(function.__code__, function.__globals__, function.__name__)
        alone.__module__, alone.__qualname__ = function.__module__, f"{function.__qualname__}_alone"
        self.together = numba.njit(cache=True, parallel=True, error_model="numpy")(function)
        self.alone = numba.njit(cache=True, nogil=True, error_model="numpy")(alone)

    def __call__(self, *arguments: Any) -> Any:
        """Run on all threads, or on this one within :func:`one_thread`."""
        if getattr(_mode, "alone", False):
            return self.alone(*arguments)
        with _entered:
            return self.together(*arguments)


@contextmanager
def one_thread() -> Iterator[None]:
    """Kernels that this Python thread calls run on it alone, without holding up others."""
    before = getattr(_mode, "alone", False)
    _mode.alone = True
    try:
        yield
    finally:
        _mode.alone = before


def kernel(function: _Function) -> _Function:
    """Compile `function` with its `numba.prange` loops on all threads, or on one (:class:`Kernel`).

    No fast-math: reassociated sums would make pictures depend on the machine. numba renews its cache when the
    file of the function changes, not that of an imported constant: delete `__pycache__` after editing one.
    """
    assert isinstance(function, FunctionType)
    return cast(_Function, Kernel(function))


def device(function: _Function) -> _Function:
    """Compile a single-threaded helper, callable from kernels and from Python."""
    return cast(_Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


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
