"""Faults put into blocks of whole files, all checksums right."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

from conformance.decoders.python.front import NO_TILE, Root, read_entries
from conformance.decoders.python.models import parse_tables
from conformance.decoders.python.numbers import Numbers
from conformance.spec.spec_text import size_of
from conformance.surgery.parts import substreams, take_apart, unpack
from conformance.writer.file import Counts, count_rows, write_blocks
from conformance.writer.numbers import Number, numbers_block
from conformance.writer.tables import Record, table_numbers
from scarfmt.blocks.declare import NumberRecord, Scope
from scarfmt.blocks.registry import BLOCKS
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.container.substreams import pack_substreams, unpack_table
from scarfmt.entropy.numbers import NumberReader

NUMBERS = {kind: spec.declaration for kind, spec in BLOCKS.items() if isinstance(spec.declaration, NumberRecord)}
"""By kind, the layout of blocks of adaptive numbers."""


def blocks_of(data: bytes) -> list[Block]:
    """All blocks of a sound file, with the bytes each sub-stream takes."""
    out = []
    for entry in read_entries(data, Root(data)):
        payload = data[entry.offset : entry.offset + entry.length]
        tile = None if entry.tile == NO_TILE else entry.tile
        streams = stream_bytes(payload) if entry.kind == BlockKind.TILE else {}
        out.append(Block(entry.kind, entry.layer, payload, tile, entry.count, streams, entry.flags))
    return out


def block_of(data: bytes, kind: int, layer: int | None = None) -> Block:
    """The first block of a kind, or that of a layer."""
    return next(block for block in blocks_of(data) if block.kind == kind and layer in (None, block.layer))


def copy_block(data: bytes, kind: int, layer: int) -> bytes:
    """The file with its first block of `kind` in `layer`, too."""
    return rebuilt(data, [*blocks_of(data), replace(block_of(data, kind), layer=layer)])


def rebuilt(data: bytes, blocks: Iterable[Block], counts: Counts | None = None) -> bytes:
    """The file with other blocks, and perhaps other counts of its layers; everything about them is recomputed."""
    parts = take_apart(data)
    if counts is not None:
        parts.layers = count_rows(counts)
    return write_blocks(parts, blocks)


def layer_counts_of(data: bytes) -> Counts:
    """Per layer, cumulative anchors and Gaussians."""
    end = unpack("FILE_HEADER", data)["header_length"] - size_of("HEADER_CHECKSUM")
    starts = range(size_of("FILE_HEADER"), end, size_of("LAYER_SUMMARY"))
    layers = [unpack("LAYER_SUMMARY", data, start) for start in starts]
    return [(layer["anchor_count"], layer["gaussian_count"]) for layer in layers]


def change_block(data: bytes, kind: int, layer: int, change: Callable[[bytes], bytes], count: int = 0) -> bytes:
    """The file with the first block of `kind` in `layer` changed, lengths and checksums right.

    `count` is added to the block's count.
    """
    blocks = blocks_of(data)
    row = next(i for i, block in enumerate(blocks) if (block.kind, block.layer) == (kind, layer))
    old = blocks[row]
    payload = change(old.payload)
    streams = stream_bytes(payload) if kind == BlockKind.TILE else {}
    blocks[row] = replace(old, payload=payload, count=old.count + count, stream_bytes=streams)
    return rebuilt(data, blocks)


def change_numbers(data: bytes, kind: int, change: Callable[[list[Number]], list[Number]], count: int = 0) -> bytes:
    """The file with the numbers of its first block of `kind` in layer 1 changed; see :func:`changed`."""
    return change_block(data, kind, 1, lambda payload: numbers_block(change(numbers_of(payload, kind))), count)


class NumberRecorder(NumberReader):
    """A reader of a block that keeps all numbers that it reads in `read`."""

    def __init__(self, payload: bytes) -> None:
        super().__init__(payload, "recorded")
        self.read: list[Number] = []

    def number(self, name: Any) -> int:
        self.read.append((name, super().number(name)))
        return self.read[-1][1]

    def read_all(self, kind: int, context: Mapping[str, Any]) -> None:
        """Read a block of this kind of numbers to its end; what its declaration must know is in `context`."""
        reader: Any = self
        NUMBERS[kind].take(reader, Scope(context))
        self.finish()


def numbers_of(payload: bytes, kind: int) -> list[Number]:
    """The numbers of a sound block, if it is of numbers; a LAYER block is that of layer 1."""
    if kind not in NUMBERS:
        return []
    reader = NumberRecorder(payload)
    reader.read_all(kind, {"layer": 1})
    return reader.read


Records = list[Record]
"""The records of a TABLES block (SPEC §8.3), by ascending key if it is sound."""


def with_tables(data: bytes, layer: int, change: Callable[[Records], Records]) -> bytes:
    """The file with other tables in `layer`, the directory's count right; something must change."""
    payload = block_of(data, BlockKind.TABLES, layer).payload
    before = [Record(key, *table) for key, table in parse_tables(Numbers(payload)).items()]
    after = change(before)
    assert after != before
    made = numbers_block(table_numbers(after))
    return change_block(data, BlockKind.TABLES, layer, lambda _: made, len(after) - len(before))


def change_value(record: Record, old: int, new: int) -> Record:
    """The record with a value of its alphabet changed."""
    assert old in record.values
    return record._replace(values=[new if value == old else value for value in record.values])


def with_substream(data: bytes, layer: int, stream: Stream, change: Callable[[bytes], bytes]) -> bytes:
    """The file with a sub-stream of its first TILE block of `layer` changed; one that is not there has no bytes."""

    def edit(payload: bytes) -> bytes:
        parts = tile_parts(payload)
        return pack_substreams({**parts, stream: change(parts.get(stream, b""))})

    return change_block(data, BlockKind.TILE, layer, edit)


def stream_bytes(payload: bytes) -> dict[int, int]:
    """Bytes per stream kind of a TILE block, as far as its table, which may be damaged, and the block go."""
    out: dict[int, int] = {}
    if payload and len(payload) > size_of("SUBSTREAM_RECORD") * payload[0]:
        rest = len(payload)
        for kind, length in substreams(payload):
            if Stream.MODELS < kind < Stream.FRAMING and length <= rest:
                out[kind] = out.get(kind, 0) + length
                rest -= length
    return out


def without(data: bytes, kind: int, layer: int) -> bytes:
    """The file without its blocks of `kind` in `layer`."""
    return rebuilt(data, [block for block in blocks_of(data) if (block.kind, block.layer) != (kind, layer)])


def tile_parts(payload: bytes) -> dict[Stream, bytes]:
    """The sub-streams of a TILE block."""
    table = unpack_table(payload, len(payload))
    return {kind: payload[part.start : part.start + part.length] for kind, part in table.items()}


def substream_bytes(data: bytes, kind: Stream, layer: int) -> tuple[int, int]:
    """Start and past of a sub-stream of the first TILE block of `layer`, absolute."""
    for entry in read_entries(data, Root(data)):
        if (entry.kind, entry.layer) == (BlockKind.TILE, layer):
            payload = data[entry.offset : entry.offset + entry.length]
            part = unpack_table(payload, entry.length)[kind]
            return entry.offset + part.start, entry.offset + part.start + part.length
    raise LookupError(kind)
