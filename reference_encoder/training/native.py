"""The compiled loops of training: similarity.c, and how rows of a picture are shared among threads."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial

from reference_encoder.training.raster.loading import load

_BANDS = 4
"""Bands of rows a thread, so that no thread waits long for another."""


class Similarity(ctypes.Structure):
    """The arguments of a call of similarity.c; `Similarity` there describes each."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("picture", "photo", "mean", "square", "window")),
        *((name, ctypes.c_void_p) for name in ("by_mean", "by_square", "by_product", "gradient", "sums", "scratch")),
        ("height", ctypes.c_int64),
        ("width", ctypes.c_int64),
        ("share", ctypes.c_float),
        ("c1", ctypes.c_float),
        ("c2", ctypes.c_float),
    )


@cache
def _library() -> ctypes.CDLL:
    found = load()
    found.scar_similarity.restype = None
    found.scar_similarity.argtypes = [ctypes.POINTER(Similarity), *[ctypes.c_int64] * 4]
    return found


def run_similarity(job: Similarity, threads: int) -> None:
    """Run both phases of a job; `threads` share the rows.

    Raises:
        InvalidInput: ``input-dependency`` where the compiled library is missing.
    """
    for phase in (1, 2):
        on_threads(partial(_library().scar_similarity, ctypes.byref(job), phase), job.height, threads)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "scarfmt-training")


def on_threads(work: Callable[[int, int, int], None], rows: int, threads: int) -> None:
    """Call ``work(first row, row after the last, thread)`` for all rows, threads side by side."""

    def share(thread: int) -> None:
        for band in range(thread, threads * _BANDS, threads):
            work(rows * band // (threads * _BANDS), rows * (band + 1) // (threads * _BANDS), thread)

    list(_pool(threads).map(share, range(threads)))
