"""The invalid vectors of TABLES, CODEBOOKS, DECODER_MLP and SCENE_MLP blocks (SPEC §7.8, §7.9, §8.3)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from conformance.faults.table_records import Record, Records, number, packed, unpacked, with_tables
from conformance.scenes.cases import Fault
from conformance.surgery.edit import append, cut
from conformance.surgery.files import (
    block_of,
    blocks_of,
    changed,
    content_of,
    copied,
    rebuilt,
    reframed,
    stored_frame,
    without,
)
from conformance.writer.fields import rice, svarint, varint
from conformance.writer.models import codebooks_block
from scarfmt.blocks.codebooks import unpack_codebooks
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockKind, Stream

_TABLE = "R-8.3-1", "bad-table"
_BOOK = "R-7.8-1", "bad-codebook"
_LAYERS = "R-7.9-1", "bad-mlp"
_SCENE = "R-7.9-4", "bad-mlp"
_LIMIT = "R-5.7-3", "count-limit"
_VARINT = "R-5.7-1", "bad-varint"
_SHORT, _LONG = ("R-5.7-2", "payload-short"), ("R-5.7-2", "payload-long")
_CONTENT_LIMIT = "R-5.8-2", "content-limit"
_MLP_BYTES = 16 << 20
_UNUSED = number(Stream.FRAMING, 0, 0, 0)
"""A key that names nothing, after all others."""


# ---------------------------------------------------------------------------------------------- TABLES


def table_faults(static: bytes) -> Iterator[Fault]:
    """Faults of a file with a TABLES block in layer 1. Faults that need a record of their own add an unused one at the
    end."""

    def records(change: Callable[[Records], Records]) -> bytes:
        return with_tables(static, 1, change)

    def last(*values: int, weights: tuple[int, ...] = (1,)) -> bytes:
        return records(lambda r: [*r, Record(_UNUSED, values, weights)])

    def content(change: Callable[[bytes], bytes]) -> bytes:
        return changed(static, BlockKind.TABLES, 1, change)

    top = (1 << 31) - 1
    yield "keys-equal", "two tables of one key", *_TABLE, records(lambda r: [r[0], *r])
    yield "keys-descend", "tables whose keys do not ascend", *_TABLE, records(lambda r: [r[1], r[0], *r[2:]])
    yield "table-empty", "a table of no symbols", *_TABLE, _with_record(static, varint(0) + svarint(0))
    yield ("alphabet-first-34-bits", "an alphabet from 2^32: a number of 34 bits", *_VARINT, last(1 << 32))
    yield "alphabet-first-low", "an alphabet from -2^31", *_TABLE, last(-top - 1)
    yield "alphabet-first-high", "an alphabet from 2^31", *_TABLE, last(top + 1)
    yield "alphabet-last-high", "an alphabet up to 2^31", *_TABLE, last(0, top + 1, weights=(1, 1))
    yield ("alphabet-wide-gap", "a gap of 2^32 - 1, to far above 2^31", *_TABLE, last(-top, 1 + top, weights=(1, 1)))
    def cut_after(record: Record) -> bytes:
        return content(lambda c: varint(c[0] + 1) + c[1:] + record.packed()[:-1])

    yield ("alphabet-high-cut", "an alphabet that leaves 2^31 - 1, and then ends too early", *_TABLE,
           cut_after(Record(_UNUSED, (top, top + 1), (1, 1))))
    yield ("weight-zero-cut", "a weight of 0, and then the block ends too early", *_TABLE,
           cut_after(Record(_UNUSED, (0, 1, 2), (1, 0, 1))))
    yield "key-33-bits", "a key of 33 bits", *_VARINT, records(lambda r: [*r, Record(1 << 32, (0,), (1,))])
    yield "weight-25-bits", "a weight of 2^24", *_VARINT, last(0, weights=(1 << 24,))
    yield ("weight-two-bytes", "a weight of 1 in two bytes", *_VARINT,
           content(lambda c: varint(c[0] + 1) + c[1:] + Record(_UNUSED, (0,), (1,)).packed()[:-1] + b"\x81\0"))
    yield "table-4097", "a table of 4097 symbols", *_LIMIT, last(*range(4097), weights=(1,) * 4097)
    yield "tables-65537", "65537 tables", *_LIMIT, content(lambda c: varint(65537) + c[1:])
    yield "tables-short", "tables that end early", *_SHORT, content(cut)
    yield "tables-long", "a byte after the last table", *_LONG, content(append())


def _with_record(data: bytes, body: bytes) -> bytes:
    """The file with a table more, whose record after the key is `body`."""

    def edit(content: bytes) -> bytes:
        records = unpacked(content)
        return varint(len(records) + 1) + packed(records)[1:] + varint(_UNUSED) + body

    return changed(data, BlockKind.TABLES, 1, edit, 1)


# ---------------------------------------------------------------------------------------------- CODEBOOKS


def codebook_faults(static: bytes, refined: bytes) -> Iterator[Fault]:
    """Faults of a file with codebook 0 only, and of one that first needs codebook 1 in layer 2."""
    payload = block_of(static, BlockKind.CODEBOOKS).payload
    words = unpack_codebooks(payload)[0]
    size, dimension = words.shape
    columns = b"".join(rice(column.tolist()) for column in words.T)

    def block(head: tuple[int, ...], tail: bytes = columns, growth: int = 0) -> bytes:
        return changed(static, BlockKind.CODEBOOKS, 1, lambda _: b"".join(map(varint, head)) + tail, growth)

    yield "book-none", "a CODEBOOKS block without a book", *_BOOK, block((dimension, 0), b"", -1)
    yield "book-no-dimension", "a codebook of no dimensions", *_BOOK, block((0, 1, 0, size), b"")
    yield "book-no-codeword", "a codebook of no codewords", *_BOOK, block((dimension, 1, 0, 0), b"\0" * dimension)
    yield "book-two", "a codebook of the number 2", *_BOOK, block((dimension, 1, 2, size))
    twice = columns + bytes([0]) + varint(size) + columns
    yield "books-equal", "codebook 0 twice", *_BOOK, block((dimension, 2, 0, size), twice, 1)
    yield "codeword-low", "a component of -65536", *_BOOK, _with_component(static, -65536)
    yield ("codeword-lowest", "a component of -2^31, whose magnitude 32 bits do not hold", *_BOOK,
           _with_component(static, -(1 << 31)))
    yield "books-three", "three codebooks", *_LIMIT, block((dimension, 3, 0, size), columns, 2)
    yield "book-dimensions-65", "65 dimensions", *_LIMIT, block((65, 1, 0, size))
    yield "book-4097", "4097 codewords", *_LIMIT, block((dimension, 1, 0, 4097))
    yield ("books-short", "a CODEBOOKS block that ends in its last dimension", *_SHORT,
           changed(static, BlockKind.CODEBOOKS, 1, cut))
    yield "books-long", "a byte after the last codebook", *_LONG, changed(static, BlockKind.CODEBOOKS, 1, append())
    yield from _book_places(static, refined, words)


def _book_places(static: bytes, refined: bytes, words: np.ndarray) -> Iterator[Fault]:
    rule = "R-7.8-2"
    one = codebooks_block({1: words})
    yield ("book-other", "codebook 1 where codebook 0 is first needed", rule, "bad-codebook",
           changed(static, BlockKind.CODEBOOKS, 1, lambda _: one))
    both = codebooks_block({0: words, 1: words})
    yield ("book-early", "codebook 1 beside codebook 0, but no layer needs it", rule, "bad-codebook",
           changed(static, BlockKind.CODEBOOKS, 1, lambda _: both, 1))
    yield ("book-late", "codebook 1 is first needed in layer 2, but absent", rule, "missing-block",
           without(refined, BlockKind.CODEBOOKS, 2))
    later = block_of(refined, BlockKind.CODEBOOKS, 2).payload
    first = block_of(refined, BlockKind.CODEBOOKS, 1).payload
    again = codebooks_block({**unpack_codebooks(first), **unpack_codebooks(later)})
    yield ("book-again", "codebook 0 again, beside codebook 1 in the layer that first needs that", rule, "bad-codebook",
           changed(refined, BlockKind.CODEBOOKS, 2, lambda _: again, 1))
    narrow = codebooks_block({0: words[:, :1]})
    yield ("book-narrow", "codewords of a dimension less than DECODER_MLP takes", "R-7.8-3", "bad-mlp",
           changed(static, BlockKind.CODEBOOKS, 1, lambda _: narrow))
    wide = {n: np.pad(book, ((0, 0), (0, 1))) for n, book in unpack_codebooks(later).items()}
    yield ("book-wide", "codebook 1 of a dimension more than codebook 0", "R-7.8-3", "bad-mlp",
           changed(refined, BlockKind.CODEBOOKS, 2, lambda _: codebooks_block(wide)))


def _with_component(data: bytes, value: int) -> bytes:
    def edit(payload: bytes) -> bytes:
        books = unpack_codebooks(payload)
        books[0][1, -1] = value
        return codebooks_block(books)

    return changed(data, BlockKind.CODEBOOKS, 1, edit)


# ---------------------------------------------------------------------------------------------- networks


@dataclass(frozen=True)
class RawLayer:
    """A layer of a network as its bytes say, right or not; weights are 1 or as many as `weights`."""

    rows: int
    columns: int
    width: int = 1
    scale: float = 1.0
    bias: float = 0.0

    def packed(self) -> bytes:
        """The bytes: as many weights, scales and biases as rows and columns make."""
        head = varint(self.rows) + varint(self.columns) + bytes([self.width])
        numbers = struct.pack("<f", self.scale) * self.rows + struct.pack("<f", self.bias) * self.rows
        return head + bytes([1] + [0] * (self.width - 1)) * (self.rows * self.columns) + numbers


RawNetwork = tuple[RawLayer, ...]


def _raw(*networks: RawNetwork) -> bytes:
    return varint(len(networks)) + b"".join(
        varint(len(layers)) + b"".join(layer.packed() for layer in layers) for layers in networks
    )


def decoder_faults(static: bytes, coloured: bytes) -> Iterator[Fault]:
    """Faults of a file of degree 1 and two latent dimensions without COLOUR, and of one of degree 2 and five with
    it."""
    kind, good = BlockKind.DECODER_MLP, RawLayer(12, 2)

    def decoder(*networks: RawNetwork) -> bytes:
        return changed(static, kind, 1, lambda _: _raw(*networks), len(networks) - 1)

    def content(new: bytes, growth: int = 0) -> bytes:
        return changed(static, kind, 1, lambda _: new, growth)

    first = RawLayer(3, 2)
    yield "mlp-no-layer", "a network of no layers", *_LAYERS, decoder(())
    yield "mlp-no-rows", "a layer of no rows", *_LAYERS, decoder((RawLayer(0, 2), good))
    yield "mlp-no-columns", "a layer of no columns", *_LAYERS, decoder((RawLayer(12, 0),))
    yield "mlp-width-0", "weights of no bytes", *_LAYERS, content(_with_width(good, 0))
    yield "mlp-width-3", "weights of three bytes", *_LAYERS, decoder((replace(good, width=3),))
    yield "mlp-chain", "four columns after three rows", *_LAYERS, decoder((first, RawLayer(12, 4)))
    for name, value in (("nan", np.nan), ("infinite", -np.inf)):
        yield f"mlp-scale-{name}", f"a scale that is {name}", *_LAYERS, decoder((replace(good, scale=value),))
        yield f"mlp-bias-{name}", f"a bias that is {name}", *_LAYERS, decoder((replace(good, bias=value),))
    yield "mlp-two-networks", "two networks in DECODER_MLP", "R-7.9-2", "bad-mlp", decoder((good,), (good,))
    yield "mlp-no-network", "no network in DECODER_MLP", "R-7.9-2", "bad-mlp", decoder()
    yield "mlp-absent", "a stage, but no DECODER_MLP", "R-7.9-2", "missing-block", without(static, kind, 1)
    yield "mlp-again", "a second DECODER_MLP", "R-7.9-2", "unexpected-block", copied(coloured, kind, 2)
    yield ("mlp-outputs", "no outputs for the coefficients of degree 0", "R-7.9-3", "bad-mlp",
           decoder((RawLayer(9, 2),)))
    yield ("mlp-outputs-colour", "outputs for the coefficients of degree 0, which COLOUR gives", "R-7.9-3", "bad-mlp",
           changed(coloured, kind, 1, lambda _: _raw((RawLayer(27, 5),))))
    yield "mlp-nine-networks", "nine networks", *_LIMIT, content(varint(9), 8)
    yield "mlp-five-layers", "five layers", *_LIMIT, content(bytes([1, 5]))
    yield "mlp-1025-rows", "1025 rows", *_LIMIT, content(bytes([1, 1]) + varint(1025) + bytes([2, 1]))
    yield "mlp-1025-columns", "1025 columns", *_LIMIT, content(bytes([1, 1, 12]) + varint(1025) + b"\1")
    yield "mlp-short", "a network that ends early", *_SHORT, changed(static, kind, 1, cut)
    yield "mlp-long", "a byte after the network", *_LONG, changed(static, kind, 1, append())
    yield "mlp-content", "a frame that states 16 MiB and a byte", *_CONTENT_LIMIT, _stated(static, kind, _MLP_BYTES + 1)


def _with_width(layer: RawLayer, width: int) -> bytes:
    return bytes([1, 1, layer.rows, layer.columns, width]) + struct.pack("<f", 1.0) * (2 * layer.rows)


def _stated(data: bytes, kind: BlockKind, size: int) -> bytes:
    """The file with a frame of this content size, and hardly any content, in place of that of a block."""
    frame = bytes.fromhex("28b52ffd a0") + size.to_bytes(4, "little") + b"\1\0\0"
    return reframed(data, kind, lambda _: frame)


def idle_faults(static: bytes, bare: bytes) -> Iterator[Fault]:
    """Faults of a codebook and a DECODER_MLP that are put into a file that has neither stages nor LATENT."""
    for name, kind, rule in (("book", BlockKind.CODEBOOKS, "R-7.8-2"), ("mlp", BlockKind.DECODER_MLP, "R-7.9-2")):
        block = block_of(static, kind)
        yield (f"{name}-without-stages", f"{kind.name} in a file without stages or LATENT", rule, "unexpected-block",
               rebuilt(bare, [*blocks_of(bare), block]))


def scene_faults(anchors: bytes, explicit: bytes) -> Iterator[Fault]:
    """Faults of a file of the anchor profile of ten slots and four features, and of one of the explicit profile."""
    kind = BlockKind.SCENE_MLP

    def scene(*networks: RawNetwork) -> bytes:
        return changed(anchors, kind, 1, lambda _: _raw(*networks), len(networks) - 3)

    def two(outputs: int, inputs: int = 8) -> RawNetwork:
        return RawLayer(5, inputs), RawLayer(outputs, 5)

    opacity, covariance, colour = two(10), two(70), two(30)
    yield "scene-two", "two networks in SCENE_MLP", *_SCENE, scene(opacity, covariance)
    yield "scene-four", "four networks in SCENE_MLP", *_SCENE, scene(opacity, covariance, colour, colour)
    yield ("scene-one-layer", "an opacity network of one layer", *_SCENE,
           scene((RawLayer(10, 8),), covariance, colour))
    yield ("scene-three-layers", "a colour network of three layers", *_SCENE,
           scene(opacity, covariance, (RawLayer(5, 8), RawLayer(5, 5), RawLayer(30, 5))))
    yield "scene-order", "covariance and colour swapped", *_SCENE, scene(opacity, colour, covariance)
    yield "scene-outputs", "opacities of nine slots of ten", *_SCENE, scene(two(9), covariance, colour)
    yield "scene-inputs", "networks of D + 2 inputs", *_SCENE, scene(two(10, 6), two(70, 6), two(30, 6))
    yield "scene-inputs-wide", "networks of D + 5 inputs", *_SCENE, scene(two(10, 9), two(70, 9), two(30, 9))
    yield ("scene-inputs-mixed", "D + 4, D + 3 and D + 4 inputs", *_SCENE, scene(opacity, two(70, 7), colour))
    yield "scene-short", "SCENE_MLP ends early", *_SHORT, changed(anchors, kind, 1, cut)
    yield "scene-long", "a byte after the third network", *_LONG, changed(anchors, kind, 1, append())
    yield ("scene-content", "a SCENE_MLP frame that states 16 MiB and a byte", *_CONTENT_LIMIT,
           _stated(anchors, kind, _MLP_BYTES + 1))
    yield "scene-later", "a second SCENE_MLP, in layer 2", "R-7.9-4", "unexpected-block", copied(anchors, kind, 2)
    block = block_of(anchors, kind)
    idle = Block(kind, 1, stored_frame(content_of(block)), count=block.count)
    yield ("scene-explicit", "SCENE_MLP in the explicit profile", "R-7.9-4", "unexpected-block",
           rebuilt(explicit, [*blocks_of(explicit), idle]))
