"""Invalid vectors of HASH_GRID blocks (SPEC §10.6)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator

from conformance.scenes.cases import Fault
from conformance.surgery.edit import append, cut, splice
from conformance.surgery.files import block_of, change_block
from scarfmt.container.schema import BlockKind

_GRID = BlockKind.HASH_GRID
_BAD = "R-10.6-1", "bad-grid"
_SHORT, _SEAL = ("R-5.7-2", "payload-short"), ("R-8.2-2", "rans-seal")
_BOX, _LEVEL = struct.Struct("<3I2B"), struct.Struct("<BIBB")
Change = Callable[[bytes], bytes]
Head = list[int]


def _parts(payload: bytes) -> tuple[Head, bytes]:
    """Origin, extent, level count; plane, resolution, table_log2, features of each level; and the streams."""
    levels = payload[_BOX.size - 1]
    past = _BOX.size + _LEVEL.size * levels
    rows = [number for row in _LEVEL.iter_unpack(payload[_BOX.size : past]) for number in row]
    return [*_BOX.unpack_from(payload), *rows], payload[past:]


def _head(numbers: Head) -> bytes:
    """The inverse."""
    rows = [_LEVEL.pack(*numbers[at : at + 4]) for at in range(5, len(numbers), 4)]
    return _BOX.pack(*numbers[:5]) + b"".join(rows)


def grid_faults(small: bytes) -> Iterator[Fault]:
    """Faults of a grid of few levels."""
    numbers, streams = _parts(block_of(small, _GRID).payload)
    levels = numbers[4]

    def put(numbers: Head, rest: bytes = streams, growth: int = 0) -> bytes:
        return change_block(small, _GRID, 1, lambda _: _head(numbers) + rest, growth)

    for name, what, place, value in (
        ("plane", "a plane that is not assigned", 5, 7), ("flat-level", "a resolution of 0", 6, 0),
        ("extent", "a box of 2^33 lattice steps", 3, 33), ("resolution", "a resolution of 65536", 6, 65536),
        ("table-0", "a table_log2 of 0", 7, 0), ("table-20", "a table_log2 of 20", 7, 20),
        ("no-feature", "a level without features", 8, 0), ("features-9", "a level of nine features", 8, 9),
    ):
        yield f"grid-{name}", what, *_BAD, put([*numbers[:place], value, *numbers[place + 1 :]])
    yield "grid-no-level", "a grid of no levels", *_BAD, put([*numbers[:4], 0], b"", -levels)
    # Hashed tables of 2^19 entries of 8 bits: four of them have 2^24 bits, and there is one more level.
    yield ("grid-bits", "tables of more than 2^24 bits together", *_BAD,
           put([*numbers[:4], 5, *[0, 65535, 19, 8] * 5], growth=5 - levels))
    yield ("grid-levels-17", "17 levels", *_BAD,
           put([*numbers[:4], 17, *numbers[5:9] * 17], streams * 17, growth=17 - levels))
    yield ("grid-levels-17-short", "17 levels, of which the last ends early", *_SHORT,
           change_block(small, _GRID, 1, lambda _: _head([*numbers[:4], 17, *numbers[5:9] * 17])[:-1], 17 - levels))
    length = int.from_bytes(streams[1:5], "little")
    for name, what, rule, change in (
        ("short", "a grid that ends in its last stream", _SHORT, cut),
        ("long", "a byte after the last stream", ("R-5.7-2", "payload-long"), append()),
        ("stream-long", "a stream of 2^32 - 1 bytes", _SHORT, splice(1, b"\xff\xff\xff\xff", 4)),
        ("last-word", "a stream of the grid whose last word is 0", ("R-8.2-1", "rans-last-word"),
         splice(1, bytes([4, 0, 0, 0]) + bytes(4), 4 + length)),
        ("word-more", "a word more than the bits of a level take", _SEAL,
         splice(1, (length + 4).to_bytes(4, "little") + bytes([1, 0, 0, 0]), 4)),
        ("certain", "bits that are never 1", ("R-10.6-2", "bad-grid"), splice(0, b"\0")),
        ("stream-odd", "a stream of the grid that is not whole words", ("R-8.2-1", "rans-length"),
         splice(1, (1).to_bytes(4, "little"), 4)),
        ("seal", "a stream of the grid that does not end in the empty state", _SEAL,
         splice(0, bytes([streams[0] ^ 1]))),
    ):
        yield f"grid-{name}", what, *rule, put(numbers, change(streams))
