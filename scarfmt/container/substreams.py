"""Framing of a TILE block: a table of sub-streams, then the sub-streams (SPEC §7.1).

The payload is: number of records u8, that many `SUBSTREAM_RECORD`, CRC-32 of all that u32, then the
sub-streams back to back in record order. Every sub-stream has its own CRC, so that a reader that skips
attributes still checks what it uses. A stream kind without a record has no bytes.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from scarfmt.container.schema import SUBSTREAM_RECORD, Stream, numpy_dtype
from scarfmt.errors import Malformed

_RECORD = numpy_dtype(SUBSTREAM_RECORD)
RECORD_SIZE = _RECORD.itemsize
_KINDS = frozenset(kind for kind in Stream if kind not in (Stream.MODELS, Stream.FRAMING))
MAX_TABLE_SIZE = 1 + RECORD_SIZE * len(_KINDS) + 4


@dataclass(frozen=True)
class Substream:
    """The place of a sub-stream in its block, and its checksum."""

    start: int
    length: int
    crc32: int


def pack_substreams(streams: dict[Stream, bytes]) -> bytes:
    """The payload of a TILE block; empty streams get no record."""
    present = {kind: streams[kind] for kind in sorted(streams) if streams[kind]}
    records = [
        SUBSTREAM_RECORD.build({"stream": int(kind), "length": len(data), "crc32": zlib.crc32(data)})
        for kind, data in present.items()
    ]
    table = bytes([len(records)]) + b"".join(records)
    return table + zlib.crc32(table).to_bytes(4, "little") + b"".join(present.values())


def _bad(message: str) -> Malformed:
    return Malformed("bad-substream-table", f"{message} (SPEC §7.1)", field="substreams")


def unpack_table(head: bytes, block_length: int) -> dict[Stream, Substream]:
    """Parse the table of a TILE block.

    Args:
        head: the first min(block_length, `MAX_TABLE_SIZE`) bytes of the block, or more.
        block_length: bytes of the whole block.

    Raises:
        Malformed: ``bad-substream-table``, also when the sub-streams do not fill the block exactly.
    """
    count = head[0] if head else 0
    size = 1 + RECORD_SIZE * count
    if count > len(_KINDS) or len(head) < size + 4:
        raise _bad(f"a table of {count} records does not fit the block")
    if zlib.crc32(head[:size]) != int.from_bytes(head[size : size + 4], "little"):
        raise Malformed("crc-mismatch", "the sub-stream table is damaged (SPEC §7.1)", field="substreams")
    at, previous = size + 4, 0
    table: dict[Stream, Substream] = {}
    # Every block of a file has one: NumPy reads its records ten times faster than construct.
    for index, (stream, length, crc32) in enumerate(np.frombuffer(head, _RECORD, count, 1).tolist()):
        if stream not in _KINDS or stream <= previous or length == 0 or length % 4:
            raise _bad(f"record {index} has a bad stream kind, order or length")
        table[Stream(stream)] = Substream(at, length, crc32)
        at, previous = at + length, stream
    if at != block_length:
        raise _bad(f"sub-streams end at byte {at} of a block of {block_length}")
    return table


def check_substream(kind: Stream, entry: Substream, data: bytes) -> bytes:
    """`data` if it matches its record.

    Raises:
        Malformed: ``crc-mismatch``.
    """
    if zlib.crc32(data) != entry.crc32:
        raise Malformed("crc-mismatch", f"sub-stream {kind.name} is damaged (SPEC §7.1)", field=kind.name)
    return data
