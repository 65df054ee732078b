"""STREAMING (SPEC §7.13)."""

from __future__ import annotations

import math
import struct
from typing import Any

from conformance.decoders.python.container import STREAMING_KIND, annotation
from conformance.decoders.python.fields import Payload, require
from conformance.decoders.python.front import FILE_HEADER, numbers_at


def read_streaming(data: bytes) -> Any:
    """The STREAMING block of a file whose header and directory are sound; None if there is none."""
    block = annotation(data, STREAMING_KIND)
    if block is None:
        return None
    streaming = parse_streaming(block)
    require(len(streaming["reach"]) == numbers_at(data, 0, FILE_HEADER)["tile_count"], "bad-streaming")
    return streaming


def parse_streaming(block: bytes) -> dict[str, Any]:
    """The fields of a block as the protocol has them."""
    reader = Payload(block)
    tiles, views = reader.fields("IB")
    require(views <= 1, "bad-streaming")
    view: tuple[float, ...] = reader.fields(f"{10 * views}f")
    if view:
        require(all(map(math.isfinite, view)) and 0 < view[9] < math.pi, "bad-streaming")
    low, high = list(reader.take(3 * tiles)), list(reader.take(3 * tiles))
    require(all(a <= b for a, b in zip(low, high, strict=True)), "bad-streaming")
    reach = list(reader.take(tiles))
    reader.finish()
    bits = [struct.pack(">f", number).hex() for number in view]
    corners = {name: [row[a : a + 3] for a in range(0, len(row), 3)] for name, row in (("low", low), ("high", high))}
    return {"view": bits or None, **corners, "reach": reach}
