"""The Zstandard frames of the vectors (RFC 8878) for the second decoder, standard library only.

It reads what :mod:`conformance.writer.frames` writes: raw and RLE blocks, and compressed ones whose literals are not
Huffman-coded and whose sequences have codes in RLE mode. A real decoder has a Zstandard library here (SPEC §5.8).
"""

from __future__ import annotations

from collections.abc import Iterator

_LITERAL_CODES = (
    *((n, 0) for n in range(16)), *((16 + 2 * n, 1) for n in range(4)), (24, 2), (28, 2), (32, 3), (40, 3), (48, 4),
    *((1 << n, n) for n in range(6, 17)),
)
_MATCH_CODES = (
    *((n, 0) for n in range(3, 35)), *((35 + 2 * n, 1) for n in range(4)), (43, 2), (47, 2), (51, 3), (59, 3), (67, 4),
    (83, 4), (99, 5), *((3 + (1 << n), n) for n in range(7, 17)),
)


class BadFrame(Exception):
    """The bytes are not one whole frame that states its content size, without dictionary and checksum."""


class NeedsLibrary(Exception):
    """Huffman or FSE codes."""


def _check(holds: bool) -> None:
    if not holds:
        raise BadFrame


class _Bytes:
    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def take(self, size: int) -> bytes:
        _check(self.at + size <= len(self.data))
        self.at += size
        return self.data[self.at - size : self.at]

    def number(self, size: int) -> int:
        return int.from_bytes(self.take(size), "little")


def frame_content(frame: bytes) -> bytes:
    """The content of exactly one frame.

    Raises:
        BadFrame: for bytes that are not one.
        NeedsLibrary: for a frame that needs more than this module has.
    """
    reader = _Bytes(frame)
    _check(reader.take(4) == bytes.fromhex("28b52ffd"))
    flags = reader.number(1)
    single = flags >> 5 & 1
    reader.take(1 - single)
    _check(not flags & 0b1100 and not any(reader.take((0, 1, 2, 4)[flags & 3])))
    width = (single, 2, 4, 8)[flags >> 6]
    size = reader.number(width) + (256 if width == 2 else 0)
    _check(width > 0)
    content, last = bytearray(), False
    while not last:
        head = reader.number(3)
        last = bool(head & 1)
        _add_block(reader, head >> 1 & 3, head >> 3, content)
    _check(reader.at == len(frame) and len(content) == size)
    return bytes(content)


def _add_block(reader: _Bytes, kind: int, size: int, content: bytearray) -> None:
    _check(kind < 3)
    if kind == 0:
        content += reader.take(size)
    elif kind == 1:
        content += reader.take(1) * size
    else:
        _add_compressed(_Bytes(reader.take(size)), content)


def _add_compressed(block: _Bytes, content: bytearray) -> None:
    literals, done = _literals(block), 0
    for length, match, offset in _sequences(block):
        content += literals[done : done + length]
        done += length
        _check(0 < offset <= len(content))
        for _ in range(match):
            content.append(content[-offset])
    content += literals[done:]


def _literals(block: _Bytes) -> bytes:
    """A literals section: raw, or one byte for all."""
    first = block.number(1)
    if first & 2:
        raise NeedsLibrary("Huffman-coded literals")
    more, bits = ((0, 3), (1, 4), (0, 3), (2, 4))[first >> 2 & 3]
    size = (first | block.number(more) << 8) >> bits
    return block.take(1) * size if first & 1 else block.take(size)


def _sequences(block: _Bytes) -> Iterator[tuple[int, int, int]]:
    """Literal length, match length, offset of each sequence; all have the same three codes."""
    count = block.number(1)
    if count == 0:
        _check(block.at == len(block.data))
        return
    if count > 127 or block.number(1) != 0b01010100:
        raise NeedsLibrary("FSE-coded sequences")
    length_code, offset_code, match_code = block.take(3)
    _check(length_code < len(_LITERAL_CODES) and match_code < len(_MATCH_CODES) and offset_code < 32)
    stream = int.from_bytes(block.take(len(block.data) - block.at), "little")
    left = stream.bit_length() - 1
    for _ in range(count):
        fields = []
        for base, extra in ((1 << offset_code, offset_code), _MATCH_CODES[match_code], _LITERAL_CODES[length_code]):
            left -= extra
            _check(left >= 0)
            fields.append(base + (stream >> left & ((1 << extra) - 1)))
        if fields[0] <= 3:
            raise NeedsLibrary("repeated offsets")
        yield fields[2], fields[1], fields[0] - 3
    _check(left == 0)
