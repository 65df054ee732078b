"""Damage to blocks in a container that stays sound: blocks moved, payloads changed, frames and models forged (SPEC §7).

Lengths, offsets and the checksums of directory and header are always right here, so that the block itself is reached;
with :func:`~fuzz.testing.mutators.mutate` the checksums inside TILE blocks are right in half of the cases.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from random import Random

import zstandard

from fuzz.testing.field_mutators import SPECIAL_NUMBERS, NotHere, special_number
from fuzz.testing.parts import RECORD, RECORD_SIZE, Part, Parts, is_file, put_together, records, take_apart
from scarfmt.container.bytefields import signed_varint, unsigned_varint
from scarfmt.container.schema import NO_TILE, BlockKind

FRAMES = (BlockKind.TABLES, BlockKind.DECODER_MLP, BlockKind.SCENE_MLP)
MODELS = (BlockKind.LAYER, BlockKind.CODEBOOKS, BlockKind.HASH_GRID, BlockKind.ENTROPY_NETWORK, BlockKind.PREDICTORS)
MAX_CONTENT = 1 << 20
_RAW_BLOCK = (1 << 17) - 1
_COUNTS = (0, 1, 2, 3, 16, 17, 255, 1000, 65535, 65536, 65537)


def parts_of(data: bytes) -> Parts:
    """The parts of a file.

    Raises:
        NotHere: it is damaged, by another operator.
    """
    if not is_file(data):
        raise NotHere
    try:
        return take_apart(data)
    except ValueError as error:
        raise NotHere from error


def _pick(parts: Parts, rng: Random, kinds: Sequence[int] | None = None) -> Part:
    chosen = [block for block in parts.blocks if (kinds is None or block.kind in kinds) and block.payload]
    if not chosen:
        raise NotHere
    return rng.choice(chosen)


def stored_frame(content: bytes) -> bytes:
    """A Zstandard frame of stored blocks that states its size in four bytes (RFC 8878)."""
    out = [struct.pack("<IBI", 0xFD2FB528, 0xA0, len(content))]
    pieces = [content[at : at + _RAW_BLOCK] for at in range(0, len(content), _RAW_BLOCK)] or [b""]
    for number, piece in enumerate(pieces):
        head = (len(piece) << 3) | (number == len(pieces) - 1)
        out += [head.to_bytes(3, "little"), piece]
    return b"".join(out)


def _content(frame: bytes) -> bytes:
    try:
        if not 0 < zstandard.get_frame_parameters(frame).content_size <= MAX_CONTENT:
            raise NotHere
        return zstandard.ZstdDecompressor().decompress(frame)
    except (zstandard.ZstdError, MemoryError) as error:
        raise NotHere from error


def _varint(rng: Random) -> bytes:
    """A varint: of a special value, random, of a negative number, longer than needed, or without end."""
    how = rng.random()
    if how < 0.4:
        return unsigned_varint(rng.choice(SPECIAL_NUMBERS))
    if how < 0.7:
        return unsigned_varint(rng.getrandbits(rng.choice((3, 7, 12, 24, 33, 63))))
    if how < 0.85:
        return signed_varint(rng.choice((-1, 1)) * rng.choice(SPECIAL_NUMBERS))
    return rng.choice((b"\x80\x00", b"\xff" * 9 + b"\x01", b"\xff" * 10 + b"\x02", b"\x80" * 12))


def altered(content: bytes, rng: Random) -> bytes:
    """Some bytes of a structure replaced: single ones, or varints in place of varints."""
    out = content
    for _ in range(rng.choice((1, 1, 2, 4))):
        # The front holds the numbers that say how long the rest is.
        at = rng.randrange(min(len(out), 40)) if rng.random() < 0.5 else rng.randrange(len(out))
        how = rng.random()
        if how < 0.35:
            piece, past = bytes([rng.choice((0, 1, 2, 127, 128, 255, rng.getrandbits(8)))]), at + 1
        elif how < 0.45:
            piece, past = rng.randbytes(8), at + 8
        elif how < 0.55:
            piece, past = b"", at + rng.randint(1, 9)
        else:
            past = at + 1
            while past < len(out) and out[past - 1] & 0x80:
                past += 1
            piece = _varint(rng)
        out = out[:at] + piece + out[past:] or b"\0"
    return out


def frame_content(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """The content of a Zstandard frame, stored anew."""
    parts = parts_of(data)
    block = _pick(parts, rng, FRAMES)
    block.payload = stored_frame(altered(_content(block.payload), rng))
    return put_together(parts)


def frame_header(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """The first bytes of a Zstandard frame: sizes, windows, flags."""
    parts = parts_of(data)
    block = _pick(parts, rng, FRAMES)
    head = bytearray(block.payload[:14])
    for _byte in range(rng.randint(1, 3)):
        head[rng.randrange(4 if rng.random() < 0.9 else 0, len(head))] = rng.choice((0, 0x20, 0xA0, 0xE0, 0xFF, 0x80))
    block.payload = bytes(head) + block.payload[14:]
    return put_together(parts)


def frame_bomb(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A Zstandard frame of few bytes and much content."""
    parts = parts_of(data)
    block = _pick(parts, rng, FRAMES)
    content = _content(block.payload)
    size = rng.choice((1 << 12, 1 << 16, 1 << 20))
    filler = rng.choice((b"\0", b"\1", content[-1:], content))
    block.payload = zstandard.ZstdCompressor().compress(content + filler * (size // len(filler)))
    return put_together(parts)


def model_content(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """Numbers in a LAYER, CODEBOOKS, HASH_GRID, ENTROPY_NETWORK or PREDICTORS block."""
    parts = parts_of(data)
    block = _pick(parts, rng, MODELS)
    block.payload = altered(block.payload, rng)
    return put_together(parts)


def layer_row(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """The end of a LAYER block, where stages and steps are."""
    parts = parts_of(data)
    block = _pick(parts, rng, (BlockKind.LAYER,))
    out = bytearray(block.payload)
    for _number in range(rng.choice((1, 1, 2))):
        at = len(out) - 1 - rng.randrange(min(len(out), 10))
        out[at] = rng.choice((0, 1, 2, 3, 5, 8, 9, 15, 20, 21))
    block.payload = bytes(out)
    return put_together(parts)


def block_count(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """`count` of an entry: a TILE block then stands for more anchors, or fewer, and all sums agree."""
    parts = parts_of(data)
    block = _pick(parts, rng, (BlockKind.TILE,) if rng.random() < 0.8 else None)
    block.count = rng.choice(_COUNTS) if rng.random() < 0.6 else special_number(rng, 2, block.count)
    return put_together(parts)


def tile_words(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """The words of the sub-streams of a TILE block, behind a right table; the last word is seldom 0."""
    parts = parts_of(data)
    block = _pick(parts, rng, (BlockKind.TILE,))
    start = 1 + RECORD_SIZE * block.payload[0] + 4
    if start >= len(block.payload):
        raise NotHere
    out = bytearray(block.payload)
    for _word in range(rng.randint(1, 4)):
        at = start + 4 * rng.randrange((len(out) - start + 3) // 4)
        out[at : at + 4] = rng.choice((rng.randbytes(4), b"\xff" * 4, b"\1\0\0\0"))[: len(out) - at]
    block.payload = bytes(out)
    return put_together(parts)


def substreams(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """Sub-streams of a TILE block emptied, lengthened, shortened, doubled or exchanged, behind a right table."""
    parts = parts_of(data)
    block = _pick(parts, rng, (BlockKind.TILE,))
    at = 1 + RECORD_SIZE * block.payload[0] + 4
    streams = []
    for kind, length, _crc in records(block.payload):
        streams.append((kind, block.payload[at : at + length]))
        at += length
    if not streams:
        raise NotHere
    row = rng.randrange(len(streams))
    kind, words = streams[row]
    other = rng.randrange(len(streams))
    choices: list[list[tuple[int, bytes]]] = [
        [],
        [(kind, words[:-4])],
        [(kind, words + rng.randbytes(4))],
        [(rng.randint(0, 12), words)],
        [(kind, streams[other][1])],
        [(kind, words), (kind, words)],
    ]
    streams[row : row + 1] = rng.choice(choices)
    block.payload = packed_tile(streams)
    return put_together(parts)


def packed_tile(streams: Sequence[tuple[int, bytes]]) -> bytes:
    """A TILE block of these sub-streams without checksums; they are up to `resealed_tile`."""
    table = b"".join(RECORD.pack(kind, len(words), 0) for kind, words in streams)
    return bytes([len(streams) & 255]) + table + bytes(4) + b"".join(words for _, words in streams)


def drop_block(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A block and its entry left out."""
    parts = parts_of(data)
    if not parts.blocks:
        raise NotHere
    del parts.blocks[rng.randrange(len(parts.blocks))]
    return put_together(parts)


def duplicate_block(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A block twice, the copy perhaps of another kind, layer or tile, in order or not."""
    parts = parts_of(data)
    block = _pick(parts, rng)
    copy = Part(**vars(block))
    how = rng.randrange(4)
    if how == 1:
        copy.kind = rng.choice((*range(1, 9), 16, 17, 64, 65, 128, 255))
    elif how == 2:
        copy.layer = rng.randint(1, max(len(parts.gaussians), 1))
    elif how == 3:
        copy.tile = rng.randrange(max(len(parts.tiles), 1)) if block.tile != NO_TILE else NO_TILE
    parts.blocks.append(copy)
    _sort(parts, rng)
    return put_together(parts)


def _sort(parts: Parts, rng: Random) -> None:
    if rng.random() < 0.8:
        parts.blocks.sort(key=lambda block: (block.layer, block.kind, block.tile))


def swap_blocks(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """Two blocks in each other's place, entries and all."""
    parts = parts_of(data)
    if len(parts.blocks) < 2:
        raise NotHere
    a, b = rng.sample(range(len(parts.blocks)), 2)
    parts.blocks[a], parts.blocks[b] = parts.blocks[b], parts.blocks[a]
    parts.blocks[a].tile, parts.blocks[b].tile = parts.blocks[b].tile, parts.blocks[a].tile
    return put_together(parts)


def swap_payloads(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """Two blocks with each other's bytes."""
    parts = parts_of(data)
    if len(parts.blocks) < 2:
        raise NotHere
    a = rng.choice(parts.blocks)
    alike = [block for block in parts.blocks if block.kind == a.kind]
    b = rng.choice(alike if rng.random() < 0.6 else parts.blocks)
    a.payload, b.payload = b.payload, a.payload
    return put_together(parts)


def splice_blocks(data: bytes, rng: Random, others: Sequence[bytes]) -> bytes:
    """A block with the bytes of a block of another file, mostly one of its kind."""
    parts = parts_of(data)
    block, donor = _pick(parts, rng), parts_of(rng.choice(others or [data]))
    alike = [other for other in donor.blocks if other.kind == block.kind]
    chosen = alike if alike and rng.random() < 0.8 else donor.blocks
    if not chosen:
        raise NotHere
    block.payload = rng.choice(chosen).payload
    return put_together(parts)


def truncate_at_block(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """The file up to the beginning or end of a block."""
    parts = parts_of(data)
    if not parts.blocks:
        raise NotHere
    kept = rng.randrange(len(parts.blocks))
    return data[: len(data) - sum(len(block.payload) for block in parts.blocks[kept:])]


def drop_layer(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A layer left out, or the last one declared once more without blocks."""
    parts = parts_of(data)
    layer = rng.randint(1, len(parts.gaussians))
    if rng.random() < 0.3 and len(parts.gaussians) < 16:
        parts.gaussians.append(parts.gaussians[-1])
        return put_together(parts)
    if len(parts.gaussians) < 2:
        raise NotHere
    del parts.gaussians[layer - 1]
    parts.blocks = [block for block in parts.blocks if block.layer != layer]
    for block in parts.blocks:
        block.layer -= block.layer > layer
    return put_together(parts)


OPERATORS: dict[str, Callable[[bytes, Random, Sequence[bytes]], bytes]] = {
    "frame-content": frame_content,
    "frame-header": frame_header,
    "frame-bomb": frame_bomb,
    "model-content": model_content,
    "layer-row": layer_row,
    "block-count": block_count,
    "tile-words": tile_words,
    "substreams": substreams,
    "drop-block": drop_block,
    "duplicate-block": duplicate_block,
    "swap-blocks": swap_blocks,
    "swap-payloads": swap_payloads,
    "splice-blocks": splice_blocks,
    "truncate-at-block": truncate_at_block,
    "drop-layer": drop_layer,
}
