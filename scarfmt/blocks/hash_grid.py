"""HASH_GRID block: the bits of the hash grid of the entropy model (SPEC §10.6; paper §3.4, §3.7).

All shapes come first, so that they are checked before a bit is decoded; then, a level, the probability of
a one and a rANS stream of the table, entry by entry.
"""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import U8 as Bits
from scarfmt.blocks.declare import U8, U32, Check, Derived, Record, Repeat, Rule, Scope, blob, build, read
from scarfmt.blocks.spec import BlockSpec
from scarfmt.container.registries import BlockKind
from scarfmt.entropy.rans import FrequencyTable, RansDecoder, RansEncoder
from scarfmt.errors import Malformed
from scarfmt.neural.grid import GridBox, GridLevel, HashGrid, check_grid
from scarfmt.scene.model import first_neural_layer

_PROBABILITY_ONE = 256

_LEVEL = Record(
    "plane" / U8 * "axes: 0 xyz, 1 xy, 2 xz, 3 yz, 4 x, 5 y, 6 z",
    "resolution" / U32 * "cells along each axis",
    "table_log2" / U8 * "logarithm of the entries of a table that is not dense",
    "features" / U8 * "bits of an entry",
)

_SOUND_STREAM = (
    Check("R-8.2-1", "whole words, the last not 0", "rans-length, rans-last-word"),
    Check("R-8.2-2", "sealed after its last bit", "rans-seal"),
)

_TABLE = Record(
    "ones" / U8 * "a bit is 1 in `ones` of 256 cases",
    Rule(
        Check("R-10.6-2", "ones is not 0", "bad-grid"),
        lambda at: at["ones"] > 0,
        lambda at: Malformed("bad-grid", "the probability of a one must not be 0 (SPEC §10.6)", field="grid"),
    ),
    "length" / U32,
    "stream" / blob("length") * "one rANS stream (8.2)",
    # Here, as a damaged stream is refused before the next level is read.
    "bits" / Derived(lambda at: _decode_level(at), checks=_SOUND_STREAM),
)

HASH_GRID = Record(
    "origin" / Repeat(3, U32) * "lattice coordinates x, y, z",
    "extent_bits" / U8 * "the box has sides of 2^extent_bits lattice steps",
    "level_count" / U8,
    "levels" / Repeat("level_count", _LEVEL),
    "shapes" / Derived(lambda at: _check_shapes(at), checks=(Check("R-10.6-1", "all of it", "bad-grid"),)),
    "tables" / Repeat("level_count", _TABLE),
)


def _check_shapes(at: Scope) -> tuple[GridLevel, ...]:
    levels = tuple(GridLevel(*level.values()) for level in at["levels"])
    check_grid(GridBox(tuple(at["origin"]), at["extent_bits"]), levels)
    return levels


def _decode_level(at: Scope) -> Bits:
    """(entries, features) uint8 of the level whose stream has just been read."""
    level: GridLevel = at["shapes"][at["index"]]
    decoder = RansDecoder(at["stream"])
    bits = decoder.decode(_frequencies(at["ones"]), level.bits)
    decoder.finish()
    return bits.reshape(level.entries, level.features).astype(np.uint8)


def _encode_level(bits: Bits) -> dict[str, object]:
    ones = min(max(round(_PROBABILITY_ONE * float(bits.mean())), 1), _PROBABILITY_ONE - 1)
    encoder = RansEncoder()
    encoder.encode(bits.ravel(), _frequencies(ones))
    stream = encoder.finish()
    return {"ones": ones, "length": len(stream), "stream": stream}


def _frequencies(ones: int) -> FrequencyTable:
    """Frequencies of a bit that is 1 in `ones` of 256 cases."""
    return FrequencyTable.from_weights(np.array([_PROBABILITY_ONE - ones, ones]))


def pack_grid(grid: HashGrid) -> bytes:
    """The payload of a HASH_GRID block: `grid` keeps SPEC §10.6."""
    fields = {
        "origin": grid.origin,
        "extent_bits": grid.extent_bits,
        "level_count": len(grid.levels),
        "levels": [
            {"plane": at.plane, "resolution": at.resolution, "table_log2": at.table_log2, "features": at.features}
            for at in grid.levels
        ],
        "tables": [_encode_level(bits) for bits in grid.bits],
    }
    return build(HASH_GRID, fields)


def unpack_grid(payload: bytes) -> HashGrid:
    """The grid of a HASH_GRID block.

    Raises:
        Malformed: ``bad-grid`` for a payload that breaks SPEC §10.6, ``payload-short``, ``payload-long``, or the
            refusal of a damaged rANS stream.
    """
    fields = read(HASH_GRID, payload, "grid")
    bits = tuple(table["bits"] for table in fields["tables"])
    return HashGrid(tuple(fields["origin"]), fields["extent_bits"], fields["shapes"], bits)


SPEC = BlockSpec(
    kind=BlockKind.HASH_GRID,
    section="10.6",
    declaration=HASH_GRID,
    parse=lambda payload, reading: unpack_grid(payload),
    pack=pack_grid,
    taken=lambda writing: writing.parts.grid,
    count=lambda grid: len(grid.levels),
    elements="levels",
    layers=lambda model: {first_neural_layer(model)},
)
