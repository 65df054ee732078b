"""The place of a refused file's fault: the structure of SPEC §5 that an offset of the refusal lies in (R-12.1-2).

``places.json`` names it by vector: ``header`` (its fixed part), ``front`` (all of it, for its CRC), ``summary K`` (of
layer K), ``root``, ``tiles P`` (tile page P), ``rows K P`` (row page P of layer K), ``block E`` (by number in file
order, from 0), ``end`` of a source that is too short, ``after`` for what follows the file. Vectors that are not in it
have a fault in no single structure. The names were drawn up from two decoders that agreed.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

from conformance.decoders.python.container import fields_at
from conformance.decoders.python.front import FILE_HEADER, LAYER_SUMMARY, Root, read_entries, size_of

PLACES = Path(__file__).with_name("places.json")


@cache
def places() -> dict[str, str]:
    """Id of a vector -> name of the structure."""
    found: dict[str, str] = json.loads(PLACES.read_text())
    return found


def interval(data: bytes, place: str) -> list[int]:
    """First and past of a structure, byte offsets in a file that may be broken or cut."""
    name, *numbers = place.split()
    index = int(numbers[0]) if numbers else 0
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
    start = int(header["header_length"])
    if name == "root":
        return [start, start + int(header["root_length"])]
    root = Root(data)
    if name == "tiles":
        return [root.tile_pages[index].start, root.tile_pages[index].past]
    if name == "rows":
        span = root.row_pages[index, int(numbers[1])]
        return [span.start, span.past]
    if name == "block":
        entry = read_entries(data, root)[index]
        return [entry.offset, entry.offset + entry.length]
    raise ValueError(f"no structure is called {place!r}")
