"""Zstandard frames (RFC 8878) without a Zstandard library: no library version shows in a vector's bytes.

Blocks are raw, runs of one byte, or compressed ones of a simple make: literals as they are, and at most one match whose
three codes stand in the block themselves (RLE mode), so that no Huffman or FSE table is needed. Every decoder must read
them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

MAGIC = bytes.fromhex("28b52ffd")
MOST_BLOCK_BYTES = 1 << 17
_RAW, _RLE, _COMPRESSED = 0, 1, 2
_LEAST_RUN, _LEAST_MATCH, _MOST_LENGTH = 4, 4, 256
_OVERHEAD = 16
_RUN = re.compile(rb"(.)\1{%d,}" % (_LEAST_RUN - 1), re.DOTALL)

# Contents that a content size field of so many bytes can state (RFC 8878, 3.1.1.1.4), and sizes of a dictionary id.
_SIZES = {1: range(256), 2: range(256, 256 + 65536), 4: range(1 << 32), 8: range(1 << 62)}
_ID_SIZES = (0, 1, 2, 4)

# Base and extra bits of the codes of literal and match lengths, up to the lengths used here (RFC 8878, 3.1.1.3.2).
_LITERAL_CODES = (
    *((n, 0) for n in range(16)), (16, 1), (18, 1), (20, 1), (22, 1), (24, 2), (28, 2), (32, 3), (40, 3), (48, 4),
    (64, 6), (128, 7), (256, 8),
)
_MATCH_CODES = (
    *((n, 0) for n in range(3, 35)), (35, 1), (37, 1), (39, 1), (41, 1), (43, 2), (47, 2), (51, 3), (59, 3), (67, 4),
    (83, 4), (99, 5), (131, 7), (259, 8),
)

Frame = Callable[[bytes], bytes]
"""A function that makes a frame of a content of one byte or more."""


class BlockForm(Enum):
    """The form of the blocks of a frame."""

    RAW = "raw"
    RUNS = "runs"
    """Runs of four equal bytes or more are RLE blocks, what is between them raw ones."""
    LITERALS = "literals"
    """Compressed blocks of literals alone; of equal bytes: one byte of them."""
    MATCHES = "matches"
    """Compressed blocks of literals and one match; what follows the last match is a raw block."""


@dataclass(frozen=True)
class FrameStyle:
    """How a frame is made. The default is a single segment of raw blocks, in the least bytes.

    Attributes:
        form: of the blocks. LITERALS and MATCHES need a window descriptor: a single segment's window is its content,
            and no block may be larger than the window.
        size_bytes: of the content size field: 1 (single segment only), 2 (contents from 256 on), 4 or 8; 0: the least.
        window: window descriptor, (log2 - 10) << 3 | eighths; None: a single segment.
        dictionary_bytes: of a dictionary id of 0: 0, 1, 2 or 4.
        most: content bytes of a block at most; fewer where the window asks for it.
        empty_end: whether the last block is an empty raw one.
    """

    form: BlockForm = BlockForm.RAW
    size_bytes: int = 0
    window: int | None = None
    dictionary_bytes: int = 0
    most: int = MOST_BLOCK_BYTES
    empty_end: bool = False

    @property
    def window_bytes(self) -> int:
        """Bytes of the window of a frame that is no single segment."""
        descriptor = self.window or 0
        base = 1 << (10 + (descriptor >> 3))
        return base + base // 8 * (descriptor & 7)

    @property
    def _block_bytes(self) -> int:
        if self.window is None:
            return self.most
        # What a compressed block adds to its literals stays within the window, too.
        return min(self.most, MOST_BLOCK_BYTES - _OVERHEAD, self.window_bytes - _OVERHEAD)

    def __call__(self, content: bytes) -> bytes:
        """The frame.

        Raises:
            ValueError: for a content that its size field cannot state, or a form that a single segment cannot have.
        """
        if self.window is None and self.form in (BlockForm.LITERALS, BlockForm.MATCHES):
            raise ValueError("compressed blocks need a window descriptor")
        starts = range(0, len(content), self._block_bytes)
        blocks = [block for start in starts for block in self._blocks(content, start)]
        if self.empty_end:
            blocks.append((_RAW, 0, b""))
        out = [MAGIC, self._header(len(content))]
        for number, (kind, size, payload) in enumerate(blocks, start=1):
            out += [(size << 3 | kind << 1 | (number == len(blocks))).to_bytes(3, "little"), payload]
        return b"".join(out)

    def _header(self, size: int) -> bytes:
        single = self.window is None
        fitting = [width for width, sizes in _SIZES.items() if size in sizes and (single or width > 1)]
        width = self.size_bytes or min(fitting)
        if width not in fitting:
            raise ValueError(f"a content of {size} bytes has no size field of {width}")
        flags = list(_SIZES).index(width) << 6 | single << 5 | _ID_SIZES.index(self.dictionary_bytes)
        window = b"" if self.window is None else bytes([self.window])
        stored = (size - _SIZES[width].start).to_bytes(width, "little")
        return bytes([flags]) + window + bytes(self.dictionary_bytes) + stored

    def _blocks(self, content: bytes, start: int) -> Iterator[tuple[int, int, bytes]]:
        """Type, size field and payload of the blocks of the content from `start` on, up to the next multiple."""
        part = content[start : start + self._block_bytes]
        if self.form == BlockForm.RUNS:
            yield from _runs(part)
        elif self.form == BlockForm.LITERALS:
            payload = _literals(part) + b"\0"
            yield _COMPRESSED, len(payload), payload
        elif self.form == BlockForm.MATCHES:
            yield from _matches(content, start, start + len(part), self.window_bytes)
        else:
            yield _RAW, len(part), part


def _runs(part: bytes) -> Iterator[tuple[int, int, bytes]]:
    at = 0
    for run in _RUN.finditer(part):
        if run.start() > at:
            yield _RAW, run.start() - at, part[at : run.start()]
        yield _RLE, len(run[0]), run[1]
        at = run.end()
    if at < len(part):
        yield _RAW, len(part) - at, part[at:]


def _literals(part: bytes) -> bytes:
    """A literals section: as they are, or one byte for all."""
    run = len(part) > 1 and part == part[:1] * len(part)
    kind, size = int(run), len(part)
    if size < 32:
        head = (size << 3 | kind).to_bytes(1, "little")
    elif size < 4096:
        head = (size << 4 | 1 << 2 | kind).to_bytes(2, "little")
    else:
        head = (size << 4 | 3 << 2 | kind).to_bytes(3, "little")
    return head + (part[:1] if run else part)


def _matches(content: bytes, start: int, past: int, window: int) -> Iterator[tuple[int, int, bytes]]:
    """Blocks of literals and a match each; a match may begin in any content before."""
    at = done = start
    while at + _LEAST_MATCH <= past:
        offset, length = _longest(content, at, past, window)
        if length < _LEAST_MATCH:
            at += 1
            if at - done < _MOST_LENGTH:
                continue
            yield _RAW, at - done, content[done:at]
        else:
            payload = _literals(content[done:at]) + _sequence(at - done, length, offset)
            yield _COMPRESSED, len(payload), payload
            at += length
        done = at
    if done < past:
        yield _RAW, past - done, content[done:past]


def _longest(content: bytes, at: int, past: int, window: int) -> tuple[int, int]:
    """How far back the last of the longest matches begins, and its length."""
    low, length, found = max(at - window, 0), _LEAST_MATCH - 1, at
    while length < min(past - at, _MOST_LENGTH):
        place = content.rfind(content[at : at + length + 1], low, at + length)
        if place < 0:
            break
        found, length = place, length + 1
    return at - found, length


def _sequence(literals: int, length: int, offset: int) -> bytes:
    """A sequences section of one sequence, its three codes in RLE mode."""
    codes, bits = [], 1
    # A decoder reads the offset's extra bits first, from the end of the section (RFC 8878, 3.1.1.3.2.1).
    value = offset + 3
    offset_code = value.bit_length() - 1
    bits = bits << offset_code | value - (1 << offset_code)
    for number, table in ((length, _MATCH_CODES), (literals, _LITERAL_CODES)):
        code = _code(number, table)
        base, extra = table[code]
        bits = bits << extra | number - base
        codes.append(code)
    stream = bits.to_bytes(-(-bits.bit_length() // 8), "little")
    return bytes([1, 0b01010100, codes[1], offset_code, codes[0]]) + stream


def _code(number: int, table: tuple[tuple[int, int], ...]) -> int:
    for code, ((base, _), (past, _)) in enumerate(pairwise(table)):
        if base <= number < past:
            return code
    return len(table) - 1
