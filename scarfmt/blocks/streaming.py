"""STREAMING block: where the content of tiles is, and a view to begin with (SPEC §7.13). Nothing decodes from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64
from scarfmt.blocks.declare import U8, U32, Check, Record, Rule, Scope, array, build, read
from scarfmt.blocks.spec import BlockSpec
from scarfmt.container.file import Block, Container, Entry
from scarfmt.container.registries import BlockFlag, BlockKind
from scarfmt.errors import Malformed, ScarError

REACH_STEPS = 4
"""Steps of a reach in an octave."""
REACH_OF_SIDE = 128
"""The coded reach of one side of the tile."""
_VIEW = 10

Levels = NDArray[np.uint8]

STREAMING = Record(
    "tile_count" / U32,
    "view_count" / U8 * "1 if there is a view to begin with",
    Rule(
        Check("R-7.13-1", "view_count is 0 or 1", "bad-streaming"),
        lambda at: at["view_count"] <= 1,
        lambda at: _bad(f"{at['view_count']} views to begin with"),
    ),
    "view" / array("f4", f"view_count * {_VIEW}") * "position, target, up, vertical field in radians",
    Rule(
        Check("R-7.13-1", "its numbers are finite, its field is between 0 and π", "bad-streaming"),
        lambda at: _is_view(at["view"]),
        lambda at: _bad("the view is not one"),
    ),
    "low" / array("u1", "tile_count * 3") * "x, y, z of each tile, in 1/256 of its side",
    "high" / array("u1", "tile_count * 3"),
    Rule(
        Check("R-7.13-1", "low is at most high", "bad-streaming"),
        lambda at: bool((at["low"] <= at["high"]).all()),
        lambda at: _bad("a box ends before it begins"),
    ),
    "reach" / array("u1", "tile_count"),
)


def _is_view(view: NDArray[np.float32]) -> bool:
    """Whether it is a view, or none."""
    return len(view) == 0 or bool(np.isfinite(view).all() and 0 < view[-1] < math.pi)


def _bad(message: str) -> Malformed:
    return Malformed("bad-streaming", f"{message} (SPEC §7.13)", field="STREAMING")


@dataclass(frozen=True)
class View:
    """A view to begin with.

    Attributes:
        position, target, up: (3,) float64, world units; `up` of any length.
        fov: vertical field, radians.
    """

    position: F64
    target: F64
    up: F64
    fov: float


@dataclass(frozen=True)
class Streaming:
    """The values of a STREAMING block for T tiles.

    Attributes:
        low, high: (T, 3) uint8 corners of the tight box of the anchors' positions, in 1/256 of the side of a tile;
            `high` belongs to it.
        reach: (T,) uint8, 0 for none, else how far splats stick out of that box: side * 2^((reach - 128) / 4).
        view: to begin with, or None.
    """

    low: Levels
    high: Levels
    reach: Levels
    view: View | None = None

    @property
    def tiles(self) -> int:
        """T."""
        return len(self.reach)


def pack_streaming(streaming: Streaming) -> bytes:
    """The payload of a STREAMING block."""
    view = streaming.view
    numbers = np.zeros(0) if view is None else np.array([*view.position, *view.target, *view.up, view.fov])
    fields = {
        "tile_count": streaming.tiles,
        "view_count": int(view is not None),
        "view": numbers,
        "low": streaming.low.ravel(),
        "high": streaming.high.ravel(),
        "reach": streaming.reach,
    }
    return build(STREAMING, fields)


def streaming_block(streaming: Streaming) -> Block:
    """The STREAMING block with these values."""
    return Block(BlockKind.STREAMING, 1, pack_streaming(streaming), count=streaming.tiles)


def unpack_streaming(payload: bytes) -> Streaming:
    """Parse a STREAMING block.

    Raises:
        Malformed: ``bad-streaming``, ``payload-short``, ``payload-long`` (SPEC §7.13).
    """
    at = read(STREAMING, payload, "STREAMING")
    return Streaming(at["low"].reshape(-1, 3), at["high"].reshape(-1, 3), at["reach"], _view(at))


def _view(at: Scope) -> View | None:
    if not at["view_count"]:
        return None
    numbers = at["view"].astype(np.float64)
    return View(numbers[0:3], numbers[3:6], numbers[6:9], float(numbers[9]))


def read_streaming(container: Container) -> Streaming | None:
    """The values of the STREAMING block of a file; None if there is none, or if a truncated source does not reach it.

    Raises:
        Malformed: ``bad-streaming`` and what :func:`unpack_streaming` raises; ``crc-mismatch``.
    """
    entry = container.find(BlockKind.STREAMING, 1)
    if entry is None or not container.is_available(entry):
        return None
    return check_streaming(container, entry, container.read_block(entry))


def check_streaming(container: Container, entry: Entry, payload: bytes) -> Streaming:
    """The values of the STREAMING block at `entry`, checked by its own rules and by those about the file around it.

    Raises:
        Malformed: as :func:`read_streaming`.
    """
    header = container.header
    try:
        found = unpack_streaming(payload)
        if found.tiles != header.tile_count:
            raise _bad(f"{found.tiles} tiles, the file has {header.tile_count}")
    except ScarError as error:
        raise type(error)(error.refusal, error.message, offset=entry.offset, field="STREAMING") from error
    return found


def check_place(entry: Entry) -> None:
    """Check where a block stands.

    Raises:
        Malformed: ``bad-streaming`` (R-7.13-2).
    """
    if (entry.layer, entry.tile, entry.flags) != (1, None, BlockFlag.SAFE_TO_COPY):
        message = "it stands in layer 1, belongs to no tile, and is safe to copy (SPEC §7.13)"
        raise Malformed("bad-streaming", message, offset=entry.offset, field="STREAMING")


SPEC = BlockSpec(
    kind=BlockKind.STREAMING,
    section="7.13",
    declaration=STREAMING,
    parse=lambda payload, reading: unpack_streaming(payload),
    pack=pack_streaming,
    taken=lambda writing: writing.parts.streaming if writing.layer == 1 else None,
    count=lambda streaming: streaming.tiles,
    elements="tiles",
)
