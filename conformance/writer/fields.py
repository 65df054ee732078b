"""Variable-length integers (SPEC §5.7), and signed numbers as numbers of 0 or more (§8.5)."""

from __future__ import annotations


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
