"""The layout of ROOT and of pages, for `scarfmt dump` (SPEC §5.4, §5.5).

Readers have loops of their own, :mod:`scarfmt.container.root` and :mod:`scarfmt.container.pages`: a directory may have
a million rows. What is shown was read and checked by them before.
"""

from __future__ import annotations

import numpy as np

from scarfmt.blocks.declare import U8, Derived, Record, Repeat, When, array, scalar, varint, varints
from scarfmt.container.registries import BlockKind


def _kind_text(kind: int) -> str:
    return f"{kind} {BlockKind(kind).name}" if kind in set(BlockKind) else str(kind)


_CRC32 = scalar("u32", "L", lambda value: f"0x{value:08X}")

_ENTRY = Record(
    "kind" / scalar("u8", "B", _kind_text), "flags" / U8, "length" / varint(53), "count" / varint(32), "crc32" / _CRC32
)

_ROWS = Record(
    "row_bytes" / varint(32),
    When("row_bytes > 0", "row_crc32" / _CRC32, "block_bytes" / varint(53), "anchors" / varint(53)),
)

_PAGE = Record(
    "gap" / varint(63), "tile_bytes" / varint(32), "tile_crc32" / _CRC32, "layers" / Repeat("layer_count", _ROWS)
)

ROOT = Record(
    "layers" / Repeat("layer_count", Record("entry_count" / varint(8), "entries" / Repeat("entry_count", _ENTRY))),
    "pages" / Repeat("page_count", _PAGE),
)
"""Parameters: `layer_count` and `page_count`."""

TILE_PAGE = Record("depth" / array("u1", "tiles"), "shift" / array("u1", "tiles"), "gap" / varints(63, "tiles"))
"""Parameter: `tiles` of the page."""

ROW_PAGE = Record(
    "length" / varints(53, "tiles"),
    "present" / Derived(lambda at: int(np.count_nonzero(at["length"]))),
    "count" / varints(32, "present"),
    "crc32" / array("u4", "present"),
)
"""Parameter: `tiles` of the page."""
