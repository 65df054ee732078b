"""METADATA as a kind of block (SPEC §7.10), apart from its content: `scarfmt inspect` needs no declarations."""

from __future__ import annotations

from construct import this

from scarfmt.blocks.declare import Blob, Record
from scarfmt.blocks.metadata import pack_metadata, parse_metadata
from scarfmt.blocks.spec import BlockSpec
from scarfmt.container.registries import BlockKind

METADATA = Record("text" / Blob(this.length) * "one JSON object, UTF-8")
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
