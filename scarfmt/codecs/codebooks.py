"""CODEBOOKS block: the RVQ codewords first needed in a layer (SPEC §7.8; paper §3.2, dual codebook).

Codebook 0 is the coarse one of stage 1, codebook 1 the residual one shared by all later stages. Codewords
are integers on one common step, so the latent z = sum of codewords is exact. Each dimension is stored as
unsigned offsets from its minimum in as few bits as its range needs: trailing dimensions of a decorrelated
latent have short ranges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.bytefields import ByteReader, signed_varint, unsigned_varint
from scarfmt.errors import Malformed

I64 = NDArray[np.int64]

MAX_CODEWORDS = 4096
MAX_LATENT = 64
_MAX_WIDTH = 16


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

    def latents(self, indices: NDArray[np.integer[Any]], stages: I64) -> I64:
        """(n, d) int64 sums of the codewords of each anchor's first `stages` indices (SPEC §9.2).

        Args:
            indices: (n, M) int64.
            stages: (n,) int64 stages received, 0..M.
        """
        z = np.zeros((len(indices), self.dimension), np.int64)
        for stage in range(indices.shape[1]):
            chosen = np.flatnonzero(stages > stage)
            book = self.residual if stage else self.coarse
            if len(chosen):
                z[chosen] += book[indices[chosen, stage]]
        return z


def pack_codebooks(books: dict[int, I64]) -> bytes:
    """The payload of a CODEBOOKS block: `books` maps book number to (n, d) int64 codewords."""
    dimension = next(iter(books.values())).shape[1]
    out = [unsigned_varint(dimension), unsigned_varint(len(books))]
    for number in sorted(books):
        words = books[number]
        out += [bytes([number]), unsigned_varint(len(words))]
        out += [_pack_dimension(words[:, column]) for column in range(dimension)]
    return b"".join(out)


def _pack_dimension(values: I64) -> bytes:
    low = int(values.min())
    width = int(values.max() - low).bit_length()
    bits = ((values - low)[:, None] >> np.arange(width - 1, -1, -1)) & 1
    return signed_varint(low) + bytes([width]) + np.packbits(bits.astype(np.uint8).ravel()).tobytes()


def unpack_codebooks(payload: bytes) -> dict[int, I64]:
    """The inverse of :func:`pack_codebooks`.

    Raises:
        Malformed: ``bad-codebook`` for a payload that breaks SPEC §7.8.
    """
    reader = ByteReader(payload, "codebooks")
    dimension, count = reader.count(MAX_LATENT), reader.count(2)
    books: dict[int, I64] = {}
    for _ in range(count):
        number, size = reader.take(1)[0], reader.count(MAX_CODEWORDS)
        if number > 1 or (books and number <= max(books)) or size == 0 or dimension == 0:
            raise Malformed("bad-codebook", f"book {number} of {size} codewords (SPEC §7.8)", field="codebooks")
        columns = [_read_dimension(reader, size) for _ in range(dimension)]
        books[number] = np.stack(columns, axis=1)
    if not books:
        raise Malformed("bad-codebook", "the block holds no codebook (SPEC §7.8)", field="codebooks")
    reader.finish()
    return books


def _read_dimension(reader: ByteReader, size: int) -> I64:
    low, width = reader.signed(17), reader.take(1)[0]
    if width > _MAX_WIDTH:
        raise Malformed("bad-codebook", f"{width} bits a codeword value (SPEC §7.8)", field="codebooks")
    packed = np.frombuffer(reader.take((size * width + 7) // 8), np.uint8)
    bits = np.unpackbits(packed)
    if bits[size * width :].any():
        raise Malformed("bad-codebook", "padding bits must be 0 (SPEC §7.8)", field="codebooks")
    weights = 1 << np.arange(width - 1, -1, -1, dtype=np.int64)
    return low + bits[: size * width].reshape(size, width).astype(np.int64) @ weights
