"""The order in which symbols of several contexts travel: grouped by ascending context (SPEC §8.4)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64


def by_context(contexts: NDArray[np.integer[Any]]) -> tuple[I64, list[tuple[int, int, int]]]:
    """Stable order by ascending context, (n,) below 2^14, and (context, start, past) of each run in it."""
    # As few bits as possible: numpy sorts 8 and 16 bits by counting.
    small = contexts.astype(np.uint8 if len(contexts) and contexts.max() < 256 else np.uint16)
    order = np.argsort(small, kind="stable")
    counts = np.bincount(small)
    present = np.flatnonzero(counts)
    ends = np.cumsum(counts[present]).tolist()
    return order, list(zip(present.tolist(), [0, *ends][:-1], ends, strict=True))
