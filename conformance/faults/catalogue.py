"""The invalid vectors: valid files with exactly one rule of SPEC.md broken, all other checksums right."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

from conformance.faults.block_faults import codebook_faults, decoder_faults, idle_faults, scene_faults
from conformance.faults.grid_faults import grid_faults
from conformance.faults.layer_faults import layer_faults
from conformance.faults.network_faults import network_faults, place_faults
from conformance.faults.number_faults import number_faults, table_faults
from conformance.faults.predictor_faults import predictor_faults
from conformance.scenes.cases import Case, Fault, refuse
from conformance.surgery.edit import append, plus, renumber, replace_bytes, splice
from conformance.surgery.files import (
    block_of,
    blocks_of,
    change_block,
    change_numbers,
    copy_block,
    rebuilt,
    substream_bytes,
    with_substream,
    without,
)
from conformance.surgery.parts import change_rows, flip_bits, header_with
from scarfmt.blocks.codebooks import MAX_VALUE, pack_codebooks, unpack_codebooks
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockKind, Stream

Files = dict[str, tuple[bytes, QuantisedScene]]


def invalid_files(files: Files) -> Iterator[Case]:
    """Files that break a rule of each part of the format.

    Args:
        files: valid vectors by name, with their scenes.
    """
    data = {name: file for name, (file, _) in files.items()}
    base, small = data["explicit-core"], data["sh-from-network"]
    yield from (refuse(*fault, stage="container") for fault in _front_faults(base))
    yield from (refuse(*fault, stage="tiles") for fault in _block_faults(base))
    models = _model_faults(base, data["explicit-refined"], data["anchors"])
    yield from (refuse(*fault, stage="models") for fault in models)
    yield from (refuse(*fault, stage="tiles") for fault in _symbol_faults(base, small))
    yield from _block_by_block(files, data)


def _block_by_block(files: Files, data: dict[str, bytes]) -> Iterator[Case]:
    """Faults of each kind of block that belongs to no tile."""
    static = files["sh-from-network"]
    for faults in (
        layer_faults(files["explicit-core"], files["explicit-refined"], files["anchors-32-slots"], static,
                     data["predictors"], data["predictors-alone"]),
        number_faults(data["explicit-core"], static[0], data["anchors"], data["index-equal"],
                      data["predictors"]),
        table_faults(data["explicit-core"]),
        codebook_faults(static[0], data["explicit-refined"]),
        decoder_faults(static[0], data["explicit-refined"]),
        idle_faults(static[0], data["duplicates"]),
        scene_faults(data["anchors"], data["explicit-refined"]),
        network_faults(data["index-deep"], data["index-plain"], data["index-equal"], data["index-edge"]),
        place_faults(static[0], data["index-plain"], data["index-grid"], data["index-grid-small"], data["index-modes"]),
        grid_faults(data["index-grid-small"]),
        predictor_faults(data["predictors"], data["predictors-edge"], data["predictors-alone"]),
    ):
        yield from (refuse(*fault, stage="models") for fault in faults)


def _front_faults(base: bytes) -> Iterator[Fault]:
    text = base.replace(b"\r\n", b"\n", 1)
    yield "text-mode", "CR LF of the signature became LF", "R-5.1-1", "damaged-signature", text
    yield "other-format", "a PLY file", "R-5.1-1", "bad-signature", b"ply\nformat ascii 1.0\nend_header\n"
    yield ("later-version", "version 0.4; the CRC is wrong too", "R-5.1-2", "unsupported-version",
           splice(10, b"\4")(base))
    yield "header-bit", "one bit of the header is flipped", "R-5.2-4", "header-crc-mismatch", flip_bits(base, 60)
    yield ("page-bits-17", "pages of 2^17 tiles", "R-5.2-14", "bad-page-bits",
           change_rows(base, header_with(page_bits=17)))
    yield ("slots-two", "two slots in the explicit profile", "R-5.2-10", "bad-slots",
           change_rows(base, header_with(slots=2)))
    yield ("gaussians-missing", "fewer Gaussians than anchors", "R-5.3-2", "layer-counts",
           change_rows(base, {"layers.0.gaussian_count": plus(-1)}))
    yield "trailing-byte", "one byte too many", "R-5.3-7", "trailing-bytes", base + b"\0"
    yield "cut", "the last byte is missing", "R-5.3-8", "truncated-file", base[:-1]
    yield ("unknown-critical", "the last block has an unknown critical kind", "R-5.4-16", "unknown-critical-block",
           _unknown_kind(base))


def _unknown_kind(base: bytes) -> bytes:
    blocks = blocks_of(base)
    return rebuilt(base, [*blocks, Block(20, blocks[-1].layer, b"?", flags=1)])


def _block_faults(base: bytes) -> Iterator[Fault]:
    _, past = substream_bytes(base, Stream.SCALE, 1)
    yield ("block-bit", "one bit of a TILE block is flipped", "R-5.6-1", "crc-mismatch",
           flip_bits(base, past - 1, 0x40))
    yield ("substream-crc", "the CRC of a sub-stream is wrong, that of the block is right", "R-7.1-5", "crc-mismatch",
           change_block(base, BlockKind.TILE, 1, _wrong_crc))
    yield ("idle-substream", "a sub-stream of a kind the layer does not code", "R-7.1-4", "bad-substream-table",
           with_substream(base, 1, Stream.MASKS, replace_bytes(bytes([1, 0, 0, 0]))))


def _wrong_crc(payload: bytes) -> bytes:
    table = 1 + 9 * payload[0]
    out = bytearray(payload)
    out[table - 1] ^= 1
    out[table : table + 4] = zlib.crc32(out[:table]).to_bytes(4, "little")
    return bytes(out)


def _model_faults(base: bytes, staged: bytes, anchors: bytes) -> Iterator[Fault]:
    yield ("channels-descend", "POSITION_RESIDUAL became COLOUR, before SCALE", "R-6.4-1", "bad-channel",
           change_numbers(base, BlockKind.LAYER, renumber(("stream", Stream.COLOUR))))
    yield "no-layer-block", "layer 3 has no LAYER block", "R-6.5-1", "missing-block", without(base, BlockKind.LAYER, 3)
    yield ("no-codebook", "a stage without its codebook", "R-7.8-2", "missing-block",
           without(staged, BlockKind.CODEBOOKS, 1))
    yield ("idle-codebook", "a codebook that no layer first needs", "R-7.8-2", "unexpected-block",
           copy_block(staged, BlockKind.CODEBOOKS, 3))
    yield ("no-scene-networks", "the anchor profile without SCENE_MLP", "R-7.9-4", "bad-mlp",
           without(anchors, BlockKind.SCENE_MLP, 1))
    books = unpack_codebooks(block_of(staged, BlockKind.CODEBOOKS).payload)
    books[0][0, 0] = MAX_VALUE + 1
    yield ("codeword-large", "a component of 65536", "R-7.8-1", "bad-codebook",
           change_block(staged, BlockKind.CODEBOOKS, 1, lambda _: pack_codebooks(books)))


def _symbol_faults(base: bytes, small: bytes) -> Iterator[Fault]:
    yield "no-table", "a group without a table", "R-8.3-3", "missing-table", without(base, BlockKind.TABLES, 1)
    yield ("stream-flipped", "a rANS stream that does not end in the empty state", "R-8.2-2", "rans-seal",
           with_substream(small, 1, Stream.SCALE, lambda part: bytes([1, 0, 0, 0]) + part))
    yield ("last-word-zero", "the last word of a rANS stream is 0", "R-8.2-1", "rans-last-word",
           with_substream(small, 1, Stream.SCALE, append(bytes(4))))
    yield "small-book", "an index without a codeword", "R-7.6-1", "bad-index", _small_book(small)


def _small_book(data: bytes) -> bytes:
    def shorten(payload: bytes) -> bytes:
        return pack_codebooks({0: unpack_codebooks(payload)[0][:2]})

    return change_block(data, BlockKind.CODEBOOKS, 1, shorten)
