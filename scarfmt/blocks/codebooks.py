"""CODEBOOKS block: the RVQ codewords first needed in a layer (SPEC §7.8; paper §3.2, dual codebook).

Each dimension is Rice-coded by itself: trailing dimensions of a decorrelated latent hold small numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scarfmt.container.bytefields import ByteReader, unsigned_varint
from scarfmt.entropy.rice import pack_rice, unpack_rice
from scarfmt.errors import Malformed
from scarfmt.scene.codebooks import MAX_CODEWORDS, MAX_LATENT

I64 = NDArray[np.int64]

MAX_VALUE = 65535


def pack_codebooks(books: dict[int, I64]) -> bytes:
    """The payload of a CODEBOOKS block: `books` maps book number to (n, d) int64 codewords."""
    dimension = next(iter(books.values())).shape[1]
    out = [unsigned_varint(dimension), unsigned_varint(len(books))]
    for number in sorted(books):
        words = books[number]
        out += [bytes([number]), unsigned_varint(len(words))]
        out += [pack_rice(words[:, column]) for column in range(dimension)]
    return b"".join(out)


def unpack_codebooks(payload: bytes) -> dict[int, I64]:
    """The inverse of :func:`pack_codebooks`.

    Raises:
        Malformed: ``bad-codebook`` for a payload that breaks SPEC §7.8.
    """
    reader = ByteReader(payload, "codebooks")
    dimension = reader.count(MAX_LATENT)
    if not dimension:
        raise Malformed("bad-codebook", "codewords of no dimensions (SPEC §7.8)", field="codebooks")
    count = reader.count(2)
    books: dict[int, I64] = {}
    for _ in range(count):
        number, size = reader.take(1)[0], reader.count(MAX_CODEWORDS)
        if number > 1 or (books and number <= max(books)) or size == 0:
            raise Malformed("bad-codebook", f"book {number} of {size} codewords (SPEC §7.8)", field="codebooks")
        columns = [_checked(unpack_rice(reader, size)) for _ in range(dimension)]
        books[number] = np.stack(columns, axis=1)
    if not books:
        raise Malformed("bad-codebook", "the block holds no codebook (SPEC §7.8)", field="codebooks")
    reader.finish()
    return books


def _checked(values: I64) -> I64:
    if int(np.abs(values).max()) > MAX_VALUE:
        raise Malformed("bad-codebook", f"a component beyond {MAX_VALUE} (SPEC §7.8)", field="codebooks")
    return values
