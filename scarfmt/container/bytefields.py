"""Variable-length integers, bounds-checked reading inside a payload, Zstandard frames (SPEC §5.7, §5.8).

LEB128: seven bits a byte, least significant group first, the top bit set on all but the last byte.
Signed values are zigzag-mapped first. A varint must be as short as its value allows.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate
from typing import Any, Protocol

import numpy as np
import zstandard
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.errors import InvalidInput, LimitExceeded, Malformed

MAX_ZSTD_WINDOW = 8 << 20
_ZSTD_LEVEL = 19
_MAGIC = bytes.fromhex("28b52ffd")
_SINGLE_SEGMENT, _RESERVED, _CHECKSUM = 1 << 5, 1 << 3, 1 << 2
_DICTIONARY_BYTES = (0, 1, 2, 4)
_SIZE_BYTES = (0, 2, 4, 8)
_HEAD = ("magic", "descriptor", "window", "dictionary", "content_size")
_BLOCK_KINDS = ("raw", "repeated", "compressed", "reserved")
# So few integers are read faster one by one.
_FEW = 12


def unsigned_varint(value: int) -> bytes:
    """LEB128 bytes of `value` >= 0."""
    if value < 0:
        raise InvalidInput("input-varint", f"{value} is negative", field="varint")
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def signed_varint(value: int) -> bytes:
    """LEB128 bytes of the zigzag map 0, -1, 1, -2, ... -> 0, 1, 2, 3, ..."""
    return unsigned_varint(2 * value if value >= 0 else -2 * value - 1)


def unsigned_varints(values: I64) -> bytes:
    """LEB128 bytes of (n,) int64 `values` >= 0, one after the other.

    Raises:
        InvalidInput: ``input-varint`` for a negative one.
    """
    if len(values) and int(values.min()) < 0:
        raise InvalidInput("input-varint", f"{values.min()} is negative", field="varint")
    lengths = np.ones(len(values), np.int64)
    for shift in range(7, 63, 7):
        lengths += values >> shift > 0
    ends = np.cumsum(lengths)
    out = np.zeros(int(ends[-1]) if len(ends) else 0, np.uint8)
    for place in range(int(lengths.max(initial=0))):
        there = np.flatnonzero(lengths > place)
        more = lengths[there] > place + 1
        out[ends[there] - lengths[there] + place] = (values[there] >> (7 * place) & 0x7F) | more * 0x80
    return out.tobytes()


def _ending_at(window: NDArray[np.uint8], ends: I64, bits: int) -> I64 | None:
    """(n,) int64 LEB128 integers whose last bytes are those at n >= 1 `ends`; None if one is not below 2^bits."""
    lengths = np.diff(ends, prepend=-1)
    if int(lengths.max()) > -(-bits // 7) or bool(((window[ends] == 0) & (lengths > 1)).any()):
        return None
    values = np.zeros(len(ends), np.int64)
    for place in range(int(lengths.max())):
        there = np.flatnonzero(lengths > place)
        values[there] |= (window[ends[there] - lengths[there] + 1 + place] & 0x7F).astype(np.int64) << (7 * place)
    return None if int(values.max()) >> bits else values


class Trace(Protocol):
    """Hears which bytes are what, as they are read."""

    def enter(self, name: str | int, at: int) -> None:
        """A field, or the item of this number of a repetition, begins at byte `at` of the payload."""

    def leave(self, value: Any, at: int) -> None:
        """The field that began last ends before byte `at` and has this value."""

    def part(self, name: str, start: int, past: int, value: Any) -> None:
        """Bytes `start` to `past` of the payload are a part of the field that has begun."""


class ByteReader:
    """A cursor over one payload that never reads past its end, and that may be watched by a `trace`.

    Attributes:
        position: bytes taken so far; it may be set back.
    """

    def __init__(self, data: bytes, field: str, trace: Trace | None = None) -> None:
        self._data, self._field, self.position, self.trace = data, field, 0, trace

    def take(self, length: int) -> bytes:
        """The next `length` bytes.

        Raises:
            Malformed: ``payload-short`` when fewer are left.
        """
        if length > len(self._data) - self.position:
            left = len(self._data) - self.position
            raise Malformed("payload-short", f"{length} bytes wanted, {left} left in the payload", field=self._field)
        self.position += length
        return self._data[self.position - length : self.position]

    def skip(self) -> None:
        """Take all that is left."""
        self.position = len(self._data)

    def byte(self, position: int) -> int:
        """A byte that was taken."""
        return self._data[position]

    def rest(self, most: int) -> bytes:
        """The bytes not yet taken, at most `most` of them, without taking them."""
        return self._data[self.position : self.position + most]

    def unsigned(self, bits: int) -> int:
        """A LEB128 integer below 2^bits.

        Raises:
            Malformed: ``bad-varint`` when it is longer than needed or too large.
        """
        value, shift = 0, 0
        if self.position < len(self._data) and self._data[self.position] < 0x80 and bits >= 7:
            self.position += 1
            return self._data[self.position - 1]
        while True:
            byte = self.take(1)[0]
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                break
            if shift > bits:
                raise Malformed("bad-varint", f"integer above {bits} bits (SPEC §5.7)", field=self._field)
        if value >> bits or (byte == 0 and shift > 7):
            raise Malformed("bad-varint", f"over-long integer or above {bits} bits (SPEC §5.7)", field=self._field)
        return value

    def unsigned_array(self, bits: int, count: int) -> I64:
        """(count,) int64: `count` times :meth:`unsigned`, all at once where they are many; `bits` at most 63."""
        values = self._at_once(bits, count) if count >= _FEW else None
        # One by one, too, to refuse the first that is wrong.
        return np.array([self.unsigned(bits) for _ in range(count)], np.int64) if values is None else values

    def _at_once(self, bits: int, count: int) -> I64 | None:
        window = np.frombuffer(self.rest(count * -(-bits // 7)), np.uint8)
        ends = np.flatnonzero(window < 0x80)[:count]
        values = _ending_at(window, ends, bits) if len(ends) == count else None
        if values is not None:
            self.take(int(ends[-1]) + 1)
        return values

    def u32(self) -> int:
        """A u32."""
        return int.from_bytes(self.take(4), "little")

    def signed(self, bits: int) -> int:
        """A zigzag LEB128 integer whose mapped value is below 2^bits."""
        mapped = self.unsigned(bits)
        return mapped >> 1 if mapped % 2 == 0 else -(mapped >> 1) - 1

    def count(self, limit: int) -> int:
        """A LEB128 count of at most `limit` elements.

        Raises:
            LimitExceeded: ``count-limit`` above it.
        """
        value = self.unsigned(63)
        if value > limit:
            raise LimitExceeded("count-limit", f"{value} elements, at most {limit} allowed", field=self._field)
        return value

    def array(self, dtype: str, count: int) -> NDArray[np.generic]:
        """`count` little-endian elements of `dtype`, a read-only view."""
        kind = np.dtype(dtype)
        return np.frombuffer(self.take(kind.itemsize * count), dtype=kind)

    def finish(self) -> None:
        """Check that nothing is left.

        Raises:
            Malformed: ``payload-long`` otherwise.
        """
        if self.position != len(self._data):
            left = len(self._data) - self.position
            raise Malformed("payload-long", f"{left} bytes after the end of the structure", field=self._field)


def compress(payload: bytes) -> bytes:
    """One zstd frame with content size, without checksum (SPEC §5.8)."""
    parameters = zstandard.ZstdCompressionParameters.from_level(
        _ZSTD_LEVEL, source_size=len(payload), write_content_size=True, write_checksum=False, window_log=23
    )
    return zstandard.ZstdCompressor(compression_params=parameters).compress(payload)


def decompress(frame: bytes, limit: int, field: str, allowance: int | None = None) -> bytes:
    """The content of exactly one zstd frame (SPEC §5.8).

    Args:
        limit: most bytes the content may have.
        allowance: most bytes this reader accepts.

    Raises:
        LimitExceeded: ``content-limit``; ``limit-expansion`` beyond the allowance.
        Malformed: ``bad-zstd`` for anything that is not one whole frame with its content size, at least 1, a window
            of at most 8 MiB, and neither dictionary nor checksum.
    """
    size, window, dictionary, checksum = frame_header(frame, field)
    # Size 0 too: zstandard then looks at nothing after the frame header, and no structure here is empty.
    if not size or dictionary:
        raise Malformed("bad-zstd", "a zstd frame must state its content size, without dictionary", field=field)
    # The block's CRC-32 covers the same bytes, and a decoder of its own is then simpler.
    if checksum:
        raise Malformed("bad-zstd", "a zstd frame must not carry a checksum (SPEC §5.8)", field=field)
    if size > limit:
        raise LimitExceeded("content-limit", f"{size} bytes of content, at most {limit} allowed", field=field)
    # Checked here: zstandard applies its own window limit only when it streams.
    if window > MAX_ZSTD_WINDOW:
        message = f"a window of {window} bytes, at most 8 MiB allowed (SPEC §5.8)"
        raise Malformed("bad-zstd", message, field=field)
    # After the rules of the format: what a reader may refuse by itself hides no fault of a frame header.
    if allowance is not None and size > allowance:
        message = f"{size} bytes of content from {len(frame)}: raise this reader's limit if you trust the file"
        raise LimitExceeded("limit-expansion", message, field=field)
    try:
        decoder = zstandard.ZstdDecompressor()
        content = decoder.decompress(frame, max_output_size=size, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise Malformed("bad-zstd", f"not one whole zstd frame: {error}", field=field) from error
    if len(content) != size:
        raise Malformed("bad-zstd", f"{len(content)} bytes of content, {size} declared", field=field)
    return content


def frame_header(frame: bytes, field: str) -> tuple[int, int, int, bool]:
    """What the header of `frame` says, as SPEC §5.8 orders its checks.

    The zstandard package refuses some headers, those of huge windows, before it tells what they say.

    Returns:
        Bytes of the content, 0 also where it does not say; bytes a decoder must keep; id of the dictionary, 0 for
        none; whether a checksum follows.

    Raises:
        Malformed: ``bad-zstd`` for no frame, a header that is cut, or its reserved bit.
    """
    if len(frame) < 5 or not frame.startswith(_MAGIC):
        raise Malformed("bad-zstd", "not a zstd frame", field=field)
    descriptor, head = frame[4], _head(frame)
    if descriptor & _RESERVED:
        raise Malformed("bad-zstd", "a reserved bit of a zstd frame is 1", field=field)
    if head["content_size"].stop > len(frame):
        raise Malformed("bad-zstd", "the header of a zstd frame is cut", field=field)
    _, _, window, dictionary, size = (int.from_bytes(frame[part.start : part.stop], "little") for part in head.values())
    # Two bytes count from 256 on: one would do for less.
    size += 256 if len(head["content_size"]) == 2 else 0
    reach = _window(window) if head["window"] else size
    return size, reach, dictionary, bool(descriptor & _CHECKSUM)


def _head(frame: bytes) -> dict[str, range]:
    """The bytes of each field of a frame's header, as its descriptor says; some have none."""
    single = bool(frame[4] & _SINGLE_SEGMENT)
    size_bytes = _SIZE_BYTES[frame[4] >> 6] or int(single)
    sizes = (4, 1, int(not single), _DICTIONARY_BYTES[frame[4] & 3], size_bytes)
    ends = accumulate(sizes)
    return {name: range(end - size, end) for name, size, end in zip(_HEAD, sizes, ends, strict=True)}


