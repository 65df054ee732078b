"""Variable-length integers, bounds-checked reading inside a payload (SPEC §5.7).

LEB128: seven bits a byte, least significant group first, the top bit set on all but the last byte.
A varint must be as short as its value allows.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.errors import InvalidInput, Malformed

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
