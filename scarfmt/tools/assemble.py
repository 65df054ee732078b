"""A file put together from blocks that exist: rows of its directory, and where the bytes of each come from (SPEC §5).

Blocks carry neither offsets nor numbers of tiles, so that files are cut and joined by copying them.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from scarfmt.arrays import I64
from scarfmt.container.directory import Table, sort_keys
from scarfmt.container.file import Container, Entry, HeaderFields, check_crc, encode_front
from scarfmt.container.schema import BlockKind

COPY_BYTES = 1 << 20
"""Maximum bytes in memory of a block that is copied."""


@dataclass(frozen=True)
class Plan:
    """A file before it is written.

    Attributes:
        fields: of its header.
        tiles: (T,) TILE_DTYPE.
        rows: (E,) ENTRY_DTYPE, ascending by layer, kind and tile; `offset` is that in the file which the block is from.
        origin: (E,) int64 which file each is from; -1 - i for block i of `made`.
        made: payloads that are in no file yet.
        counts: per layer, cumulative (anchors, Gaussians).
        streams: per layer, bytes of each kind of stream.
    """

    fields: HeaderFields
    tiles: Table
    rows: Table
    origin: I64
    made: Sequence[bytes]
    counts: Sequence[tuple[int, int]]
    streams: Sequence[Sequence[int]]

    def write(self, files: Sequence[Container], target: BinaryIO) -> int:
        """Write the file in pieces of at most `COPY_BYTES`; blocks are verified while they are copied.

        Args:
            files: those that blocks are from.
            target: opened for writing in binary mode.

        Returns:
            Bytes written.

        Raises:
            Malformed: ``crc-mismatch``; Truncated: ``truncated-block``.
        """
        front = encode_front(self.fields, self.tiles, self.rows, self.counts, self.streams)
        target.write(front)
        for row, origin in zip(self.rows, self.origin.tolist(), strict=True):
            if origin < 0:
                target.write(self.made[-1 - origin])
            else:
                copy_block(files[origin], entry_of(row), target)
        return len(front) + int(self.rows["length"].sum(dtype=np.uint64))


def order_rows(rows: Table, origin: I64) -> tuple[Table, I64]:
    """Rows and their origins in the order of a file."""
    order = np.argsort(sort_keys(rows), kind="stable")
    return rows[order], origin[order]


def entry_of(row: Table) -> Entry:
    """The entry of a row whose block belongs wherever the row is from."""
    values = {str(name): int(row[name]) for name in ("kind", "flags", "layer", "offset", "length", "count", "crc32")}
    return Entry(tile=int(row["tile"]) if values["kind"] == BlockKind.TILE else None, **values)


def pieces(container: Container, entry: Entry) -> Iterator[bytes]:
    """The bytes of a block in pieces of at most `COPY_BYTES`, the last of them once all are known to be sound.

    Raises:
        Malformed: ``crc-mismatch``; Truncated: ``truncated-block``.
    """
    crc = 0
    for start in range(0, entry.length, COPY_BYTES):
        piece = container.read_range(entry, start, min(COPY_BYTES, entry.length - start))
        crc = zlib.crc32(piece, crc)
        if start + len(piece) == entry.length:
            check_crc(entry, crc)
        yield piece


def copy_block(container: Container, entry: Entry, target: BinaryIO) -> None:
    """Copy a block that is verified while it is copied.

    Raises:
        Malformed: ``crc-mismatch``; Truncated: ``truncated-block``.
    """
    for piece in pieces(container, entry):
        target.write(piece)
