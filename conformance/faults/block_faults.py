"""The invalid vectors of CODEBOOKS, DECODER_MLP and SCENE_MLP blocks (SPEC §7.8, §7.9)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from conformance.scenes.cases import Fault
from conformance.surgery.edit import renumber
from conformance.surgery.files import (
    block_of,
    blocks_of,
    change_block,
    change_numbers,
    copy_block,
    numbers_of,
    rebuilt,
    without,
)
from conformance.writer.numbers import numbers_block
from conformance.writer.tables import fold
from scarfmt.blocks.codebooks import pack_codebooks, unpack_codebooks
from scarfmt.blocks.mlp import Linear, QuantisedMlp, pack_networks
from scarfmt.container.schema import BlockKind

_BOOK = "R-7.8-1", "bad-codebook"
_LAYERS = "R-7.9-1", "bad-mlp"
_SCENE = "R-7.9-4", "bad-mlp"
_LIMIT = "R-8.5-4", "count-limit"


# ---------------------------------------------------------------------------------------------- CODEBOOKS


def codebook_faults(static: bytes, refined: bytes) -> Iterator[Fault]:
    """Faults of a file with codebook 0 only, and of one that first needs codebook 1 in layer 2."""
    kind, words = BlockKind.CODEBOOKS, unpack_codebooks(block_of(static, BlockKind.CODEBOOKS).payload)[0]
    for name, what, rule, field, value, growth in (
        ("book-none", "a CODEBOOKS block without a book", _BOOK, "book_count", 0, -1),
        ("book-no-dimension", "a codebook of no dimensions", _BOOK, "d", 0, 0),
        ("book-no-codeword", "a codebook of no codewords", _BOOK, "size", 0, 0),
        ("book-two", "a codebook of the number 2", _BOOK, "number", 2, 0),
        ("book-256", "a codebook of the number 256", _LIMIT, "number", 256, 0),
        ("books-three", "three codebooks", _LIMIT, "book_count", 3, 2),
        ("book-dimensions-65", "65 dimensions", _LIMIT, "d", 65, 0),
        ("book-4097", "4097 codewords", _LIMIT, "size", 4097, 0),
        ("codeword-low", "a component of -65536", _BOOK, "words", fold(-65536), 0),
        ("codeword-highest", "a component of 2^31 - 1", _BOOK, "words", (1 << 32) - 2, 0),
    ):
        yield name, what, *rule, change_numbers(static, kind, renumber((field, value)), growth)
    twice = change_numbers(static, kind, lambda n: [n[0], (n[1][0], 2), *n[2:], *n[2:]], 1)
    yield "books-equal", "codebook 0 twice", *_BOOK, twice
    yield from _book_places(static, refined, words)


def _book_places(static: bytes, refined: bytes, words: np.ndarray) -> Iterator[Fault]:
    rule = "R-7.8-2"
    one = pack_codebooks({1: words})
    yield ("book-other", "codebook 1 where codebook 0 is first needed", rule, "bad-codebook",
           change_block(static, BlockKind.CODEBOOKS, 1, lambda _: one))
    both = pack_codebooks({0: words, 1: words})
    yield ("book-early", "codebook 1 beside codebook 0, but no layer needs it", rule, "bad-codebook",
           change_block(static, BlockKind.CODEBOOKS, 1, lambda _: both, 1))
    yield ("book-late", "codebook 1 is first needed in layer 2, but absent", rule, "missing-block",
           without(refined, BlockKind.CODEBOOKS, 2))
    deep = change_block(refined, BlockKind.CODEBOOKS, 2, lambda payload: numbers_block(
        renumber(("d", 65))(numbers_of(payload, BlockKind.CODEBOOKS))))
    yield ("book-other-wide", "codebook 1 in layer 1 before 65 dimensions in layer 2", f"{rule} R-12.2-1",
           "bad-codebook", change_numbers(deep, BlockKind.CODEBOOKS, renumber(("number", 1))))
    later = block_of(refined, BlockKind.CODEBOOKS, 2).payload
    first = block_of(refined, BlockKind.CODEBOOKS, 1).payload
    again = pack_codebooks({**unpack_codebooks(first), **unpack_codebooks(later)})
    yield ("book-again", "codebook 0 again, beside codebook 1 in the layer that first needs that", rule, "bad-codebook",
           change_block(refined, BlockKind.CODEBOOKS, 2, lambda _: again, 1))
    narrow = pack_codebooks({0: words[:, :1]})
    yield ("book-narrow", "codewords of a dimension less than DECODER_MLP takes", "R-7.8-3", "bad-mlp",
           change_block(static, BlockKind.CODEBOOKS, 1, lambda _: narrow))
    wide = {n: np.pad(book, ((0, 0), (0, 1))) for n, book in unpack_codebooks(later).items()}
    yield ("book-wide", "codebook 1 of a dimension more than codebook 0", "R-7.8-3", "bad-mlp",
           change_block(refined, BlockKind.CODEBOOKS, 2, lambda _: pack_codebooks(wide)))


# ---------------------------------------------------------------------------------------------- networks


Layers = tuple[Linear, ...]


def _layer(rows: int, columns: int, weight: int = 1, scale: float = 1.0, bias: float = 0.0) -> Linear:
    """A layer of equal weights, scales and biases, right or not."""
    weights: Any = np.full((rows, columns), weight)
    return Linear(weights, np.full(rows, scale, np.float32), np.full(rows, bias, np.float32))


def _networks(*networks: Layers) -> bytes:
    return pack_networks(tuple(map(QuantisedMlp, networks)))


def decoder_faults(static: bytes, coloured: bytes) -> Iterator[Fault]:
    """Faults of a file of degree 1 and two latent dimensions without COLOUR, and of one of degree 2 and five with
    it."""
    kind, good = BlockKind.DECODER_MLP, _layer(12, 2)

    def decoder(*networks: Layers) -> bytes:
        return change_block(static, kind, 1, lambda _: _networks(*networks), len(networks) - 1)

    yield "mlp-no-layer", "a network of no layers", *_LAYERS, decoder(())
    yield "mlp-no-rows", "a layer of no rows", *_LAYERS, decoder((_layer(0, 2), good))
    yield "mlp-no-columns", "a layer of no columns", *_LAYERS, decoder((_layer(12, 0),))
    yield "mlp-chain", "four columns after three rows", *_LAYERS, decoder((_layer(3, 2), _layer(12, 4)))
    for name, weight in (("high", 1 << 15), ("low", -(1 << 15) - 1)):
        yield f"mlp-weight-{name}", f"weights of {weight}", *_LAYERS, decoder((_layer(12, 2, weight),))
    for name, value in (("nan", np.nan), ("infinite", -np.inf)):
        yield f"mlp-scale-{name}", f"a scale that is {name}", *_LAYERS, decoder((_layer(12, 2, scale=value),))
        yield f"mlp-bias-{name}", f"a bias that is {name}", *_LAYERS, decoder((_layer(12, 2, bias=value),))
    yield "mlp-two-networks", "two networks in DECODER_MLP", "R-7.9-2", "bad-mlp", decoder((good,), (good,))
    yield "mlp-absent", "a stage, but no DECODER_MLP", "R-7.9-2", "missing-block", without(static, kind, 1)
    yield "mlp-again", "a second DECODER_MLP", "R-7.9-2", "unexpected-block", copy_block(coloured, kind, 2)
    yield ("mlp-outputs", "no outputs for the coefficients of degree 0", "R-7.9-3", "bad-mlp", decoder((_layer(9, 2),)))
    yield ("mlp-outputs-colour", "outputs for the coefficients of degree 0, which COLOUR gives", "R-7.9-3", "bad-mlp",
           change_block(coloured, kind, 1, lambda _: _networks((_layer(27, 5),))))
    yield "mlp-nine-networks", "nine networks", *_LIMIT, decoder(*[(good,)] * 9)
    yield "mlp-five-layers", "five layers", *_LIMIT, decoder((_layer(2, 2),) * 4 + (good,))
    yield "mlp-1025-rows", "1025 rows", *_LIMIT, decoder((_layer(1025, 2), _layer(12, 1025)))
    yield "mlp-1025-columns", "1025 columns", *_LIMIT, decoder((_layer(12, 1025),))


def idle_faults(static: bytes, bare: bytes) -> Iterator[Fault]:
    """Faults of a codebook and a DECODER_MLP that are put into a file that has neither stages nor LATENT."""
    for name, kind, rule in (("book", BlockKind.CODEBOOKS, "R-7.8-2"), ("mlp", BlockKind.DECODER_MLP, "R-7.9-2")):
        block = block_of(static, kind)
        yield (f"{name}-without-stages", f"{kind.name} in a file without stages or LATENT", rule, "unexpected-block",
               rebuilt(bare, [*blocks_of(bare), block]))


def scene_faults(anchors: bytes, explicit: bytes) -> Iterator[Fault]:
    """Faults of a file of the anchor profile of ten slots and four features, and of one of the explicit profile."""
    kind = BlockKind.SCENE_MLP

    def scene(*networks: Layers) -> bytes:
        return change_block(anchors, kind, 1, lambda _: _networks(*networks), len(networks) - 3)

    def two(outputs: int, inputs: int = 8) -> Layers:
        return _layer(5, inputs), _layer(outputs, 5)

    opacity, covariance, colour = two(10), two(70), two(30)
    yield "scene-two", "two networks in SCENE_MLP", *_SCENE, scene(opacity, covariance)
    yield "scene-four", "four networks in SCENE_MLP", *_SCENE, scene(opacity, covariance, colour, colour)
    yield ("scene-one-layer", "an opacity network of one layer", *_SCENE, scene((_layer(10, 8),), covariance, colour))
    yield ("scene-three-layers", "a colour network of three layers", *_SCENE,
           scene(opacity, covariance, (_layer(5, 8), _layer(5, 5), _layer(30, 5))))
    yield "scene-order", "covariance and colour swapped", *_SCENE, scene(opacity, colour, covariance)
    yield "scene-outputs", "opacities of nine slots of ten", *_SCENE, scene(two(9), covariance, colour)
    yield "scene-inputs", "networks of D + 2 inputs", *_SCENE, scene(two(10, 6), two(70, 6), two(30, 6))
    yield "scene-inputs-wide", "networks of D + 5 inputs", *_SCENE, scene(two(10, 9), two(70, 9), two(30, 9))
    yield ("scene-inputs-mixed", "D + 4, D + 3 and D + 4 inputs", *_SCENE, scene(opacity, two(70, 7), colour))
    yield "scene-later", "a second SCENE_MLP, in layer 2", "R-7.9-4", "unexpected-block", copy_block(anchors, kind, 2)
    yield ("scene-explicit", "SCENE_MLP in the explicit profile", "R-7.9-4", "unexpected-block",
           rebuilt(explicit, [*blocks_of(explicit), block_of(anchors, kind)]))
