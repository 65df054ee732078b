"""Spark's `.rad`, written by hand from its layout."""

from __future__ import annotations

import json
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

Property = dict[str, Any]
"""`property`, `encoding` and, where it has them, `min` and `max`, as in a file; `stored` are its bytes."""


def planes(values: Any, kind: str) -> bytes:
    """(N, width) numbers: the first of every Gaussian, then the second, and so on."""
    return np.asarray(values).T.astype(kind).tobytes()


def lebytes(values: Any, kind: str) -> bytes:
    """The same, with the lowest byte of all numbers first."""
    return np.frombuffer(planes(values, kind), np.uint8).reshape(-1, np.dtype(kind).itemsize).T.tobytes()


def delta(values: Any) -> bytes:
    """(N, width) whole numbers as differences to the Gaussian before, modulo 256."""
    return planes(np.diff(np.asarray(values, np.int64), axis=0, prepend=0), "u1")


def entry(name: str, encoding: str, stored: bytes, *bounds: float) -> Property:
    """A property."""
    found: Property = {"property": name, "encoding": encoding, "stored": stored}
    return found | dict(zip(("min", "max"), bounds, strict=False))


def deflate(data: bytes) -> bytes:
    """Spark's `gz`: deflate without a header."""
    packer = zlib.compressobj(6, zlib.DEFLATED, -15)
    return packer.compress(data) + packer.flush()


def chunk(base: int, count: int, properties: list[Property], **changes: Any) -> bytes:
    """A chunk of `count` Gaussians; every second stream is compressed."""
    entries, streams = [], b""
    for number, known in enumerate(properties):
        packed = deflate(known["stored"]) if number % 2 else known["stored"]
        said = {key: value for key, value in known.items() if key != "stored"}
        place = {"offset": len(streams), "bytes": len(packed), "compression": "gz" if number % 2 else None}
        entries.append(place | said)
        streams += packed + bytes(-len(packed) % 8)
    head = {"version": 1, "base": base, "count": count, "payloadBytes": len(streams), "properties": entries}
    return _head(b"RADC", head | changes) + struct.pack("<Q", len(streams)) + streams


def file(parts: list[bytes], *, names: list[str] | None = None, **fields: Any) -> bytes:
    """A file of chunks; with `names`, they lie in files of these names beside it."""
    places: list[dict[str, Any]] = []
    for number, data in enumerate(parts):
        start = 0 if names else sum(map(len, parts[:number]))
        places.append({"offset": start, "bytes": len(data)} | ({"filename": names[number]} if names else {}))
    head = {"version": 1, "type": "gsplat", "chunks": places, "allChunkBytes": sum(map(len, parts))}
    return _head(b"RAD0", head | fields) + (b"" if names else b"".join(parts))


def _head(magic: bytes, fields: dict[str, Any]) -> bytes:
    text = json.dumps(fields).encode()
    return magic + struct.pack("<I", len(text)) + text + bytes(-len(text) % 8)


def centres(count: int) -> NDArray[np.float64]:
    """(count, 3), exact in float16."""
    return np.arange(count)[:, None] + [0.0, 0.25, -0.5]


def plain(count: int, **others: Property) -> list[Property]:
    """The properties that every chunk has, and others; see the test that reads them."""
    row = np.arange(count)
    found = {
        "center": entry("center", "f32", planes(centres(count), "<f4")),
        "alpha": entry("alpha", "r8", planes(row[:, None] * 51 % 256, "u1"), 0, 1),
        "rgb": entry("rgb", "r8", planes(np.tile([0, 51, 255], (count, 1)), "u1"), -0.5, 1.5),
        "scales": entry("scales", "ln_0r8", planes(np.tile([0, 1, 255], (count, 1)), "u1"), -12, 9),
        "orientation": entry("orientation", "oct88r8", np.tile(np.array([255, 128, 85], "u1"), (count, 1)).tobytes()),
    }
    return list((found | others).values())


def small() -> bytes:
    """Five Gaussians of degree 1 in two chunks."""
    sh = [entry("sh1", "s8", planes(np.arange(9 * n).reshape(n, 9), "i1"), -2, 2) for n in (3, 2)]
    return file([chunk(0, 3, plain(3, sh1=sh[0])), chunk(3, 2, plain(2, sh1=sh[1]))], count=5, maxSh=1, chunkSize=3)
