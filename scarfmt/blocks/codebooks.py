"""CODEBOOKS block: the RVQ codewords first needed in a layer (SPEC §7.8; paper §3.2, dual codebook).

Codebook 0 is the coarse one of stage 1, codebook 1 the residual one shared by all later stages. Codewords
are integers on one common step, so the latent z = sum of codewords is exact. Each dimension is Rice-coded by
itself: trailing dimensions of a decorrelated latent hold small numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.container.bytefields import ByteReader, unsigned_varint
from scarfmt.entropy.rice import pack_rice, unpack_rice
from scarfmt.errors import Malformed

I64 = NDArray[np.int64]

MAX_CODEWORDS = 4096
MAX_LATENT = 64
MAX_VALUE = 65535


@dataclass(frozen=True)
class Codebooks:
    """The two codebooks; an empty one has shape (0, d).

    Attributes:
        coarse: (n1, d) int64 codewords of stage 1.
        residual: (n2, d) int64 codewords of later stages.
    """

    coarse: I64
    residual: I64

    @property
    def dimension(self) -> int:
        """d, latent dimensions."""
        return int(self.coarse.shape[1])

    @property
    def sizes(self) -> tuple[int, int]:
        """Codewords in each book."""
        return len(self.coarse), len(self.residual)

    def latents(self, indices: NDArray[np.integer[Any]], stages: I64, columns: int | None = None) -> I64:
        """(n, d) int64 sums of the codewords of each anchor's first `stages` indices (SPEC §9.2).

        Args:
            indices: (n, M) int64.
            stages: (n,) int64 stages received, 0..M.
            columns: how many leading dimensions are wanted, None for all.
        """
        z = np.zeros((len(indices), self.dimension if columns is None else columns), np.int64)
        for stage in range(indices.shape[1]):
            chosen = np.flatnonzero(stages > stage)
            book = (self.residual if stage else self.coarse)[:, : z.shape[1]]
            if len(chosen):
                z[chosen] += book.take(indices[chosen, stage], axis=0)
        return z


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
