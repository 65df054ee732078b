"""Rice codes: integers near zero in few bits, with one parameter an array (SPEC §5.9).

With zigzag z of a value (0, -1, 1, -2, ... -> 0, 1, 2, 3, ...) and parameter k, the quotient z >> k travels in
unary, the k low bits as they are. All quotients come first, so that both parts are read at once.
"""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import I64, Ints
from scarfmt.container.bytefields import ByteReader
from scarfmt.errors import Malformed

MAX_PARAMETER = 31
MAX_QUOTIENT = 255
"""Limit of a quotient, which bounds the memory that a short array can make a reader unpack."""


def pack_rice(values: Ints) -> bytes:
    """An array: k u8; then z >> k ones and a zero a value, then the k low bits of every z, highest first.

    Both bit strings start at the highest bit of a byte, and each is filled up with zeros. The best k that leaves no
    quotient above 255 is taken, the smallest of equals.

    Args:
        values: (n,), magnitudes below 2^31.
    """
    z = _zigzag(values.astype(np.int64))
    least = max(int(z.max(initial=0)).bit_length() - MAX_QUOTIENT.bit_length(), 0)
    sizes = [int((z >> k).sum()) + len(z) * (1 + k) for k in range(least, MAX_PARAMETER + 1)]
    k = least + int(np.argmin(sizes))
    ends = np.cumsum((z >> k) + 1) - 1
    unary = np.ones(int(ends[-1]) + 1 if len(z) else 0, np.uint8)
    unary[ends] = 0
    low = ((z[:, None] >> np.arange(k - 1, -1, -1)) & 1).astype(np.uint8)
    return bytes([k]) + np.packbits(unary).tobytes() + np.packbits(low.ravel()).tobytes()


def unpack_rice(reader: ByteReader, count: int) -> I64:
    """The inverse of :func:`pack_rice`: (count,) int64.

    Raises:
        Malformed: ``bad-rice`` for a parameter above 31, a quotient above 255, a value of more than 32 bits or a
            fill bit that is not 0; ``payload-short``.
    """
    k = reader.take(1)[0]
    if k > MAX_PARAMETER:
        raise _bad(f"a parameter of {k}, at most {MAX_PARAMETER} allowed")
    quotients = _read_unary(reader, count)
    low = np.unpackbits(np.frombuffer(reader.take((count * k + 7) // 8), np.uint8))
    if low[count * k :].any():
        raise _bad("a fill bit is not 0")
    powers = np.int64(1) << np.arange(k - 1, -1, -1)
    z = (quotients << k) + low[: count * k].reshape(count, k).astype(np.int64) @ powers
    if count and int(z.max()) >> 32:
        raise _bad("a value of more than 32 bits")
    return np.where(z & 1, -(z >> 1) - 1, z >> 1)


def pack_shifted(values: Ints) -> bytes:
    """Numbers that may share trailing zero bits: how many u8, then :func:`pack_rice` of the rest (SPEC §5.9)."""
    shared = int(np.bitwise_or.reduce(values.astype(np.int64).ravel(), initial=0))
    shift = min((shared & -shared).bit_length() - 1, MAX_PARAMETER) if shared else 0
    return bytes([shift]) + pack_rice(values.ravel() >> shift)


def unpack_shifted(reader: ByteReader, count: int) -> I64:
    """The inverse of :func:`pack_shifted`: (count,) int64.

    Raises:
        Malformed: ``bad-rice`` for a shift above 31 or a number beyond 32 bits; as :func:`unpack_rice`.
    """
    shift = reader.take(1)[0]
    if shift > MAX_PARAMETER:
        raise _bad(f"a shift of {shift}, at most {MAX_PARAMETER} allowed")
    values = unpack_rice(reader, count) << shift
    if count and int(np.abs(values).max()) >> 31:
        raise _bad("a shifted number of more than 32 bits")
    return values


def _read_unary(reader: ByteReader, count: int) -> I64:
    """(count,) quotients: ones before each zero."""
    if not count:
        return np.zeros(0, np.int64)
    most = (count * (MAX_QUOTIENT + 1) + 7) // 8
    data = reader.rest(most)
    bits = np.unpackbits(np.frombuffer(data, np.uint8))
    ends = np.flatnonzero(bits == 0)[:count]
    if len(ends) < count and len(data) < most:
        message = f"{count} values wanted, the payload ends in the {len(ends) + 1}th"
        raise Malformed("payload-short", message, field="rice")
    quotients = np.diff(ends, prepend=-1) - 1
    if len(ends) < count or int(quotients.max()) > MAX_QUOTIENT:
        raise _bad(f"a quotient above {MAX_QUOTIENT}")
    used = (int(ends[-1]) + 8) // 8
    if bits[int(ends[-1]) + 1 : 8 * used].any():
        raise _bad("a fill bit is not 0")
    reader.take(used)
    return quotients


def _zigzag(values: I64) -> I64:
    return np.asarray(np.where(values >= 0, 2 * values, -2 * values - 1))


def _bad(message: str) -> Malformed:
    return Malformed("bad-rice", f"{message} (SPEC §5.9)", field="rice")
