"""Codebooks: every size of component, every refusal, and latents as plain sums."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.arrays import I64
from scarfmt.blocks.codebooks import MAX_VALUE, pack_codebooks, unpack_codebooks
from scarfmt.container.bytefields import unsigned_varint
from scarfmt.entropy.rice import pack_rice
from scarfmt.errors import LimitExceeded, ScarError
from scarfmt.scene.codebooks import MAX_CODEWORDS, MAX_LATENT, Codebooks
from tests.samples.codec_samples import refuses


def same(found: dict[int, I64], wanted: dict[int, I64]) -> bool:
    return sorted(found) == sorted(wanted) and all(np.array_equal(found[n], wanted[n]) for n in wanted)


@pytest.mark.parametrize("top", [0, 1, 2, 255, 4095, MAX_VALUE])
def test_every_range_comes_back(top: int) -> None:
    """With both ends of it, the largest allowed too; other dimensions stay near 0."""
    rng = np.random.default_rng(top)
    words = rng.integers(-1, 2, (37, 3))
    words[:, 1] = rng.integers(-top, top + 1, 37)
    words[:2, 1] = -top, top
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


# k = 1; quotients 0, 1, 0 as 0 10 0; low bits 0 0 1.
GOOD = bytes([1, 0b01000000, 0b00100000])


def payload(dimension: int = 1, books: int = 1, number: int = 0, size: int = 3, column: bytes = GOOD) -> bytes:
    """One book of 3 codewords of 1 dimension; by default 0, 1, -1."""
    return unsigned_varint(dimension) + unsigned_varint(books) + bytes([number]) + unsigned_varint(size) + column


def test_the_hand_made_book_is_readable() -> None:
    """The layout, not only its inverse: dimension by dimension, each in codeword order."""
    assert unpack_codebooks(payload())[0].tolist() == [[0], [1], [-1]]
    words = np.array([[0, 5], [1, 6], [-1, 7]])
    columns = pack_rice(np.array([0, 1, -1])) + pack_rice(np.array([5, 6, 7]))
    assert pack_codebooks({0: words}) == payload(dimension=2, column=columns)


BAD = {
    "no book": (unsigned_varint(1) + unsigned_varint(0), "bad-codebook"),
    "no dimension": (payload(dimension=0, column=b""), "bad-codebook"),
    "no dimension, and a cut": (unsigned_varint(0), "bad-codebook"),
    "no dimension of three books": (payload(dimension=0, books=3), "bad-codebook"),
    "unknown book": (payload(number=2), "bad-codebook"),
    "no codeword": (payload(size=0, column=b"\0\0"), "bad-codebook"),
    "same book twice": (payload(books=2) + b"\0\x03" + GOOD, "bad-codebook"),
    "books descend": (payload(books=2, number=1) + b"\0\x03" + GOOD, "bad-codebook"),
    "a component of 65536": (payload(size=1, column=pack_rice(np.array([MAX_VALUE + 1]))), "bad-codebook"),
    "a component of -65536": (payload(size=1, column=pack_rice(np.array([-MAX_VALUE - 1]))), "bad-codebook"),
    "the most negative number": (payload(size=1, column=b"\x1f\x80" + b"\xff" * 3 + b"\xfe"), "bad-codebook"),
    "large, then short": (payload(2, column=pack_rice(np.array([0, 0, MAX_VALUE + 1]))), "bad-codebook"),
    "parameter": (payload(column=b"\x20" + bytes(13)), "bad-rice"),
    "short": (payload(column=GOOD[:2]), "payload-short"),
    "long": (payload(column=GOOD + b"\0"), "payload-long"),
}


@pytest.mark.parametrize("name", BAD)
def test_payloads_that_break_the_rule_are_refused(name: str) -> None:
    """Each rule of SPEC §7.8 by one payload."""
    data, refusal = BAD[name]
    refuses(refusal, lambda: unpack_codebooks(data))


@pytest.mark.parametrize("data", [payload(dimension=MAX_LATENT + 1), payload(books=3), payload(size=MAX_CODEWORDS + 1)])
def test_numbers_above_the_maxima_pass_a_limit(data: bytes) -> None:
    """Refused before anything is read or allocated."""
    with pytest.raises(LimitExceeded):
        unpack_codebooks(data)


@settings(max_examples=300)
@given(st.binary(max_size=40))
def test_garbage_raises_only_our_errors(data: bytes) -> None:
    """Any bytes give a result of the declared shape or a refusal."""
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
