"""STREAMING blocks that a client refuses (SPEC §7.13), and that a decoder does not look at."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace

from conformance.scenes.cases import Case, refuse, take
from conformance.scenes.container_scenes import plain_file, plain_scene
from conformance.scenes.streaming_scenes import streaming_file, streaming_scene
from conformance.surgery.edit import replace_bytes
from conformance.surgery.files import change_block
from conformance.surgery.parts import block_added, change_rows, entry_with, remake
from conformance.writer.file import write_file
from conformance.writer.options import WriteOptions
from scarfmt.blocks.streaming import pack_streaming
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockKind

_STREAMING, _SAFE = 65, 2
_VIEW = struct.pack("<10f", 1, 2, 3, 0, 0, 0, 0, -1, 0, 1)
_LOW, _HIGH, _REACH = bytes(range(9)), bytes(range(1, 10)), b"\x80\x81\x00"


def _block(
    tiles: int = 3, views: int = 1, view: bytes = _VIEW, low: bytes = _LOW, rest: bytes = _HIGH + _REACH
) -> bytes:
    return struct.pack("<IB", tiles, views) + view + low + rest


def _view(**numbers: float) -> bytes:
    """The view with some of its ten numbers changed."""
    found = list(struct.unpack("<10f", _VIEW))
    for name, number in numbers.items():
        found[int(name.removeprefix("n"))] = number
    return struct.pack("<10f", *found)


_NOT_FINITE = float("inf")
_FAULTS = (
    ("tiles-fewer", "two tiles, the file has three", "R-7.13-1", "bad-streaming",
     _block(tiles=2, low=_LOW[:6], rest=_HIGH[:6] + _REACH[:2])),
    ("tiles-beyond", "2^32 - 1 tiles", "R-5.7-2", "payload-short", _block(tiles=(1 << 32) - 1)),
    ("views-two", "two views", "R-7.13-1", "bad-streaming", _block(views=2, view=2 * _VIEW)),
    ("view-infinite", "a view of an infinite position", "R-7.13-1", "bad-streaming",
     _block(view=_view(n2=_NOT_FINITE))),
    ("view-flat", "a view whose field is 0", "R-7.13-1", "bad-streaming", _block(view=_view(n9=0.0))),
    ("view-half-turn", "a view whose field is the least f32 above pi", "R-7.13-1", "bad-streaming",
     _block(view=_view(n9=3.1415927410125732))),
    ("view-not-a-number", "a view whose field is not a number", "R-7.13-1", "bad-streaming",
     _block(view=_view(n9=float("nan")))),
    ("box-backwards", "the box of the last tile ends before it begins, and the block there", "R-7.13-1",
     "bad-streaming", _block(low=_LOW[:8] + b"\xff", rest=_HIGH)),
    ("short", "the last reach is missing", "R-5.7-2", "payload-short", _block(rest=_HIGH + _REACH[:-1])),
    ("long", "a byte after the last reach", "R-5.7-2", "payload-long", _block(rest=_HIGH + _REACH + b"\0")),
)


def streaming_faults() -> Iterator[Case]:
    """Each is refused by who wants streaming information, and decoded by who does not look at it."""
    for name, purpose, rule, refusal, payload in _FAULTS:
        data = change_block(streaming_file(), _STREAMING, 1, replace_bytes(payload))
        yield refuse(f"streaming-{name}", purpose, rule, refusal, data, "streaming")
    wrong = change_rows(streaming_file(), entry_with(_STREAMING, crc32=0))
    yield refuse("streaming-crc", "STREAMING whose CRC says 0", "R-5.6-1", "crc-mismatch", wrong, "streaming")
    yield from _either()


def _either() -> Iterator[Case]:
    """Faults that only a validator sees: blocks where none belongs, a count, and content that no decoder must read."""
    plain, boxes, scene = plain_file(), streaming_scene().streaming, replace(plain_scene(), streaming=None)
    assert boxes is not None
    payload = pack_streaming(boxes)
    for name, purpose, entry in (
        ("late", "STREAMING in layer 2", {"layer": 2, "flags": _SAFE}),
        ("not-safe", "STREAMING that is not safe to copy", {"flags": 0}),
    ):
        data = remake(plain, block_added(payload, kind=_STREAMING, count=3, **entry))
        yield take(f"streaming-{name}", purpose, data, scene, "R-7.13-2", "bad-streaming")
    counted = change_rows(streaming_file(), entry_with(_STREAMING, count=4))
    yield take("streaming-count", "the directory counts one tile too many", counted, scene, "R-5.4-19", "entry-count")
    text = change_block(streaming_file(), _STREAMING, 1, replace_bytes(b"soon"))
    yield take("streaming-text", "STREAMING that is text, which a decoder does not look at", text, scene, "R-5.7-2",
               "payload-short")
    large = write_file(scene, WriteOptions(blocks=(Block(int(BlockKind.THUMBNAIL), 1, bytes(65_536)),)))
    yield take("thumbnail-large", "a thumbnail of 65,536 bytes", large, scene, "R-7.15-1", "entry-length")
    scene = replace(scene, metadata={"coordinate_reference": {"crs": 25832, "origin": [0, 0, 0]}})
    yield take("metadata-reference", "a coordinate reference system that is a number", write_file(scene), scene,
               "R-7.10-4", "bad-metadata")
