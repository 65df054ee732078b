"""From what a client had at each moment, and how good that looked, to figures."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.streaming_clients import Client

LEVELS_DB = (25.0, 30.0, 35.0, 41.0)
"""The first of these is a first complete picture."""
WATCHED_S = 10.0
ENOUGH_DB = 45.0
"""In means over time more than this counts as this."""
_STEP, _BEFORE, _AFTER = 1.25, 24, 12
MOMENTS = WATCHED_S * _STEP ** np.arange(-_BEFORE, _AFTER, dtype=np.float64)
"""Seconds at which pictures are looked at."""
HORIZON_S = float(MOMENTS[-1])

Decibels = Callable[[int, Hashable], float]
"""The PSNR of the view at one of `MOMENTS`, for what can be drawn then."""


def figures_of(client: Client, decibels: Decibels, unseen: Mapping[Hashable, float]) -> dict[str, Any]:
    """The figures of one client in one condition.

    Args:
        client: after its run.
        decibels: how good pictures are.
        unseen: of each thing that comes, the part that is never looked at.

    Returns:
        ``to``: seconds until the view first has each of `LEVELS_DB`, None if never. ``db``: at each moment looked at.
        ``mean``: dB over the first `WATCHED_S` seconds. Over these too: ``requests``, ``bytes`` of the scene, and
        ``unseen`` bytes of them.
    """
    curve = _curve(client, decibels)
    came = [(what, size) for seconds, what, size in client.came if seconds <= WATCHED_S]
    return {
        "to": [_rounded(seconds_to(level, client.shown, curve)) for level in LEVELS_DB],
        "mean": round(mean_db(curve), 2),
        "requests": sum(asked <= WATCHED_S for asked in client.asked),
        "bytes": round(sum(size for _, size in came)),
        "unseen": round(sum(size * unseen[what] for what, size in came)),
        "db": [round(value, 1) for value in curve[: _BEFORE + 1]],
    }


def _curve(client: Client, decibels: Decibels) -> list[float]:
    """dB at each moment: those watched, and on until all has come or nothing better is asked for."""
    last, curve = client.shown[-1][0], []
    for moment, seconds in enumerate(MOMENTS):
        curve.append(decibels(moment, state_at(client.shown, float(seconds))))
        if seconds >= max(WATCHED_S, last) or (seconds >= WATCHED_S and max(curve) >= LEVELS_DB[-1]):
            break
    return curve


def state_at(shown: Sequence[tuple[float, Hashable]], seconds: float) -> Hashable:
    """The tiles and layers that could be drawn at a moment."""
    return shown[bisect_right([since for since, _ in shown], seconds) - 1][1]


def seconds_to(level: float, shown: Sequence[tuple[float, Hashable]], curve: Sequence[float]) -> float | None:
    """When the view first is that good; None if it never is.

    Between two moments it grows evenly from the first change of what is drawn to the last one, so what changes once
    changes then.
    """
    reached = next((moment for moment, found in enumerate(curve) if found >= level), None)
    if reached is None:
        return None
    before = float(MOMENTS[reached - 1]) if reached else 0.0
    changes = [since for since, _ in shown if before < since <= MOMENTS[reached]]
    low, high = (changes[0], changes[-1]) if changes else (before, float(MOMENTS[reached]))
    start = curve[reached - 1] if reached else 0.0
    return low + (high - low) * (level - start) / (curve[reached] - start)


def mean_db(curve: Sequence[float]) -> float:
    """Over the first `WATCHED_S` seconds, along lines between moments; before the first as at it."""
    seconds = np.concatenate([[0.0], MOMENTS[: _BEFORE + 1]])
    found = np.minimum([curve[0], *curve[: _BEFORE + 1]], ENOUGH_DB)
    return float(np.trapezoid(found, seconds) / WATCHED_S)


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 3)
