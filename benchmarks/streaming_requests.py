"""The requests of a client and its measure of speed, by the rules of `web/src/stream/{requests,meter}.ts`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from scarfmt.container.directory import Entry

FIRST_BYTES = 64 << 10
MOST_PARALLEL = 4
_LEAST_REQUEST, _MOST_REQUEST = 32 << 10, 256 << 10
_LEAST_GAP, _MOST_GAP = 4 << 10, 16 << 10
_UNDER_WAY_S = 0.225
_FIRST_GUESS = 1.25e6
_MEMORY_S, _LEAST_SAMPLE_S, _KEPT_DELAYS = 1.0, 0.02, 8
_STRETCH_MS, _KEPT_STRETCHES_MS = 100, 2000


@dataclass(frozen=True)
class Sizes:
    """Bytes: blocks so far down the plan may go together, most of a request, widest gap read, most under way."""

    window: float
    most: float
    gap: float
    under_way: float

    @classmethod
    def of(cls, rate: float, delay: float) -> Sizes:
        """For so many bytes a second, and seconds to the first byte of an answer."""
        under_way = max(rate * (_UNDER_WAY_S + delay), 2 * _LEAST_REQUEST)
        most = max(min(under_way / 3, _MOST_REQUEST), _LEAST_REQUEST, under_way / MOST_PARALLEL)
        gap = min(max(rate * delay / MOST_PARALLEL, _LEAST_GAP), _MOST_GAP)
        return cls(max(under_way, most), most, gap, under_way)


def next_request(wanted: Iterable[Entry], sizes: Sizes) -> list[Entry]:
    """Blocks of the next request, by offset: the first that is wanted, and neighbours that are wanted soon.

    Args:
        wanted: in the order of the plan, none of them under way; at least one.
    """
    soon: list[Entry] = []
    size = 0
    for entry in wanted:
        soon.append(entry)
        size += entry.length
        if size >= sizes.window:
            break
    first = soon[0]
    soon.sort(key=lambda entry: entry.offset)
    low = high = soon.index(first)
    while True:
        start, end = soon[low].offset, soon[high].end
        after, before = soon[high + 1 : high + 2], soon[low - 1 : low]
        if after and after[0].offset - end <= sizes.gap and after[0].end - start <= sizes.most:
            high += 1
        elif before and start - before[0].end <= sizes.gap and end - before[0].offset <= sizes.most:
            low -= 1
        else:
            return soon[low : high + 1]


class Meter:
    """How fast bytes come, and how long the first of an answer takes; 10 Mbit/s before anything was measured."""

    def __init__(self) -> None:
        self._rate: float | None = None
        self._under_way = 0
        self._since = self._bytes = 0.0
        self._delays: list[float] = []
        self._arrivals: list[tuple[float, float]] = []
        self._best: list[tuple[float, float]] = []

    def sizes(self, now: float) -> Sizes:
        """The sizes of requests, by the speed of the bytes: the present one, or that of the best stretch of the last
        seconds."""
        rate = _FIRST_GUESS if self._rate is None else self._rate
        recent = (speed for when, speed in self._best if when > now - _KEPT_STRETCHES_MS / 1000)
        return Sizes.of(max(rate, next(recent, 0.0)), min(self._delays, default=0.0))

    def begin(self, now: float) -> None:
        """Something is asked for."""
        if self._under_way == 0:
            self._since, self._bytes = now, 0.0
        self._under_way += 1

    def first_byte(self, delay: float) -> None:
        """An answer began."""
        self._delays = [*self._delays, delay][-_KEPT_DELAYS:]

    def add(self, now: float, size: float) -> None:
        """Bytes came."""
        self._add_to_stretch(now, size)
        self._bytes += size
        elapsed = now - self._since
        if elapsed < _LEAST_SAMPLE_S:
            return
        kept = 0.0 if self._rate is None else math.exp(-elapsed / _MEMORY_S)
        self._rate = kept * (self._rate or 0.0) + (1 - kept) * self._bytes / elapsed
        self._since, self._bytes = now, 0.0

    def _add_to_stretch(self, now: float, size: float) -> None:
        stretch, kept = _STRETCH_MS / 1000, _KEPT_STRETCHES_MS / 1000
        self._arrivals = [(when, part) for when, part in [*self._arrivals, (now, size)] if when > now - stretch]
        speed = sum(part for _, part in self._arrivals) / stretch
        self._best = [(when, other) for when, other in self._best if other > speed and when > now - kept]
        self._best.append((now, speed))

    def end(self) -> None:
        """An answer is over."""
        self._under_way -= 1
