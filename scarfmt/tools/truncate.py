"""Dropping the last layers of a file without decoding it (SPEC §14).

The result is byte for byte what the writer makes of the remaining layers alone: same header fields, tile pages and row
pages; ROOT, counts, summaries and checksums recomputed; block bytes copied.
"""

from __future__ import annotations

import io
from typing import BinaryIO

import numpy as np

from scarfmt.arrays import Bools
from scarfmt.container.directory import Table, entry_from_row
from scarfmt.container.file import Container, encode_front
from scarfmt.container.schema import READABLE_KINDS, BlockFlag, Stream
from scarfmt.container.source import ByteSource
from scarfmt.errors import InvalidInput, Truncated, plural
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.tools.assemble import copy_block


def truncate(source: ByteSource, layers: int, *, limits: Limits = DEFAULT_LIMITS) -> bytes:
    """The file holding only the first `layers` layers. Arguments and errors as :func:`truncate_to`."""
    buffer = io.BytesIO()
    truncate_to(source, layers, buffer, limits=limits)
    return buffer.getvalue()


def truncate_to(source: ByteSource, layers: int, target: BinaryIO, *, limits: Limits = DEFAULT_LIMITS) -> int:
    """Write the file holding only the first `layers` layers, in pieces of at most 1 MiB.

    Blocks are verified while they are copied, so `target` holds an unfinished file when an error is raised. A
    source cut short is accepted when it holds the layers asked for: the result is then a whole file. Ancillary
    blocks of unknown kind that are not safe-to-copy are dropped, unless all layers are kept.

    Args:
        layers: layers to keep, 1..layer_count.
        target: opened for writing in binary mode.

    Returns:
        Bytes written.

    Raises:
        InvalidInput: ``input-layers`` when the file does not have so many layers.
        Truncated: ``truncated-block`` when the source ends before those layers do.
        Malformed, Unsupported, LimitExceeded: what :class:`~scarfmt.container.file.Container` refuses.
    """
    container = Container(source, limits=limits, allow_truncated=True)
    header = container.header
    if not 1 <= layers <= header.layer_count:
        message = f"the file has {plural(header.layer_count, 'layer')}, not {layers}"
        raise InvalidInput("input-layers", message, field="layers")
    if layers > container.available_layers:
        message = f"{layers} layers were asked for, but only {container.available_layers} arrived whole"
        raise Truncated("truncated-block", message, offset=source.size)
    container.load(layers)
    rows = np.concatenate([container.rows(layer) for layer in range(1, layers + 1)])
    keep = _choose_kept(rows, layers == header.layer_count)
    front = _front(container, layers, rows, keep)
    target.write(front)
    for row in rows[keep].tolist():
        copy_block(container, entry_from_row(row), target)
    return len(front) + int(rows["length"][keep].sum(dtype=np.uint64))


def _choose_kept(rows: Table, whole: bool) -> Bools:
    """(E,) bool: entries that stay. Unknown critical kinds were refused before."""
    copyable = np.isin(rows["kind"], sorted(READABLE_KINDS)) | (rows["flags"] & BlockFlag.SAFE_TO_COPY != 0)
    return np.asarray(copyable | whole)


def _front(container: Container, layers: int, rows: Table, keep: Bools) -> bytes:
    header = container.header
    counts, streams = [], []
    for index, layer in enumerate(header.layers[:layers]):
        dropped = rows["length"][(rows["layer"] == index + 1) & ~keep].sum(dtype=np.uint64)
        sizes = list(layer.stream_bytes)
        # Only blocks outside tiles can be dropped, and those count as MODELS.
        sizes[Stream.MODELS] -= int(dropped)
        counts.append((layer.anchor_count, layer.gaussian_count))
        streams.append(sizes)
    return encode_front(header.fields, container.tile_table, rows[keep], counts, streams, header.page_bits)
