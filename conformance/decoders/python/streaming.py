"""STREAMING (SPEC §7.13)."""

from __future__ import annotations

import math
import struct
import zlib
from typing import Any

from conformance.decoders.python.container import STREAMING_KIND, container_fields
from conformance.decoders.python.fields import Payload, require

MAX_TILES = 1 << 24


def read_streaming(data: bytes) -> Any:
    """The STREAMING block of a file whose header and directory are sound; None if there is none."""
    fields = container_fields(data)
    here = (STREAMING_KIND, "1", str(0xFFFFFFFF))
    found = [entry for entry in fields["entries"] if (entry["kind"], entry["layer"], entry["tile"]) == here]
    if not found:
        return None
    start, length = int(found[0]["offset"]), int(found[0]["length"])
    block = data[start : start + length]
    require(zlib.crc32(block) == int(found[0]["crc32"]), "crc-mismatch")
    streaming = parse_streaming(block)
    require(len(streaming["reach"]) == int(fields["header"]["tile_count"]), "bad-streaming")
    return streaming


def parse_streaming(block: bytes) -> dict[str, Any]:
    """The fields of a block as the protocol has them."""
    reader = Payload(block)
    tiles = reader.count(MAX_TILES)
    view = _floats(reader, 10 * reader.count(1))
    if view:
        require(all(map(math.isfinite, view)) and 0 < view[9] < math.pi, "bad-streaming")
    low, high = list(reader.take(3 * tiles)), list(reader.take(3 * tiles))
    require(all(a <= b for a, b in zip(low, high, strict=True)), "bad-streaming")
    reach = list(reader.take(tiles))
    reader.finish()
    return {
        "view": _bits(view) or None,
        "low": _rows(low, 3),
        "high": _rows(high, 3),
        "reach": reach,
    }


def _floats(reader: Payload, count: int) -> tuple[float, ...]:
    return reader.fields(f"{count}f")


def _bits(numbers: tuple[float, ...]) -> list[str]:
    """The bits of f32 numbers, most significant first."""
    return [struct.pack(">f", number).hex() for number in numbers]


def _rows(items: list[Any], width: int) -> list[list[Any]]:
    """Lists of so many."""
    return [items[first : first + width] for first in range(0, len(items), width)]
