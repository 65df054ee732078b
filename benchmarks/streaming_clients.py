"""Clients that fetch a scene while a head moves: of a `.scar` file as ScarStream does, and of a whole file."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from dataclasses import replace
from itertools import chain
from typing import Protocol, cast

import numpy as np

from benchmarks.streaming_network import Flow, Link
from benchmarks.streaming_policies import Moment, Order
from benchmarks.streaming_requests import FIRST_BYTES, MOST_PARALLEL, Meter, next_request
from scarfmt.blocks.streaming import Streaming, read_streaming
from scarfmt.container.directory import Entry
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import BytesSource
from scarfmt.streaming.plan import SceneIndex
from scarfmt.streaming.view import Camera

REPLAN_S = 0.1
"""Views come, and plans are made anew, this often."""
_SAMPLE_S = 0.02
"""Maximum time between two counts of what has arrived."""


class Client(Protocol):
    """The interface of a client that fetches.

    Attributes:
        asked: when, of each request.
        shown: from when on, what there was to draw.
        came: when, what, how many bytes of it; what is drawn of a scene, and nothing else.
    """

    asked: list[float]
    shown: list[tuple[float, Hashable]]
    came: list[tuple[float, Hashable, float]]

    @property
    def done(self) -> bool:
        """Whether everything has come."""

    def look(self, now: float, camera: Camera) -> None:
        """The view, each :data:`REPLAN_S`."""

    def ask(self, now: float, link: Link) -> None:
        """A moment to ask for more."""

    def took(self, now: float, flow: Flow, size: float) -> None:
        """Called when this many bytes of an answer have arrived."""


def run(client: Client, link: Link, view_at: Callable[[float], Camera], horizon: float) -> None:
    """Let a client fetch until it has everything, or for `horizon` seconds."""
    now, view = 0.0, 0.0
    while now < horizon and not client.done:
        if now >= view:
            client.look(now, view_at(now))
            view += REPLAN_S
        client.ask(now, link)
        until = link.next_event(now, min(view, now + _SAMPLE_S))
        brought = link.advance(now, until)
        now = until
        for flow, size in brought:
            client.took(now, flow, size)


class WholeFile:
    """Shows nothing before the last byte.

    Args:
        size: bytes.
    """

    def __init__(self, size: int) -> None:
        self._size, self._done = size, False
        self.asked: list[float] = []
        self.shown: list[tuple[float, Hashable]] = [(0.0, False)]
        self.came: list[tuple[float, Hashable, float]] = []

    @property
    def done(self) -> bool:
        """Whether everything has come."""
        return self._done

    def look(self, now: float, camera: Camera) -> None:
        """Do nothing: the view does not matter."""

    def ask(self, now: float, link: Link) -> None:
        """The file, once."""
        if not self.asked:
            link.ask(now, None, self._size)
            self.asked.append(now)

    def took(self, now: float, flow: Flow, size: float) -> None:
        """Shown once it is whole."""
        self.came.append((now, None, size))
        if flow.done:
            self._done = True
            self.shown.append((now, True))


class ScarFile:
    """The values that a client needs to know of a file of T tiles and L layers.

    Args:
        data: the file.
    """

    def __init__(self, data: bytes) -> None:
        container = Container.open(BytesSource(data)).load()
        header = container.header
        self.size, self.front, self.index = len(data), header.data_offset, SceneIndex.of(container)
        self.streaming = read_streaming(container)
        self.annotation = container.find(BlockKind.STREAMING, 1)
        layers = range(1, header.layer_count + 1)
        found = [[container.find(kind, layer) for kind in range(1, BlockKind.TILE)] for layer in layers]
        self.models: list[list[Entry]] = [[entry for entry in row if entry is not None] for row in found]
        tiles = ((tile, layer, container.find(BlockKind.TILE, layer, tile)) for layer in layers
                 for tile in range(header.tile_count))  # fmt: skip
        self.tiles: dict[tuple[int, int], Entry] = {
            (tile, layer): entry for tile, layer, entry in tiles if entry is not None
        }

    @property
    def blocks(self) -> list[Entry]:
        """All that a client may fetch, by offset."""
        told = [] if self.annotation is None else [self.annotation]
        entries = [*(entry for row in self.models for entry in row), *self.tiles.values(), *told]
        return sorted(entries, key=lambda entry: entry.offset)


class ScarStream:
    """Fetches a file in the order of a policy, with the requests of ScarStream (`web/src/stream`).

    Requests that a turn of the head made useless are not given up, and decoding takes no time.

    Args:
        file: the file.
        order: the policy.
        told: whether it wants to see what the file tells.
    """

    def __init__(self, file: ScarFile, order: Order, told: bool) -> None:
        self._file, self._order = file, order
        self._annotation = file.annotation if told else None
        self._streaming: Streaming | None = None
        tiles, layers = file.index.bytes.shape
        self._shape = tiles, layers
        self.have = np.zeros(tiles, np.int64)
        self._arrived: set[int] = set()
        self._under_way: set[int] = set()
        self._partial: dict[int, int] = {}
        self._wanted: list[Entry] = []
        self._moment: Moment | None = None
        self._meter, self._front, self._planned = Meter(), False, False
        self.asked: list[float] = []
        self.shown: list[tuple[float, Hashable]] = [(0.0, tuple(self.have.tolist()))]
        self.came: list[tuple[float, Hashable, float]] = []

    @property
    def done(self) -> bool:
        """Whether all layers of all tiles have come."""
        return bool((self.have == self._shape[1]).all())

    def look(self, now: float, camera: Camera) -> None:
        """Plan anew."""
        before = self._moment
        if before is not None:
            camera = replace(camera, velocity=(camera.position - before.camera.position) / (now - before.seconds))
        self._moment = Moment(self._file.index, self._streaming, camera, now, tuple(self.have))
        self._planned = False

    def ask(self, now: float, link: Link) -> None:
        """Send as many requests as may be under way."""
        if not self.asked:
            size = max(min(FIRST_BYTES, self._file.size), self._file.front)
            inside = [entry for entry in self._file.blocks if entry.end <= size]
            self._start(now, link, (0, size), inside)
        if not self._front:
            return
        while not link.flows or self._may_ask(now, link):
            self._plan()
            idle = self._idle()
            first = next(idle, None)
            if first is None:
                return
            chosen = next_request(chain([first], idle), self._meter.sizes(now))
            start, end = chosen[0].offset, chosen[-1].end
            # A gap may hold blocks that are wanted later.
            along = sorted((e for e in self._idle() if start <= e.offset and e.end <= end), key=lambda e: e.offset)
            self._start(now, link, (start + self._partial.pop(start, 0), end), along)
            self._meter.begin(now)

    def _may_ask(self, now: float, link: Link) -> bool:
        left = sum(flow.size - flow.got for flow in link.flows)
        return len(link.flows) < MOST_PARALLEL and left < self._meter.sizes(now).under_way

    def _start(self, now: float, link: Link, span: tuple[int, int], entries: list[Entry]) -> None:
        start, end = span
        front = [self._file.front] if start == 0 else []
        link.ask(now, (start, entries), end - start, [*front, *(entry.end - start for entry in entries)])
        self._under_way |= {entry.offset for entry in entries}
        self.asked.append(now)

    def _plan(self) -> None:
        if self._planned or self._moment is None:
            return
        self._planned, models, entries = True, 0, []
        moment = replace(self._moment, streaming=self._streaming, have=tuple(self.have))
        for tile, layer in self._order(moment):
            for number in range(models, layer):
                entries += self._file.models[number]
                if number == 0 and self._annotation is not None:
                    entries.append(self._annotation)
            models = max(models, layer)
            if (tile, layer) in self._file.tiles:
                entries.append(self._file.tiles[tile, layer])
        self._wanted = [entry for entry in entries if entry.offset not in self._arrived]

    def _idle(self) -> Iterator[Entry]:
        known = self._arrived | self._under_way
        return (entry for entry in self._wanted if entry.offset not in known)

    def took(self, now: float, flow: Flow, size: float) -> None:
        """Blocks are taken as they pass."""
        start, entries = cast(tuple[int, list[Entry]], flow.tag)
        if start > 0 and flow.got == size:
            self._meter.first_byte(flow.ready - flow.asked)
        if self._front:
            self._meter.add(now, size)
        elif flow.got >= self._file.front:
            self._front = True
            self._meter.begin(now)
        reached = start + flow.got
        new = [entry for entry in entries if entry.offset in self._under_way and entry.end <= reached]
        if flow.done:
            self._meter.end()
            self._keep_rest(int(reached))
        for entry in new:
            self._under_way.discard(entry.offset)
            self._arrived.add(entry.offset)
            if entry.tile is not None:
                self.came.append((now, entry.tile, entry.length))
        if new:
            self._update(now, new)

    def _keep_rest(self, past: int) -> None:
        """The first request may end within a block: its beginning is not asked for again."""
        cut = [entry for entry in self._file.blocks if entry.offset < past < entry.end]
        for entry in cut if past == FIRST_BYTES else ():
            self._partial[entry.offset] = past - entry.offset

    def _update(self, now: float, new: list[Entry]) -> None:
        if self._annotation is not None and self._annotation in new:
            self._streaming, self._planned = self._file.streaming, False
        before, ready = self.have.copy(), 0
        while ready < len(self._file.models) and all(e.offset in self._arrived for e in self._file.models[ready]):
            ready += 1
        for tile in range(self._shape[0]):
            while self.have[tile] < ready and self._there(tile, int(self.have[tile]) + 1):
                self.have[tile] += 1
        if (self.have != before).any():
            self.shown.append((now, tuple(self.have.tolist())))

    def _there(self, tile: int, layer: int) -> bool:
        entry = self._file.tiles.get((tile, layer))
        return entry is None or entry.offset in self._arrived

