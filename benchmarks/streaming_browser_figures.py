"""The figures from the notes of a page: when a view is complete, when it reaches a PSNR, which task was longest."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

from benchmarks.streaming_clients import ScarFile, ScarStream, run
from benchmarks.streaming_network import Link, Trace
from benchmarks.streaming_orders import Fetching, Film, by_gains, planned_for
from benchmarks.streaming_policies import planned
from scarfmt.blocks.streaming import Streaming, read_streaming
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from scarfmt.render.camera import Camera, look_at
from scarfmt.render.metrics import psnr
from scarfmt.streaming.boxes import tight_boxes
from scarfmt.streaming.view import share_in_picture

DECIBELS = (30.0, 35.0)
REQUESTS_BEFORE = 2
"""Round trips before the first tile can come: for the front, and for what it names."""
SIMULATED_S = 600.0
"""The simulation ends by then at the latest."""
Figures = dict[str, float | None]


@dataclass(frozen=True)
class Log:
    """The notes of a page about one scene, in milliseconds since it was requested.

    Attributes:
        front: when the front was read.
        tiles: when, tile, layer: decoded.
        drawn: when, tile, layer: on the GPU.
        tasks: when, milliseconds, milliseconds of the processor: what the main thread did at one go.
        done: when all was there.
        most_memory: bytes, as the stream says.
        splats, evictions: Gaussians shown in the end, tiles that were taken away.
    """

    front: float
    tiles: list[tuple[float, int, int]]
    drawn: list[tuple[float, int, int]]
    tasks: list[tuple[float, float, float]]
    done: float
    most_memory: float
    splats: int
    evictions: int

    @classmethod
    def of(cls, noted: dict[str, Any]) -> Log:
        """A `PageLog` of web/test/watched_page.ts.

        Raises:
            RuntimeError: the page told of an error.
        """
        if noted["errors"] or noted["done"] is None:
            raise RuntimeError(f"the page says: {noted['errors'] or 'nothing'}")
        since = float(noted["click"])
        tiles, drawn = ([(at - since, tile, layer) for at, tile, layer in noted[name]] for name in ("tiles", "drawn"))
        tasks = [(at - since, wall, work) for at, wall, work in noted["tasks"] if at >= since]
        stats = noted["stats"]
        front, done = noted["fronts"][0] - since, noted["done"] - since
        return cls(front, tiles, drawn, tasks, done, noted["mostMemory"], stats["splatsShown"], stats["evictions"])


class Picture:
    """The view that a file of T tiles begins with, after any layers of any tiles.

    Args:
        data: the file; it has a STREAMING block with a view.
        scene: all integers of it.
        size: of the page, pixels; pictures are half as wide and high.
    """

    def __init__(self, data: bytes, scene: QuantisedScene, size: tuple[int, int]) -> None:
        told = read_streaming(Container.open(BytesSource(data)).load())
        if told is None or told.view is None:
            raise ValueError("the file names no view")
        self.told: Streaming = told
        self.file, self.fetching, self._film = ScarFile(data), Fetching(data), Film(scene)
        width, height = size[0] // 2, size[1] // 2
        across = 2 * math.atan(math.tan(told.view.fov / 2) * width / height)
        view = told.view
        self.camera: Camera = look_at(view.position, view.target, view.up, width, height, math.degrees(across))
        self.seen = share_in_picture(tight_boxes(self.fetching.index.cubes, told), planned_for(self.camera)) > 0
        self.tiles, self.layers = len(self.seen), len(self._film.layers)
        self.splats = len(self._film.layers[-1])
        self._whole = self._film.picture([self.layers] * self.tiles, self.camera)

    def complete(self, have: Sequence[int]) -> bool:
        """Whether no tile in the picture lacks its first layer."""
        return all(layer > 0 for layer, seen in zip(have, self.seen, strict=True) if seen)

    def decibels(self, have: Sequence[int]) -> float:
        """Against the whole file."""
        return min(psnr(self._film.picture(have, self.camera), self._whole), 100.0)


def figures(log: Log, picture: Picture) -> Figures:
    """Seconds to front, first tile on the GPU, complete picture, dB and all; the longest task, ms of the processor."""
    states = _states([(at, tile, layer) for at, tile, layer in log.drawn], picture.tiles)
    return {
        "front": log.front / 1000,
        "first": states[0][0] / 1000,
        **_reached(states, picture),
        "all": states[-1][0] / 1000,
        "task": max((work for _, _, work in log.tasks), default=0.0),
        "memory": log.most_memory / 1e6,
    }


def by_bytes(picture: Picture, mbit: float, round_trip_ms: float) -> Figures:
    """The figures if blocks came in the order of the plan, without a pause, and decoding took no time."""
    fetching, told = picture.fetching, picture.told
    steps = by_gains(fetching.index, told, planned_for(picture.camera))
    ahead = REQUESTS_BEFORE * round_trip_ms
    times = ahead + fetching.sizes(steps, True) * 8 / (1000 * mbit)
    states = _states([(at, *step) for at, step in zip(times, steps, strict=True)], picture.tiles)
    front = round_trip_ms + fetching.front * 8 / (1000 * mbit)
    found = {"front": front / 1000, "first": states[0][0] / 1000, **_reached(states, picture)}
    return {**found, "all": states[-1][0] / 1000, "task": None, "memory": None}


def simulated(picture: Picture, mbit: float, round_trip_ms: float) -> Figures:
    """The figures with the requests of a client (`benchmarks.streaming_clients`), if decoding took no time."""
    camera, client = planned_for(picture.camera), ScarStream(picture.file, planned, True)
    run(client, Link(Trace.constant(mbit), round_trip_ms / 1000), lambda _: camera, SIMULATED_S)
    states = [(1000 * at, list(cast(tuple[int, ...], have))) for at, have in client.shown if any(cast(Any, have))]
    front = round_trip_ms / 1000 + picture.file.front * 8 / (1e6 * mbit)
    found = {"front": front, "first": states[0][0] / 1000, **_reached(states, picture)}
    return {**found, "all": states[-1][0] / 1000, "task": None, "memory": None}


States = list[tuple[float, list[int]]]


def _states(events: Sequence[tuple[float, int, int]], tiles: int) -> States:
    """When, and the layers of each tile from then on."""
    have, states = [0] * tiles, []
    for at, tile, layer in events:
        have = [*have[:tile], max(have[tile], layer), *have[tile + 1 :]]
        states.append((float(at), have))
    return states


def _reached(states: States, picture: Picture) -> Figures:
    found: Figures = {"complete": _first(states, picture.complete)}
    for most in DECIBELS:
        found[f"{most:g} dB"] = _first(states, partial(_is_as_good, picture, most))
    return found


def _is_as_good(picture: Picture, decibels: float, have: Sequence[int]) -> bool:
    return picture.decibels(have) >= decibels


def _first(states: States, holds: Callable[[Sequence[int]], bool]) -> float | None:
    """Seconds to the first state of which something holds, and of all after it; None if of none."""
    at = bisect_left(range(len(states)), 1, key=lambda number: int(holds(states[number][1])))
    return None if at == len(states) else states[at][0] / 1000
