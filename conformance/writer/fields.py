"""Variable-length integers and Rice codes (SPEC §5.7, §5.9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

MAX_PARAMETER, MAX_QUOTIENT, MAX_SHIFT = 31, 255, 31


def varint(value: int) -> bytes:
    """LEB128 of a number of 0 or more, as short as it can be."""
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def folded(value: int) -> int:
    """A signed number as one of 0 or more: 0, -1, 1, -2, ... as 0, 1, 2, 3, ..."""
    return 2 * value if value >= 0 else -2 * value - 1


@dataclass(frozen=True)
class RiceStyle:
    """How Rice codes are chosen; the default is what R-5.9-4 recommends.

    Attributes:
        raised: added to the best k; what then is below the least k without a quotient above 255, or above 31, is that.
        most_shift: zero bits that all numbers of a `shifted` end in are left out up to so many.
        zero_shift: `shift` where all numbers are 0.
    """

    raised: int = 0
    most_shift: int = MAX_SHIFT
    zero_shift: int = 0


PLAIN = RiceStyle()


def rice(values: Sequence[int], style: RiceStyle = PLAIN) -> bytes:
    """Signed integers whose folded values are below 2^32, with one parameter."""
    mapped = [folded(value) for value in values]
    k = _parameter(mapped, style.raised)
    quotients = "".join("1" * (m >> k) + "0" for m in mapped)
    low = "".join(f"{m & ((1 << k) - 1):0{k}b}" for m in mapped) if k else ""
    return bytes([k]) + _packed(quotients) + _packed(low)


def _parameter(mapped: list[int], raised: int) -> int:
    """The k of fewest bits that leaves no quotient above 255, the smallest of equals, and so much more."""
    largest = max(mapped, default=0)
    possible = [k for k in range(MAX_PARAMETER + 1) if largest >> k <= MAX_QUOTIENT]
    sizes = {k: len(mapped) * (1 + k) + sum(m >> k for m in mapped) for k in possible}
    best = min(possible, key=lambda k: (sizes[k], k))
    return min(max(best + raised, possible[0]), MAX_PARAMETER)


def _packed(bits: str) -> bytes:
    """Bits from the highest of the first byte on, filled up with zeros."""
    size = -(-len(bits) // 8)
    return int(bits.ljust(8 * size, "0") or "0", 2).to_bytes(size, "big")


def shifted(numbers: Sequence[int], style: RiceStyle = PLAIN) -> bytes:
    """Signed integers that may share zero bits at their end."""
    joined = 0
    for number in numbers:
        joined |= abs(number)
    zeros = (joined & -joined).bit_length() - 1
    shift = min(zeros, style.most_shift) if joined else style.zero_shift
    return bytes([shift]) + rice([number >> shift for number in numbers], style)
