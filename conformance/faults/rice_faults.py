"""The invalid vectors of Rice codes (SPEC §5.9): in a codebook, and in the biases that end an index network.

A reader that does not look for the fault gets a result, except from those whose payload ends in a run of ones.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from conformance.scenes.cases import Case, Fault, refused
from conformance.surgery.files import block_of, changed
from conformance.writer.fields import rice, shifted
from conformance.writer.models import codebooks_block
from scarfmt.arrays import I64
from scarfmt.blocks.codebooks import unpack_codebooks
from scarfmt.blocks.index_network import unpack_network
from scarfmt.container.schema import BlockKind
from scarfmt.entropy.rice import MAX_PARAMETER, MAX_QUOTIENT

_RULE = "R-5.9-1", "bad-rice"
_SHIFT_RULE = "R-5.9-2", "bad-rice"
_ORDER = "R-5.9-3"


def rice_faults(coded: bytes, equal: bytes) -> Iterator[Case]:
    """Files with broken Rice codes.

    Args:
        coded: a file with a codebook in layer 1.
        equal: one whose network ends in biases of 0.
    """
    yield from (refused(*fault, stage="models") for fault in (*_codebook_faults(coded), *_shift_faults(equal)))


def _codebook_faults(data: bytes) -> Iterator[Fault]:
    payload = block_of(data, BlockKind.CODEBOOKS, 1).payload
    books = unpack_codebooks(payload)
    words = books[max(books)][:, -1]
    start = len(payload) - len(rice(words.tolist()))
    assert payload == codebooks_block(books)
    assert payload[start:] == rice(words.tolist())

    def ending(column: bytes) -> bytes:
        """The file whose last dimension of the last codebook is these bytes."""
        return changed(data, BlockKind.CODEBOOKS, 1, lambda p: p[:start] + column)

    mapped = [2 * int(word) if word >= 0 else -2 * int(word) - 1 for word in words]
    yield ("rice-parameter", "a parameter of 32, low bits to match", *_RULE,
           ending(_coded(mapped, MAX_PARAMETER + 1)))
    yield ("rice-quotient", "a quotient of 256", *_RULE, ending(_coded([MAX_QUOTIENT + 1, *mapped[1:]], 0)))
    fitting = next(k for k in range(32) if max(mapped) >> k <= 8 and _fill(sum(m >> k for m in mapped) + len(words)))
    yield "rice-fill", "a fill bit of 1 after the quotients", *_RULE, ending(_coded(mapped, fitting, quotient_fill=1))
    odd = next(k for k in range(1, 32) if max(mapped) >> k <= 8 and _fill(k * len(words)))
    yield "rice-fill-low", "a fill bit of 1 after the low bits", *_RULE, ending(_coded(mapped, odd, low_fill=1))
    yield "rice-wide", "a number of 33 bits", *_RULE, ending(_coded([1 << 32, *mapped[1:]], MAX_PARAMETER))
    yield ("rice-ones", "bits 1 all through as many bytes as the quotients can take", _ORDER, "bad-rice",
           ending(b"\0" + b"\xff" * (32 * len(words))))
    yield ("rice-ones-short", "as rice-ones, but one byte less: the payload ends first", _ORDER, "payload-short",
           ending(b"\0" + b"\xff" * (32 * len(words) - 1)))
    # The last quotient is only half there; that the first is too large is not looked at before.
    yield ("rice-short", "a quotient of 256, then the payload ends before the last zero", _ORDER, "payload-short",
           ending(_coded([MAX_QUOTIENT + 1, *[0] * (len(words) - 2), 8], 0)[:-1]))


def _coded(mapped: list[int], k: int, quotient_fill: int = 0, low_fill: int = 0) -> bytes:
    """A Rice code of these non-negative numbers, with any parameter and any last fill bits."""
    quotients = "".join("1" * (m >> k) + "0" for m in mapped)
    low = "".join(f"{m & ((1 << k) - 1):0{k}b}" for m in mapped) if k else ""
    return bytes([k]) + _bytes(quotients, quotient_fill) + _bytes(low, low_fill)


def _fill(bits: int) -> int:
    return -bits % 8


def _bytes(bits: str, last: int) -> bytes:
    """Bits in whole bytes, the last fill bit as given."""
    fill = _fill(len(bits))
    value = int(bits + "0" * fill or "0", 2)
    assert fill or not last
    return (value | last).to_bytes((len(bits) + fill) // 8, "big")


def _shift_faults(equal: bytes) -> Iterator[Fault]:
    payload = block_of(equal, BlockKind.ENTROPY_NETWORK).payload
    biases: I64 = unpack_network(payload).heads[-1].biases
    tail = shifted(biases.tolist())
    assert payload.endswith(tail)
    assert not biases.any()

    def ending(code: bytes) -> bytes:
        return changed(equal, BlockKind.ENTROPY_NETWORK, 1, lambda p: p[: -len(tail)] + code)

    yield ("shift-32", "zeros shifted by 32", *_SHIFT_RULE, ending(bytes([MAX_PARAMETER + 1]) + tail[1:]))
    yield ("shift-wide", "1 shifted by 31", *_SHIFT_RULE,
           ending(bytes([MAX_PARAMETER]) + rice(np.ones(len(biases), np.int64).tolist())))
    yield ("shift-low", "-1 shifted by 31: -2^31, which 32 bits hold", *_SHIFT_RULE,
           ending(bytes([MAX_PARAMETER]) + rice((-np.ones(len(biases), np.int64)).tolist())))
