"""Other metadata for a file, without coding it again (SPEC §7.10).

The result is byte for byte what the writer makes of the same scene with this metadata: ROOT, summaries and
checksums are recomputed, the bytes of all other blocks copied.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from scarfmt.blocks.metadata import pack_metadata
from scarfmt.container.directory import sort_keys
from scarfmt.container.file import Block, Container, directory_row, encode_front
from scarfmt.container.schema import ENTRY_DTYPE, NO_TILE, BlockKind, Stream
from scarfmt.container.source import BytesSource
from scarfmt.limits import FORMAT_LIMITS


def annotated(data: bytes, metadata: Mapping[str, Any]) -> bytes:
    """The file `data` with `metadata` in place of the annotations it has, if any.

    Args:
        data: a whole file.
        metadata: JSON-able annotations, one at least.

    Raises:
        InvalidInput: ``input-options`` when JSON cannot hold them or a reader would refuse them.
        Malformed, Truncated, Unsupported, LimitExceeded: the file is refused (SPEC §12).
    """
    made = Block(BlockKind.METADATA, 1, pack_metadata(metadata))
    container = Container.open(BytesSource(data), limits=FORMAT_LIMITS)
    block, header, rows = made.payload, container.header, container.directory
    key = np.uint64(1 << 40 | made.kind << 32 | NO_TILE)
    at = int(np.searchsorted(sort_keys(rows), key))
    old = container.find(made.kind, 1)
    new = np.array([directory_row(made)], dtype=ENTRY_DTYPE)
    rows = np.concatenate([rows[:at], new, rows[at + (old is not None) :]])
    end = header.data_offset + int(container.directory["length"][:at].sum(dtype=np.uint64))
    streams = [list(layer.stream_bytes) for layer in header.layers]
    streams[0][Stream.MODELS] += len(block) - (old.length if old else 0)
    counts = [(layer.anchor_count, layer.gaussian_count) for layer in header.layers]
    front = encode_front(header.fields, container.tile_table, rows, counts, streams, header.page_bits)
    return b"".join([front, data[header.data_offset : end], block, data[end + (old.length if old else 0) :]])
