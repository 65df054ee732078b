"""STREAMING blocks (SPEC §7.13)."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from conformance.writer.fields import varint
from scarfmt.blocks.streaming import Streaming


def streaming_block(streaming: Streaming) -> bytes:
    """The payload of a block; nothing is checked."""
    view = streaming.view
    out = varint(len(streaming.reach)) + varint(int(view is not None))
    if view is not None:
        out += _floats([*view.position, *view.target, *view.up, view.fov])
    boxes = (streaming.low, streaming.high, streaming.reach)
    return out + b"".join(bytes(part.ravel().tolist()) for part in boxes)


def _floats(numbers: Sequence[float]) -> bytes:
    return struct.pack(f"<{len(numbers)}f", *numbers)
