"""Lies in the fixed fields of a file: header, summaries, sub-stream records (SPEC §5.2, §5.3, §7.1).

Values are small, special (powers of two and their neighbours), or near the right one.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

from fuzz.testing.front import Front
from fuzz.testing.parts import RECORD_SIZE
from scarfmt.container.schema import (
    FILE_HEADER,
    FILE_HEADER_SIZE,
    LAYER_SUMMARY,
    LAYER_SUMMARY_SIZE,
    SUBSTREAM_RECORD,
    BlockKind,
    field_table,
)

SPECIAL_NUMBERS = (0, 1, 2, 127, 128, 255, 256, 65535, 65536, 1 << 31, (1 << 32) - 1, 1 << 53, 1 << 63, (1 << 64) - 1)
"""Numbers at which arithmetic goes wrong."""

_NUMBERS = ("nan", "inf", "-inf", "0", "-0.0", "-1", "5e-324", "1e308", "1e-300", "2.0")


class NotHere(Exception):
    """The file has nothing of what an operator works on."""


def special_number(rng: Random, size: int, old: int) -> int:
    """A number of `size` bytes: a special value, near `old`, or random."""
    how = rng.random()
    if how < 0.55:
        value = rng.choice(SPECIAL_NUMBERS)
    elif how < 0.85:
        value = old + rng.choice((-9, -4, -1, 1, 2, 4, 8, 100))
    else:
        value = rng.getrandbits(8 * size)
    return value & ((1 << (8 * size)) - 1)


def _places(structure: Any) -> list[tuple[int, int, bool]]:
    """(offset, size, whether a float) of every scalar of a structure."""
    places = []
    for row in field_table(structure):
        base, _, repeat = row.type.partition("[")
        times = int(repeat.rstrip("]") or 1)
        size = row.size // times
        places += [(row.offset + size * i, size, base == "f64") for i in range(times)]
    return places


_HEADER, _SUMMARY, _RECORD = (_places(structure) for structure in (FILE_HEADER, LAYER_SUMMARY, SUBSTREAM_RECORD))


def _lie(data: bytes, base: int, places: list[tuple[int, int, bool]], rng: Random) -> bytes:
    """Some scalars of the structure at `base` set to other values."""
    out = bytearray(data)
    for offset, size, is_float in rng.sample(places, min(len(places), rng.choice((1, 1, 1, 2, 3)))):
        at = base + offset
        if at + size > len(out):
            raise NotHere
        if is_float:
            out[at : at + 8] = struct.pack("<d", float(rng.choice(_NUMBERS)))
        else:
            old = int.from_bytes(out[at : at + size], "little")
            out[at : at + size] = special_number(rng, size, old).to_bytes(size, "little")
    return bytes(out)


def header_field(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A field of FILE_HEADER after the signature."""
    return _lie(data, 0, _HEADER[9:], rng)


def summary_field(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A field of a LAYER_SUMMARY."""
    layers = max(data[26], 1) if len(data) > 26 else 1
    return _lie(data, FILE_HEADER_SIZE + LAYER_SUMMARY_SIZE * rng.randrange(layers), _SUMMARY, rng)


def _front(data: bytes) -> Front:
    try:
        return Front(data)
    except ValueError as error:  # damaged before, by another operator
        raise NotHere from error


def substream_field(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A field of a SUBSTREAM_RECORD, or the number of records."""
    places = [block.place.start for block in _front(data).blocks if block.kind == BlockKind.TILE]
    blocks = [start for start in places if start < len(data)]
    if not blocks:
        raise NotHere
    start = rng.choice(blocks)
    if rng.random() < 0.2 or not data[start]:
        return data[:start] + bytes([special_number(rng, 1, data[start])]) + data[start + 1 :]
    return _lie(data, start + 1 + RECORD_SIZE * rng.randrange(data[start]), _RECORD, rng)


def corrupt_directory(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """Random bytes somewhere in ROOT or a page."""
    front = _front(data)
    at, past = front.root.start, max(page.past for page in (front.root, *front.tile_pages, *front.row_pages))
    size = min(past, len(data)) - at
    if size <= 0:
        raise NotHere
    start = at + rng.randrange(size)
    length = min(rng.choice((1, 4, 12, 32, size)), at + size - start)
    return data[:start] + rng.randbytes(length) + data[start + length :]


OPERATORS: dict[str, Callable[[bytes, Random, Sequence[bytes]], bytes]] = {
    "header-field": header_field,
    "summary-field": summary_field,
    "substream-field": substream_field,
    "corrupt-directory": corrupt_directory,
}
