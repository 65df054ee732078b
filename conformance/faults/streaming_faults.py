"""STREAMING blocks that a client refuses (SPEC §7.13), and that a decoder does not look at."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace

from conformance.scenes.cases import Case
from conformance.scenes.container_scenes import plain_file, plain_scene
from conformance.scenes.streaming_scenes import streaming_file, streaming_scene
from conformance.surgery.parts import block_added, block_with, broken, remade
from conformance.writer.fields import varint
from conformance.writer.streaming import streaming_block

_STREAMING, _SAFE = 65, 2
_VIEW = struct.pack("<10f", 1, 2, 3, 0, 0, 0, 0, -1, 0, 1)
_EYES = struct.pack("<6f", 1, 2, 3, 4, 5, 6)
_LOW, _HIGH, _REACH, _GAINS = bytes(range(9)), bytes(range(1, 10)), b"\x80\x81\x00", bytes(range(12))


def _block(
    layers: int = 2, tiles: int = 3, views: int = 1, view: bytes = _VIEW, viewpoints: int = 2, eyes: bytes = _EYES,
    low: bytes = _LOW, rest: bytes = _HIGH + _REACH + _GAINS,
) -> bytes:
    return bytes([layers]) + varint(tiles) + varint(views) + view + varint(viewpoints) + eyes + low + rest


def _view(**numbers: float) -> bytes:
    """The view with some of its ten numbers changed."""
    found = list(struct.unpack("<10f", _VIEW))
    for name, number in numbers.items():
        found[int(name.removeprefix("n"))] = number
    return struct.pack("<10f", *found)


_NOT_FINITE = float("inf")
_FAULTS = (
    ("layers-none", "gains of no layer", "R-7.13-1", "bad-streaming", _block(layers=0)),
    ("layers-17", "gains of 17 layers, and nothing after that", "R-7.13-1", "bad-streaming", bytes([17])),
    ("layers-fewer", "gains of one layer, the file has two", "R-7.13-1", "bad-streaming",
     _block(layers=1, rest=_HIGH + _REACH + _GAINS[:6])),
    ("tiles-fewer", "two tiles, the file has three", "R-7.13-1", "bad-streaming",
     _block(tiles=2, low=_LOW[:6], rest=_HIGH[:6] + _REACH[:2] + _GAINS[:8])),
    ("tiles-beyond", "2^24 + 1 tiles", "R-5.7-3", "count-limit", _block(tiles=(1 << 24) + 1)),
    ("views-two", "two views", "R-5.7-3", "count-limit", _block(views=2, view=2 * _VIEW)),
    ("view-infinite", "a view of an infinite position", "R-7.13-1", "bad-streaming",
     _block(view=_view(n2=_NOT_FINITE))),
    ("view-flat", "a view whose field is 0", "R-7.13-1", "bad-streaming", _block(view=_view(n9=0.0))),
    ("view-half-turn", "a view whose field is the least f32 above pi", "R-7.13-1", "bad-streaming",
     _block(view=_view(n9=3.1415927410125732))),
    ("view-not-a-number", "a view whose field is not a number", "R-7.13-1", "bad-streaming",
     _block(view=_view(n9=float("nan")))),
    ("viewpoints-65", "65 viewpoints", "R-5.7-3", "count-limit", _block(viewpoints=65)),
    ("viewpoint-infinite", "a viewpoint at minus infinity", "R-7.13-1", "bad-streaming",
     _block(eyes=_EYES[:20] + struct.pack("<f", -_NOT_FINITE))),
    ("box-backwards", "the box of the last tile ends before it begins, and the block there", "R-7.13-1",
     "bad-streaming", _block(low=_LOW[:8] + b"\xff", rest=_HIGH)),
    ("short", "the last gain is missing", "R-5.7-2", "payload-short", _block(rest=_HIGH + _REACH + _GAINS[:-1])),
    ("long", "a byte after the last gain", "R-5.7-2", "payload-long", _block(rest=_HIGH + _REACH + _GAINS + b"\0")),
    ("varint", "the count of viewpoints takes a byte too many", "R-5.7-1", "bad-varint",
     bytes([2, 3, 1]) + _VIEW + b"\x82\x00" + _EYES + _LOW + _HIGH + _REACH + _GAINS),
)


def streaming_faults() -> Iterator[Case]:
    """Each is refused by who wants streaming information, and decoded by who does not look at it."""
    for name, purpose, rule, refusal, payload in _FAULTS:
        data = remade(streaming_file(), block_with(_STREAMING, payload))
        yield Case(f"invalid/streaming-{name}", purpose, data, (rule,), refusals=(refusal,), stage="streaming")
    wrong = broken(streaming_file(), lambda p: p.entry(_STREAMING).update(crc32=0))
    yield Case("invalid/streaming-crc", "STREAMING whose CRC says 0", wrong, ("R-5.6-1",), refusals=("crc-mismatch",),
               stage="streaming")


def streaming_either() -> Iterator[Case]:
    """Faults that only a validator sees: blocks where none belongs, a count, and content that no decoder must read."""
    plain, told = plain_file(), streaming_scene().streaming
    assert told is not None
    payload = streaming_block(told)
    for name, purpose, entry in (
        ("late", "STREAMING in layer 2", {"layer": 2, "flags": _SAFE}),
        ("not-safe", "STREAMING that is not safe to copy", {"flags": 0}),
    ):
        data = remade(plain, block_added(payload, kind=_STREAMING, count=2, **entry))
        yield _taken(name, purpose, data, "R-7.13-2", "bad-streaming")
    counted = broken(streaming_file(), lambda p: p.entry(_STREAMING).update(count=3))
    yield _taken("count", "the directory counts one viewpoint too many", counted, "R-5.4-19", "entry-count")
    text = remade(streaming_file(), block_with(_STREAMING, b"soon"))
    yield _taken("text", "STREAMING that is text, which a decoder does not look at", text, "R-7.13-1", "payload-short",
                 "bad-streaming")


def _taken(name: str, purpose: str, data: bytes, rule: str, *refusals: str) -> Case:
    scene = replace(plain_scene(), streaming=None)
    return Case(f"either/streaming-{name}", purpose, data, (rule,), scene=scene, refusals=refusals)
