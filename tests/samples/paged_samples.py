"""Files whose directory has other pages, and a source that notes what is read of it."""

from __future__ import annotations

from scarfmt.container.file import Container, encode_front
from scarfmt.container.source import BytesSource


class Recorded(BytesSource):
    """A source that notes what is read of it."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self.ranges: list[tuple[int, int]] = []

    def _fetch(self, offset: int, length: int) -> bytes:
        self.ranges.append((offset, length))
        return super()._fetch(offset, length)


def in_pages(data: bytes, page_bits: int) -> bytes:
    """The same file with other pages."""
    container = Container(BytesSource(data))
    header = container.header
    counts = [(layer.anchor_count, layer.gaussian_count) for layer in header.layers]
    streams = [layer.stream_bytes for layer in header.layers]
    front = encode_front(header.fields, container.tile_table, container.directory, counts, streams, page_bits)
    return front + data[header.data_offset :]
