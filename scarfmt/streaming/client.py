"""Fetching a file in the order of a plan: few requests, and a copy of what has come that can be decoded meanwhile."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from scarfmt.blocks.streaming import Streaming, read_streaming
from scarfmt.container.directory import Entry
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import ByteSource, RangeSource, short_source
from scarfmt.streaming.plan import SceneIndex, Step, plan
from scarfmt.streaming.view import Camera

GAP_BYTES = 4 << 10
"""Maximum gap between two wanted blocks that one request reads across."""
REQUEST_BYTES = 256 << 10
"""Maximum bytes of a request, unless a single block is larger."""


class PartialCopy(RangeSource):
    """The part of a file that has arrived. Reads beyond it are refused, as if the file ended before.

    Args:
        size: of the whole file, bytes.
    """

    def __init__(self, size: int) -> None:
        super().__init__(size)
        self._data = bytearray(size)
        self._spans: list[tuple[int, int]] = []

    def put(self, offset: int, data: bytes) -> None:
        """Keep bytes that have come."""
        self._data[offset : offset + len(data)] = data
        merged: list[tuple[int, int]] = []
        for start, past in sorted([*self._spans, (offset, offset + len(data))]):
            if merged and start <= merged[-1][1]:
                merged[-1] = merged[-1][0], max(past, merged[-1][1])
            else:
                merged.append((start, past))
        self._spans = merged

    def holds(self, offset: int, length: int) -> bool:
        """Whether all of a range has come."""
        at = bisect_right(self._spans, (offset, self.size)) - 1
        return length == 0 or (at >= 0 and offset + length <= self._spans[at][1])

    def _fetch(self, offset: int, length: int) -> bytes:
        if not self.holds(offset, length):
            raise short_source(offset, length, self.size)
        return bytes(self._data[offset : offset + length])


@dataclass
class Transfer:
    """The requests that were made to a source.

    Attributes:
        requests, size: how many, and their bytes together.
    """

    requests: int = 0
    size: int = 0


class StreamClient:
    """A file that comes step by step.

    Args:
        source: the file, such as a :class:`scarfmt.container.remote.UrlSource`; its front is read, and what it tells of
            streaming.

    Attributes:
        copy: what has come, to be decoded.
        have: layers that each tile has in it.
        transfer: what that took.
        told: what the file tells clients, or None.

    Raises:
        Malformed, Unsupported, LimitExceeded, Truncated: the front or the STREAMING block is refused.
    """

    def __init__(self, source: ByteSource) -> None:
        self._source = source
        self.transfer, self.copy = Transfer(), PartialCopy(source.size)
        container = Container.open(source).load()
        self._container, self.index = container, SceneIndex.of(container)
        self.have = [0] * container.header.tile_count
        self._models = 0
        self._ask(0, container.header.data_offset)
        block = container.find(BlockKind.STREAMING, 1)
        self.told: Streaming | None = None
        if block is not None:
            self._ask(block.offset, block.end)
            self.told = read_streaming(container)

    def plan(self, camera: Camera | None) -> list[Step]:
        """The missing tile-layers, in the order to fetch them."""
        return plan(self.index, self.told, camera, self.have)

    def fetch(self, steps: Sequence[Step], size: int) -> int:
        """Fetch steps in turn until they have brought `size` bytes or more.

        Args:
            steps: of :meth:`plan`, or the beginning of it.
            size: bytes; 0 for a single step.

        Returns:
            How many steps were fetched.

        Raises:
            Truncated, Malformed: the source is not what it was.
        """
        wanted: list[Entry] = []
        brought = done = 0
        for tile, layer in steps:
            new = [*self._models_of(layer), *self._tile_block(tile, layer)]
            wanted += new
            brought += sum(entry.length for entry in new)
            self.have[tile] = layer
            done += 1
            if brought >= size:
                break
        # A gap that was read over may have brought it.
        for start, past in ranges(entry for entry in wanted if not self.copy.holds(entry.offset, entry.length)):
            self._ask(start, past)
        return done

    def _ask(self, start: int, past: int) -> None:
        self.copy.put(start, self._source.read(start, past - start))
        self.transfer.requests += 1
        self.transfer.size += past - start

    def _models_of(self, layer: int) -> Iterator[Entry]:
        """Blocks that the layers up to this one need besides tiles, and that have not come."""
        for number in range(self._models + 1, layer + 1):
            found = (self._container.find(kind, number) for kind in range(1, BlockKind.TILE))
            yield from (entry for entry in found if entry is not None)
        self._models = max(self._models, layer)

    def _tile_block(self, tile: int, layer: int) -> Iterator[Entry]:
        entry = self._container.find(BlockKind.TILE, layer, tile)
        if entry is not None:
            yield entry


def ranges(entries: Iterable[Entry]) -> list[tuple[int, int]]:
    """The requests for some blocks: first byte of each, and the byte after its last."""
    out: list[tuple[int, int]] = []
    for start, past in sorted((entry.offset, entry.end) for entry in entries):
        near = bool(out) and start - out[-1][1] <= GAP_BYTES and past - out[-1][0] <= REQUEST_BYTES
        if near:
            out[-1] = out[-1][0], past
        else:
            out.append((start, past))
    return out
