"""Huffman-coded literals that are not used up exactly: faulty by RFC 8878, 4.2.2, and yet read by libzstd.

SPEC §5.8 lets a reader take them. The literals are weights of tables that code nothing, and every symbol of the tree is
a legal weight, so that whatever a lax reader makes of the last bits, the scene is the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from conformance.faults.zstd_faults import raw_block, window_of, with_frame, zstd_block, zstd_frame
from conformance.scenes.cases import Case
from conformance.scenes.container_scenes import plain_scene
from conformance.surgery.files import blocks_of, content_of, vector_file
from conformance.writer.options import WriteOptions
from conformance.writer.tables import table_of
from scarfmt.container.schema import BlockKind
from scarfmt.entropy.keys import TableKey

_COMPRESSED = 2
_IDLE = TableKey(12, 0, 0, 0)
"""A key that names nothing, after all others."""
_WEIGHTS = tuple(1 + (i * i // 7) % 2 for i in range(1200))
_LITERALS_COMPRESSED = 2


def huffman_cases() -> Iterator[Case]:
    """A sound frame, and the same with streams a bit longer and a bit shorter than their symbols."""
    scene = plain_scene()
    options = WriteOptions(tables={1: {_IDLE: table_of(tuple(range(len(_WEIGHTS))), _WEIGHTS)}})
    content = _tables_content(vector_file(scene, options=options))
    for id_, purpose, bits in (
        ("edge/huffman-literals", "literals of four Huffman streams, used up exactly", (0, 0, 0, 0)),
        ("either/huffman-bits-left", "a Huffman stream of three bits more than its symbols take", (0, 3, 0, 0)),
        ("either/huffman-bits-short", "a Huffman stream of two bits less than its symbols take", (0, 0, -2, 0)),
        ("either/huffman-bits-last", "the last of four Huffman streams has a bit too many", (0, 0, 0, 1)),
    ):
        data = with_frame(vector_file(scene, options=options), BlockKind.TABLES, _frame(content, bits))
        refusals = () if id_.startswith("edge/") else ("bad-zstd",)
        yield Case(id_, purpose, data, ("R-5.8-4",), scene=scene, refusals=refusals, stage="models")


def _tables_content(data: bytes) -> bytes:
    """The content of the first TABLES block, which ends in the weights of the idle table."""
    content = content_of(next(block for block in blocks_of(data) if block.kind == BlockKind.TABLES))
    assert content.endswith(bytes(_WEIGHTS))
    return content


def _frame(content: bytes, more: Sequence[int]) -> bytes:
    """A raw block of what comes before the weights, and a compressed one of them."""
    head = content[: -len(_WEIGHTS)]
    payload = _literals(_WEIGHTS, more) + b"\0"
    blocks = raw_block(head, last=False) + zstd_block(_COMPRESSED, len(payload), payload)
    return zstd_frame(len(content), blocks, window=window_of(20))


def _literals(symbols: Sequence[int], more: Sequence[int]) -> bytes:
    """A literals section of symbols 1 and 2 with codes of a bit each, in four streams.

    Args:
        symbols: them.
        more: bits that each stream has more than its symbols take; less, where it is below 0.
    """
    # Weights of the symbols 0 and 1, four bits each; that of 2 completes the tree.
    tree = bytes([127 + 2, 0x01])
    each = -(-len(symbols) // 4)
    parts = [symbols[start : start + each] for start in range(0, len(symbols), each)]
    streams = [_stream(part, extra) for part, extra in zip(parts, more, strict=True)]
    jump = b"".join(len(stream).to_bytes(2, "little") for stream in streams[:3])
    body = tree + jump + b"".join(streams)
    form = 2  # both sizes in 14 bits
    head = _LITERALS_COMPRESSED | form << 2 | len(symbols) << 4 | len(body) << 18
    return head.to_bytes(4, "little") + body


def _stream(symbols: Sequence[int], more: int) -> bytes:
    """One stream: read from its end, where a bit 1 stands before the code of the first symbol."""
    codes = [symbol - 1 for symbol in symbols] + [0] * max(more, 0)
    if more < 0:
        codes = codes[:more]
    value = 1
    for bit in codes:
        value = value << 1 | bit
    return value.to_bytes(-(-value.bit_length() // 8), "little")
