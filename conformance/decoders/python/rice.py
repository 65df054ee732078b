"""Rice codes (SPEC §5.9): of codewords, and of the weights and biases of networks."""

from __future__ import annotations

from conformance.decoders.python.fields import Payload, Refused, require


def read_rice(reader: Payload, n: int) -> list[int]:
    """n integers."""
    k = reader.u8()
    require(k <= 31, "bad-rice")
    quotients = _quotients(reader, n)
    low = reader.take((n * k + 7) // 8)
    bits = int.from_bytes(low, "big")
    fill = 8 * len(low) - n * k
    require(bits & ((1 << fill) - 1) == 0, "bad-rice")
    out = []
    for i, q in enumerate(quotients):
        m = q << k | bits >> (fill + (n - 1 - i) * k) & ((1 << k) - 1)
        require(m < 1 << 32, "bad-rice")
        out.append(m >> 1 if m % 2 == 0 else -(m >> 1) - 1)
    return out


def _quotients(reader: Payload, n: int) -> list[int]:
    if n == 0:
        return []
    bits = "".join(f"{byte:08b}" for byte in reader.data[reader.at : reader.at + 32 * n])
    if bits.count("0") < n:
        raise Refused("payload-short" if len(bits) < 256 * n else "bad-rice")
    quotients, at = [], 0
    for _ in range(n):
        zero = bits.index("0", at)
        quotients.append(zero - at)
        at = zero + 1
    require(max(quotients) <= 255, "bad-rice")
    fill = -at % 8
    require("1" not in bits[at : at + fill], "bad-rice")
    reader.at += (at + fill) // 8
    return quotients


def read_shifted(reader: Payload, n: int) -> list[int]:
    """n integers that share trailing zero bits."""
    shift = reader.u8()
    require(shift <= 31, "bad-rice")
    out = [v << shift for v in read_rice(reader, n)]
    require(all(abs(v) < 1 << 31 for v in out), "bad-rice")
    return out
