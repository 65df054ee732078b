"""Codebooks: every width, every refusal, and latents as plain sums."""

from __future__ import annotations

import numpy as np
import pytest
from codec_samples import refuses
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from scarfmt.bytefields import signed_varint, unsigned_varint
from scarfmt.codecs.codebooks import (
    MAX_CODEWORDS,
    MAX_LATENT,
    Codebooks,
    pack_codebooks,
    unpack_codebooks,
)
from scarfmt.errors import LimitExceeded, ScarError

I64 = NDArray[np.int64]


def same(found: dict[int, I64], wanted: dict[int, I64]) -> bool:
    return sorted(found) == sorted(wanted) and all(np.array_equal(found[n], wanted[n]) for n in wanted)


@pytest.mark.parametrize("width", range(17))
@pytest.mark.parametrize("low", [-(1 << 16), -1, 0, 5])
def test_every_width_comes_back(width: int, low: int) -> None:
    """A dimension of 2^width different values, from the lowest minimum on."""
    rng = np.random.default_rng(width)
    words = low + rng.integers(0, 1 << width, (37, 3))
    words[:2, 1] = low, low + (1 << width) - 1
    assert same(unpack_codebooks(pack_codebooks({0: words})), {0: words})


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([(0,), (1,), (0, 1)]), st.integers(1, MAX_LATENT))
def test_books_come_back(seed: int, numbers: tuple[int, ...], dimension: int) -> None:
    """Either or both, of any sizes, each dimension with its own range."""
    rng = np.random.default_rng(seed)
    spread = rng.integers(0, 300, dimension)
    books = {n: rng.integers(-spread, spread + 1, (int(rng.integers(1, 40)), dimension)) for n in numbers}
    assert same(unpack_codebooks(pack_codebooks(books)), books)


def test_the_largest_books_come_back() -> None:
    """4096 codewords of 64 dimensions, twice."""
    rng = np.random.default_rng(1)
    books = {n: rng.integers(-(1 << 15), 1 << 15, (MAX_CODEWORDS, MAX_LATENT)) for n in (0, 1)}
    assert same(unpack_codebooks(pack_codebooks(books)), books)


def payload(dimension: int = 1, books: int = 1, number: int = 0, size: int = 3, column: bytes = b"\0\2\x1b\0") -> bytes:
    """One book of 3 codewords of 1 dimension; by default low 0, width 2, values 0, 1, 2 packed as 00 01 10."""
    return unsigned_varint(dimension) + unsigned_varint(books) + bytes([number]) + unsigned_varint(size) + column


GOOD = b"\0\2\x18"


def test_the_hand_made_book_is_readable() -> None:
    """Most significant bit first, padded to a byte: the layout, not only its inverse."""
    assert unpack_codebooks(payload(column=GOOD))[0].tolist() == [[0], [1], [2]]
    assert pack_codebooks({0: np.array([[0], [1], [2]])}) == payload(column=GOOD)


BAD = {
    "no book": (unsigned_varint(1) + unsigned_varint(0), "bad-codebook"),
    "no dimension": (payload(dimension=0, column=b""), "bad-codebook"),
    "unknown book": (payload(number=2, column=GOOD), "bad-codebook"),
    "no codeword": (payload(size=0, column=b"\0\0"), "bad-codebook"),
    "same book twice": (payload(books=2, column=GOOD) + b"\0\x03" + GOOD, "bad-codebook"),
    "books descend": (payload(books=2, number=1, column=GOOD) + b"\0\x03" + GOOD, "bad-codebook"),
    "width 17": (payload(column=b"\0\x11" + bytes(7)), "bad-codebook"),
    "padding": (payload(column=b"\0\2\x19"), "bad-codebook"),
    "minimum of 18 bits": (payload(column=signed_varint(1 << 16) + b"\0"), "bad-varint"),
    "short": (payload(column=b"\0\2"), "payload-short"),
    "long": (payload(column=GOOD + b"\0"), "payload-long"),
}


@pytest.mark.parametrize("name", BAD)
def test_payloads_that_break_the_rule_are_refused(name: str) -> None:
    """Each rule of SPEC §7.8 by one payload."""
    data, refusal = BAD[name]
    refuses(refusal, lambda: unpack_codebooks(data))


@pytest.mark.parametrize(
    "data", [payload(dimension=MAX_LATENT + 1), payload(books=3), payload(size=MAX_CODEWORDS + 1)]
)
def test_numbers_above_the_maxima_pass_a_limit(data: bytes) -> None:
    """Refused before anything is read or allocated."""
    with pytest.raises(LimitExceeded):
        unpack_codebooks(data)


@settings(max_examples=300)
@given(st.binary(max_size=40))
def test_garbage_raises_only_our_errors(data: bytes) -> None:
    """And what is accepted is of the declared shape."""
    try:
        books = unpack_codebooks(data)
    except ScarError:
        return
    assert all(words.ndim == 2 and words.dtype == np.int64 for words in books.values())


@given(st.integers(0, 2**32 - 1))
def test_latents_are_sums_of_the_stages_received(seed: int) -> None:
    """Stage 1 from the coarse book, later ones from the residual, none at all for 0 stages."""
    rng = np.random.default_rng(seed)
    books = Codebooks(rng.integers(-60, 60, (9, 4)), rng.integers(-9, 9, (5, 4)))
    stages, indices = rng.integers(0, 4, 12), rng.integers(0, 5, (12, 3))
    wanted = np.zeros((12, 4), np.int64)
    for row in range(12):
        for stage in range(stages[row]):
            wanted[row] += (books.residual if stage else books.coarse)[indices[row, stage]]
    assert np.array_equal(books.latents(indices, stages), wanted)
    assert (books.dimension, books.sizes) == (4, (9, 5))
