"""HASH_GRID block: the bits of the hash grid of the entropy model (SPEC §10.6; paper §3.5, §3.8).

All shapes come first, so that they are checked before a bit is decoded; then, a level, the probability of
a one and a rANS stream of the table, entry by entry.
"""

from __future__ import annotations

import numpy as np

from scarfmt.container.bytefields import ByteReader, unsigned_varint
from scarfmt.entropy.rans import FrequencyTable, RansDecoder, RansEncoder
from scarfmt.errors import Malformed
from scarfmt.neural.grid import MAX_LEVELS, U8, GridBox, GridLevel, HashGrid, check_grid

_PROBABILITY_ONE = 256
_LENGTH_BYTES = 4


def pack_grid(grid: HashGrid) -> bytes:
    """The payload of a HASH_GRID block: `grid` must pass its own check."""
    numbers = [*grid.origin, grid.extent_bits, len(grid.levels)]
    for level in grid.levels:
        numbers += [level.plane, level.resolution, level.table_log2, level.features]
    return b"".join([*map(unsigned_varint, numbers), *map(_pack_bits, grid.bits)])


def _pack_bits(bits: U8) -> bytes:
    ones = min(max(round(_PROBABILITY_ONE * float(bits.mean())), 1), _PROBABILITY_ONE - 1)
    encoder = RansEncoder()
    encoder.encode(bits.ravel(), _table(ones))
    stream = encoder.finish()
    return bytes([ones]) + len(stream).to_bytes(_LENGTH_BYTES, "little") + stream


def _table(ones: int) -> FrequencyTable:
    """Frequencies of a bit that is 1 in `ones` of 256 cases."""
    return FrequencyTable.from_weights(np.array([_PROBABILITY_ONE - ones, ones]))


def unpack_grid(payload: bytes) -> HashGrid:
    """The inverse of :func:`pack_grid`.

    Raises:
        Malformed: ``bad-grid`` for a payload that breaks SPEC §10.6, ``bad-varint``, ``payload-short``,
            ``payload-long``, or the refusal of a damaged rANS stream.
        LimitExceeded: ``count-limit`` for more than 16 levels.
    """
    reader = ByteReader(payload, "grid")
    box = GridBox((reader.unsigned(32), reader.unsigned(32), reader.unsigned(32)), reader.unsigned(32))
    levels = tuple(_read_level(reader) for _ in range(reader.count(MAX_LEVELS)))
    check_grid(box, levels)
    bits = tuple(_read_bits(reader, level) for level in levels)
    reader.finish()
    return HashGrid(box.origin, box.extent_bits, levels, bits)


def _read_level(reader: ByteReader) -> GridLevel:
    return GridLevel(reader.unsigned(32), reader.unsigned(32), reader.unsigned(32), reader.unsigned(32))


def _read_bits(reader: ByteReader, level: GridLevel) -> U8:
    ones = reader.take(1)[0]
    if ones == 0:
        raise Malformed("bad-grid", "the probability of a one must not be 0 (SPEC §10.6)", field="grid")
    decoder = RansDecoder(reader.take(int.from_bytes(reader.take(_LENGTH_BYTES), "little")))
    bits = decoder.decode(_table(ones), level.bits)
    decoder.finish()
    return bits.reshape(level.entries, level.features).astype(np.uint8)
