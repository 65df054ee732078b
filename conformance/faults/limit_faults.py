"""Files beyond a limit (SPEC §13): of the format, to be refused; of a reader, which it may have raised.

The header or ROOT declares sizes that nothing has been written for: a file is refused before, or its end is zeros.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator

from conformance.scenes.cases import Case, refuse
from conformance.scenes.container_scenes import (
    anchor_file,
    crowd_scene,
    idle_slots_scene,
    plain_file,
    plain_scene,
    root_file,
)
from conformance.surgery.edit import Changes
from conformance.surgery.parts import TILE_KIND, Parts, change_rows, header_with, remake, take_apart
from conformance.writer.file import write_file

_MAX_TILES, _READER_TILES, _READER_ROOT = 1 << 24, 1 << 20, 1 << 24
_MAX_ANCHORS, _READER_GAUSSIANS = 1 << 31, 1 << 36
_MAX_BLOCK, _READER_BLOCK = 1 << 31, 1 << 28
_MAX_TILE_ANCHORS = 1 << 16
_METADATA, _PRIVATE = 64, 200


def limit_faults() -> Iterator[Case]:
    """Beyond limits of the format (``invalid/``) or of a reader (``either/``), and one file that just meets them."""
    yield from _header_limits()
    yield from _expansion_limits()
    yield from _block_limits()


def _either(id_: str, purpose: str, rule: str, data: bytes, *refusals: str) -> Case:
    return Case(f"either/{id_}", purpose, data, (rule, "R-13.2-1"), refusals=refusals, stage="container")


def _header_limits() -> Iterator[Case]:
    base = root_file()
    for name, count in (("limit-tiles", _MAX_TILES + 1), ("limit-tiles-top", (1 << 32) - 1)):
        yield refuse(name, f"tile_count is {count} in a small file", "R-5.2-19 R-13.1-1", "limit-tiles",
                     change_rows(base, header_with(tile_count=count)), "container")
    yield _either("limit-tiles", "tile_count is 2^20 + 1, and ROOT has one page", "R-5.2-19",
                  change_rows(base, header_with(tile_count=_READER_TILES + 1)), "limit-tiles", "payload-short")
    yield _either("limit-root", "root_length is 2^24 + 1, and the blocks begin before that", "R-5.2-19",
                  change_rows(base, header_with(root_length=_READER_ROOT + 1)), "limit-root", "layer-offset")
    for name, count in (("limit-anchors", _MAX_ANCHORS + 1), ("limit-anchors-2-63", 1 << 63)):
        yield refuse(name, f"{count} anchors declared", "R-5.2-19 R-13.1-1", "limit-anchors",
                     change_rows(base, _counts(anchor=count, gaussian=count)), "container")
    yield _either("limit-gaussians", "2^36 + 1 Gaussians declared, more than the anchors can have", "R-5.2-19",
                  change_rows(anchor_file(), _counts(gaussian=_READER_GAUSSIANS + 1)),
                  "limit-gaussians", "layer-counts")


def _counts(**counts: int) -> Changes:
    """Counts of the last layer and of the header."""
    return {f"{row}.{name}_count": count for row in ("layers.-1", "header") for name, count in counts.items()}


def _expansion_limits() -> Iterator[Case]:
    yield _either("limit-expansion", "69536 anchors in 500 bytes; all is well otherwise", "R-5.2-19",
                  write_file(crowd_scene((_MAX_TILE_ANCHORS, 4000))), "limit-expansion")
    yield _either("limit-expansion-slots", "592000 slots, none of them on, in 6 kB; all is well otherwise", "R-5.2-19",
                  write_file(idle_slots_scene(18500)), "limit-expansion")
    yield _expansion_met()


def _expansion_met() -> Case:
    """Exactly as many anchors as any reader must take from a file of that length."""
    size = len(write_file(crowd_scene((_MAX_TILE_ANCHORS, 4000))))
    scene = crowd_scene((_MAX_TILE_ANCHORS, size))
    data = write_file(scene)
    if len(data) != size:
        raise ValueError("the number of anchors changes the length of the file")
    purpose = f"2^16 + {size} anchors in {size} bytes: the most that every reader takes"
    return Case("edge/limit-expansion-met", purpose, data, ("R-5.2-19", "R-13.2-1"), scene=scene)


def _block_limits() -> Iterator[Case]:
    for name, length in (("limit-block-bytes", _MAX_BLOCK + 1), ("limit-block-bytes-4-gib", (1 << 32) + 8)):
        parts = long_last_block(root_file(), length, kind=_PRIVATE)
        yield refuse(name, f"an unknown block of {length} zeros", "R-5.4-9 R-13.1-1", "limit-block-bytes",
                     parts.seal(), "container", parts.header["file_length"])
    parts = long_last_block(plain_file(), _READER_BLOCK + 1, kind=_PRIVATE, layer=2)
    yield Case("either/limit-block-bytes", "an unknown block of 2^28 + 1 zeros, which no decoder needs", parts.seal(),
               ("R-5.4-9", "R-13.2-1", "R-5.6-3"), scene=plain_scene(), refusals=("limit-block-bytes",),
               stage="container", extend_to=parts.header["file_length"])
    yield refuse("limit-tile-anchors", "65537 anchors in one TILE block; all is well otherwise", "R-5.5-9 R-13.1-1",
                 "limit-tile-anchors", _crowd(), "container")


def long_last_block(base: bytes, length: int, kind: int, layer: int = 1, start: bytes = b"") -> Parts:
    """A file whose last block is `start` and zeros up to `length`; of those the file has none."""
    parts = take_apart(base)
    parts.add(start, kind=kind, layer=layer, flags=2 if kind == _METADATA else 0)
    parts.settle()
    more = length - len(start)
    parts.entries[-1].update(length=length, crc32=crc32_with_zeros(start, more))
    summary = parts.layers[layer - 1]
    sizes = summary["stream_bytes"]
    summary.update(byte_count=summary["byte_count"] + more, end_offset=summary["end_offset"] + more,
                   stream_bytes=(sizes[0] + more, *sizes[1:]))
    parts.header["file_length"] += more
    return parts


def _crowd() -> bytes:
    """One anchor more than a TILE block may have. They lie in one cell, so no symbol gives their number."""

    def change(parts: Parts) -> None:
        count = _MAX_TILE_ANCHORS + 1
        parts.entries[parts.row(TILE_KIND)]["count"] = count
        parts.layers[0].update(anchor_count=count, gaussian_count=count)

    return remake(write_file(crowd_scene((_MAX_TILE_ANCHORS,))), change)


def crc32_with_zeros(start: bytes, zeros: int) -> int:
    """CRC-32 of `start` and then so many zeros, in a number of steps that grows with the logarithm of it.

    One zero byte is a linear map of the 32 bits of the register; its powers are found by squaring.
    """
    step = [_zero_byte(1 << bit) for bit in range(32)]
    register = zlib.crc32(start) ^ 0xFFFFFFFF
    while zeros:
        if zeros & 1:
            register = _apply(step, register)
        step = [_apply(step, column) for column in step]
        zeros >>= 1
    return register ^ 0xFFFFFFFF


def _zero_byte(register: int) -> int:
    for _ in range(8):
        register = register >> 1 ^ (0xEDB88320 if register & 1 else 0)
    return register


def _apply(columns: list[int], register: int) -> int:
    out = 0
    for bit, column in enumerate(columns):
        if register >> bit & 1:
            out ^= column
    return out
