"""A network of recorded bandwidth: answers take one round trip to begin, and those under way share what there is.

Not modelled: connections are open already, they have no slow start, and nothing is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.scenes import DATA
from scarfmt.arrays import F64

TRACES = DATA / "traces"
CONSTANT_MBIT = 10.0
_BYTES_A_MBIT = 125_000.0
_NEGLIGIBLE = 1e-6
"""Bytes that rounding leaves over."""


@dataclass(frozen=True)
class Trace:
    """A recording, begun again at its end.

    Attributes:
        name: as tables show it.
        starts: (n,) float64 seconds at which each bandwidth begins, from 0.
        mbits: (n,) float64 Mbit/s.
        length: seconds.
    """

    name: str
    starts: F64
    mbits: F64
    length: float

    @classmethod
    def constant(cls, mbits: float) -> Trace:
        """A trace of the same speed at any time."""
        return cls(f"{mbits:g} Mbit/s", np.zeros(1), np.array([mbits]), 1.0)

    @classmethod
    def read(cls, path: Path) -> Trace:
        """A recording of `DATA`/traces: Mbit/s a second, or seconds and Mbit/s."""
        rows = [[float(value) for value in line.split()] for line in path.read_text().splitlines() if line.strip()]
        if len(rows[0]) == 1:
            starts, mbits = np.arange(len(rows), dtype=np.float64), np.array(rows)[:, 0]
        else:
            starts, mbits = np.array(rows).T
        starts = starts - starts[0]
        last = float(starts[-1] - starts[-2]) if len(starts) > 1 else 1.0
        return cls(path.stem, starts, np.maximum(mbits, 0), float(starts[-1]) + last)

    @property
    def mean(self) -> float:
        """Mbit/s over its time."""
        spans = np.diff(self.starts, append=self.length)
        return float((self.mbits * spans).sum() / self.length)

    def at(self, seconds: float) -> tuple[float, float]:
        """Bytes a second now, and when that changes."""
        rounds, within = divmod(seconds, self.length)
        number = int(np.searchsorted(self.starts, within, side="right")) - 1
        until = self.starts[number + 1] if number + 1 < len(self.starts) else self.length
        change = rounds * self.length + float(until)
        # Rounding may leave a moment of the bandwidth before; then the next one counts.
        return float(self.mbits[number]) * _BYTES_A_MBIT, max(change, float(np.nextafter(seconds, np.inf)))


def traces() -> list[Trace]:
    """A constant one, and of each family of recordings the median by mean, the lower of two; none without `DATA`."""
    families = sorted(path for path in TRACES.glob("*") if path.is_dir())
    found = []
    for family in families:
        members = sorted((Trace.read(path) for path in sorted(family.iterdir())), key=lambda trace: trace.mean)
        found.append(members[(len(members) - 1) // 2])
    return [Trace.constant(CONSTANT_MBIT), *found] if found else []


@dataclass(eq=False)
class Flow:
    """An answer under way.

    Attributes:
        tag: what was asked for.
        size: bytes.
        asked, ready: seconds: when it was asked for, and when its first byte can come.
        marks: bytes after which somebody wants to know, ascending; the last is `size`.
        got: bytes that have come.
    """

    tag: object
    size: float
    asked: float
    ready: float
    marks: Sequence[float]
    got: float = 0.0
    _next: int = field(default=0, repr=False)

    @property
    def done(self) -> bool:
        return self.got >= self.size

    @property
    def mark(self) -> float:
        """The next mark."""
        while self._next + 1 < len(self.marks) and self.marks[self._next] <= self.got:
            self._next += 1
        return self.marks[self._next]

    @property
    def to_mark(self) -> float:
        """Bytes to the next mark."""
        return self.mark - self.got


class Link:
    """All answers of one client.

    Args:
        trace: bandwidth over time.
        round_trip: seconds.
    """

    def __init__(self, trace: Trace, round_trip: float) -> None:
        self._trace, self.round_trip = trace, round_trip
        self.flows: list[Flow] = []

    def ask(self, now: float, tag: object, size: float, marks: Sequence[float] = ()) -> Flow:
        """Ask for something."""
        flow = Flow(tag, size, now, now + self.round_trip, [*(mark for mark in marks if 0 < mark < size), size])
        self.flows.append(flow)
        return flow

    def next_event(self, now: float, until: float) -> float:
        """When next an answer begins, comes to a mark or the bandwidth changes; `until` if nothing does before."""
        flowing = [flow for flow in self.flows if flow.ready <= now]
        times = [until, *(flow.ready for flow in self.flows if flow.ready > now)]
        if flowing:
            rate, change = self._trace.at(now)
            times.append(change)
            if rate > 0:
                times += [now + flow.to_mark * len(flowing) / rate for flow in flowing]
        return min(times)

    def advance(self, now: float, until: float) -> list[tuple[Flow, float]]:
        """Let time pass to at most :meth:`next_event`: what came, and how many bytes of it; what is over is gone."""
        flowing = [flow for flow in self.flows if flow.ready <= now]
        brought = []
        if flowing:
            share = self._trace.at(now)[0] * (until - now) / len(flowing)
            for flow in flowing:
                before, left = flow.got, flow.to_mark
                flow.got = flow.mark if left - share < _NEGLIGIBLE else before + share
                brought.append((flow, flow.got - before))
        self.flows = [flow for flow in self.flows if not flow.done]
        return brought
