"""METADATA and THUMBNAIL as kinds of block (SPEC §7.10, §7.15): `scarfmt inspect` needs no declarations."""

from __future__ import annotations

from scarfmt.blocks.declare import Record, blob
from scarfmt.blocks.metadata import pack_metadata, parse_metadata
from scarfmt.blocks.spec import BlockSpec
from scarfmt.container.registries import BlockKind
from scarfmt.errors import Malformed
from scarfmt.limits import MAX_THUMBNAIL

METADATA = Record("text" / blob("length") * "one JSON object, UTF-8")
"""Parameter: `length` of the block."""

SPEC = BlockSpec(
    kind=BlockKind.METADATA,
    section="7.10",
    declaration=METADATA,
    parse=lambda payload, reading: parse_metadata(payload),
    pack=pack_metadata,
    taken=lambda writing: (writing.parts.metadata or None) if writing.layer == 1 else None,
    count=lambda value: 0,
    elements="0",
    parameters=lambda payload, reading: {"length": len(payload)},
)

THUMBNAIL = Record("picture" / blob("length") * "one WebP, PNG or JPEG file")
"""Parameter: `length` of the block."""


def _thumbnail(payload: bytes) -> bytes:
    """The picture (R-7.15-1)."""
    if len(payload) > MAX_THUMBNAIL:
        message = f"a thumbnail has at most {MAX_THUMBNAIL} bytes (SPEC §7.15)"
        raise Malformed("entry-length", message, field="THUMBNAIL")
    return payload


THUMBNAIL_SPEC = BlockSpec(
    kind=BlockKind.THUMBNAIL,
    section="7.15",
    declaration=THUMBNAIL,
    parse=lambda payload, reading: _thumbnail(payload),
    pack=_thumbnail,
    taken=lambda writing: None,
    count=lambda value: 0,
    elements="0",
    parameters=lambda payload, reading: {"length": len(payload)},
)
