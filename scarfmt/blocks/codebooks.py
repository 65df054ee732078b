"""CODEBOOKS block: the RVQ codewords first needed in a layer (SPEC §7.8; paper §3.2, dual codebook).

Each dimension has a number model of its own: trailing dimensions of a decorrelated latent hold small numbers.
"""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import I64
from scarfmt.blocks.declare import Check, Number, NumberRecord, Record, Repeat, Rule, Scope, build, read
from scarfmt.blocks.spec import BlockSpec, Writing
from scarfmt.container.registries import BlockKind
from scarfmt.entropy.numbers import Spend
from scarfmt.errors import Malformed
from scarfmt.scene.model import MAX_CODEWORDS, MAX_LATENT, first_layers

MAX_BOOKS = 2
MAX_VALUE = 65535

_DIMENSION = Record(
    "words" / Number("signed", times="size", by="index") * "in codeword order; index is the dimension",
    Rule(
        Check("R-7.8-1", "they are -65535..65535", "bad-codebook"),
        lambda at: int(np.abs(at["words"]).max()) <= MAX_VALUE,
        lambda at: Malformed("bad-codebook", f"a component beyond {MAX_VALUE} (SPEC §7.8)", field="codebooks"),
    ),
)

_BOOK = Record(
    "number" / Number(limit=255) * "0: stage 1; 1: all later stages",
    "size" / Number(limit=MAX_CODEWORDS) * "codewords",
    Rule(
        Check("R-7.8-1", "number is 0 or 1 and ascends, size is at least 1", "bad-codebook"),
        lambda at: _sound_head(at),
        lambda at: _bad(f"book {at['number']} of {at['size']} codewords"),
    ),
    "components" / Repeat("d", _DIMENSION),
)

CODEBOOKS = NumberRecord(
    "d" / Number(limit=MAX_LATENT) * "latent dimensions",
    Rule(
        Check("R-7.8-1", "d is at least 1", "bad-codebook"),
        lambda at: bool(at["d"]),
        lambda at: _bad("codewords of no dimensions"),
    ),
    "book_count" / Number(limit=MAX_BOOKS),
    Rule(
        Check("R-7.8-1", "book_count is at least 1", "bad-codebook"),
        lambda at: at["book_count"] > 0,
        lambda at: _bad("the block holds no codebook"),
    ),
    "books" / Repeat("book_count", _BOOK),
)


def _sound_head(at: Scope) -> bool:
    later = all(at["number"] > book["number"] for book in at["earlier"])
    return bool(at["number"] < MAX_BOOKS and later and at["size"])


def pack_codebooks(books: dict[int, I64]) -> bytes:
    """The payload of a CODEBOOKS block: `books` maps book number to (n, d) int64 codewords."""
    dimension = next(iter(books.values())).shape[1]
    fields = [
        {"number": number, "size": len(words), "components": [{"words": column} for column in words.T]}
        for number, words in sorted(books.items())
    ]
    return build(CODEBOOKS, {"d": dimension, "book_count": len(books), "books": fields})


def unpack_codebooks(payload: bytes, spend: Spend = lambda count: True) -> dict[int, I64]:
    """Codewords by book number, (n, d) int64 each.

    Raises:
        Malformed: ``bad-codebook`` for a payload that breaks SPEC §7.8.
    """
    books = read(CODEBOOKS, payload, "codebooks", spend=spend)["books"]
    return {book["number"]: np.stack([part["words"] for part in book["components"]], axis=1) for book in books}


def _bad(message: str) -> Malformed:
    return Malformed("bad-codebook", f"{message} (SPEC §7.8)", field="codebooks")


def _take(writing: Writing) -> dict[int, I64] | None:
    """The books first needed in a layer."""
    books, starts = writing.parts.codebooks, first_layers(writing.parts.model)
    if books is None:
        return None
    pairs = enumerate((books.coarse, books.residual))
    return {number: words for number, words in pairs if starts[number] == writing.layer} or None


SPEC = BlockSpec(
    kind=BlockKind.CODEBOOKS,
    section="7.8",
    declaration=CODEBOOKS,
    parse=lambda payload, reading: unpack_codebooks(payload, reading.spend),
    pack=pack_codebooks,
    taken=_take,
    count=len,
    elements="codebooks",
    layers=lambda model: set(first_layers(model)[:2]),
    required=True,
)
