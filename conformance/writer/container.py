"""Header, ROOT, pages and blocks (SPEC §5)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from conformance.decoders.python.front import NO_TILE, SIGNATURE
from conformance.surgery.parts import Parts
from conformance.writer.pages import PAGE_BITS, TILE
from scarfmt.container.file import Block, HeaderFields, Tile

VERSION = {"major": 0, "minor": 3}
THUMBNAIL, METADATA = 15, 64
CRITICAL, SAFE_TO_COPY = 1, 2

Counts = Sequence[tuple[int, int]]
"""Per layer, cumulative anchors and Gaussians."""


def write_container(
    fields: HeaderFields,
    tiles: Sequence[Tile],
    blocks: Iterable[Block],
    counts: Counts,
    *,
    page_bits: int = PAGE_BITS,
) -> bytes:
    """A file of these blocks: offsets, lengths, sums, summaries and checksums follow from them; no rule is checked.

    Args:
        fields: header fields.
        tiles: ascending and disjoint, as nothing else can be said.
        blocks: of layers that there are; at most one TILE block a layer and tile. `stream_bytes` of one are its
            sub-streams' lengths; `flags` None are those of R-5.4-5.
        counts: the number of layers follows from it.
        page_bits: a page has 2^page_bits tiles.
    """
    chosen = sorted(blocks, key=lambda block: (block.layer, block.kind, block.tile or 0))
    parts = Parts(
        {**vars(fields), "signature": SIGNATURE, **VERSION},
        [{"anchor_count": anchors, "gaussian_count": gaussians} for anchors, gaussians in counts],
        [vars(tile) for tile in tiles],
        [_entry(block) for block in chosen],
        [block.payload for block in chosen],
        page_bits,
    )
    parts.settle()
    return parts.sealed()


def _entry(block: Block) -> dict[str, Any]:
    """What the directory says of a block, but for its place, and how its bytes are counted."""
    return {
        "kind": block.kind,
        "flags": _flags(block),
        "layer": block.layer,
        "tile": NO_TILE if block.tile is None else block.tile,
        "count": block.count,
        "streams": block.stream_bytes.items(),
    }


def _flags(block: Block) -> int:
    if block.flags is not None:
        return block.flags
    if block.kind in (THUMBNAIL, METADATA):
        return SAFE_TO_COPY
    return CRITICAL if 1 <= block.kind <= TILE else 0