def _window(descriptor: int) -> int:
    base = 1 << (10 + (descriptor >> 3))
    return base + base // 8 * (descriptor & 7)


def frame_fields(frame: bytes) -> Iterator[tuple[str, int, int, Any]]:
    """(name, start, past, value) of each field of `frame` and its blocks, in order, as far as they go.

    Fields of no bytes are left out; so is what follows a field that the frame is too short for.
    """
    if len(frame) < 5 or not frame.startswith(_MAGIC):
        return
    head = _head(frame)
    for name, part in head.items():
        if part and part.stop <= len(frame):
            data = frame[part.start : part.stop]
            yield name, part.start, part.stop, data if name == "magic" else int.from_bytes(data, "little")
    yield from _block_fields(frame, head["content_size"].stop, bool(frame[4] & _CHECKSUM))


def _block_fields(frame: bytes, at: int, checksum: bool) -> Iterator[tuple[str, int, int, Any]]:
    number, last = 0, False
    while not last and at + 3 <= len(frame):
        head = int.from_bytes(frame[at : at + 3], "little")
        last, kind, size = bool(head & 1), _BLOCK_KINDS[head >> 1 & 3], head >> 3
        yield f"block[{number}].head", at, at + 3, f"{kind}, {size} bytes" + (", last" if last else "")
        at += 3
        stored = 1 if kind == "repeated" else size
        if at + stored > len(frame):
            return
        if stored:
            yield f"block[{number}].data", at, at + stored, frame[at : at + stored]
        at, number = at + stored, number + 1
    if last and checksum and at + 4 <= len(frame):
        yield "checksum", at, at + 4, int.from_bytes(frame[at : at + 4], "little")
