"""Where a refused file breaks its rule: the structure of SPEC §5 that an offset of the refusal lies in (R-12.1-2).

``places.json`` names it by vector: ``header`` (its fixed part), ``front`` (all of it, for its CRC), ``summary K`` (of
layer K), ``tables`` (tile table and directory), ``record T`` (tile T), ``entry E`` and ``block E`` (by number of the
directory entry, from 0), ``end`` of a source that is too short, ``after`` for what follows the file. Vectors that are
not in it have a fault in no single structure. The names were drawn up from two decoders that agreed.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

from conformance.decoders.python.container import (
    DIRECTORY_ENTRY,
    FILE_HEADER,
    LAYER_SUMMARY,
    TILE_RECORD,
    fields_at,
    size_of,
)

PLACES = Path(__file__).with_name("places.json")


@cache
def places() -> dict[str, str]:
    """Id of a vector -> name of the structure."""
    found: dict[str, str] = json.loads(PLACES.read_text())
    return found


def interval(data: bytes, place: str) -> list[int]:
    """First and past of a structure, byte offsets in a file that may be broken or cut."""
    name, _, number = place.partition(" ")
    index = int(number or 0)
    if name == "end":
        return [len(data), len(data)]
    header_size, summary = size_of(FILE_HEADER), size_of(LAYER_SUMMARY)
    if name == "header":
        return [0, header_size]
    if name == "summary":
        return [header_size + summary * (index - 1), header_size + summary * index]
    header = fields_at(data, 0, FILE_HEADER)
    if name == "front":
        return [0, int(header["header_length"])]
    if name == "after":
        return [int(header["file_length"]), len(data)]
    tiles = int(header["header_length"])
    entries = tiles + size_of(TILE_RECORD) * int(header["tile_count"])
    if name == "tables":
        return [tiles, entries + size_of(DIRECTORY_ENTRY) * int(header["entry_count"])]
    if name == "record":
        return [tiles + size_of(TILE_RECORD) * index, tiles + size_of(TILE_RECORD) * (index + 1)]
    start = entries + size_of(DIRECTORY_ENTRY) * index
    if name == "entry":
        return [start, start + size_of(DIRECTORY_ENTRY)]
    if name == "block":
        entry = fields_at(data, start, DIRECTORY_ENTRY)
        return [int(entry["offset"]), int(entry["offset"]) + int(entry["length"])]
    raise ValueError(f"no structure is called {place!r}")
