"""Damage to files, reproducible from a number: truncation, lies, bit flips, blocks moved about (see `OPERATORS`).

:func:`mutate` picks operators by its seed, and in half of the cases makes all checksums right afterwards, so that what
is damaged is reached. Operators on blocks, ROOT and pages leave everything else about the file right.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import Any

from conformance.decoders.python.fields import Refused
from conformance.spec.spec_text import size_of, structure
from conformance.surgery.files import NUMBERS, NumberRecorder, blocks_of, layer_counts_of, rebuilt, stream_bytes
from conformance.surgery.parts import change_pages, change_root, take_apart
from conformance.surgery.reseal import is_file, reseal
from conformance.writer.numbers import Number, numbers_block
from conformance.writer.pages import Pages, RawPage
from scarfmt.container.bytefields import unsigned_varint
from scarfmt.container.file import Block
from scarfmt.container.schema import SIGNATURE, VERSION, BlockKind
from scarfmt.entropy.numbers import LARGEST
from scarfmt.errors import ScarError

SEAL_CHANCE = 0.5
_CONTEXTS = ({"layer": 1}, *({"layer": 0, "channel_count": channels} for channels in range(9)))
"""What a block may be read with that says nothing of its layer."""
SPECIAL_NUMBERS = (0, 1, 2, 127, 128, 255, 256, 65535, 65536, 1 << 31, (1 << 32) - 1, 1 << 53, 1 << 63, (1 << 64) - 1)
"""Numbers at which arithmetic goes wrong."""
_FLOATS = ("nan", "inf", "-inf", "0", "-0.0", "-1", "5e-324", "1e308", "1e-300", "2.0")
_COUNTS = (0, 1, 2, 3, 16, 17, 255, 1000, 65535, 65536, 65537)
_RECORD = struct.Struct("<BII")
_SIZES = {
    "kind": 1, "flags": 1, "length": 6, "count": 4, "crc32": 4, "gap": 8, "tile_bytes": 4, "tile_crc32": 4,
    "row_bytes": 4, "row_crc32": 4, "block_bytes": 6, "anchors": 6,
}  # fmt: skip
"""Bytes that a number of ROOT may have."""


class Dice(Random):
    """Random numbers, and the `others` files that blocks or bytes may be taken from."""

    others: Sequence[bytes] = ()

    def file(self, data: bytes) -> bytes:
        """Another file; `data` if there is none."""
        return self.choice(self.others or [data])

    def number(self, size: int, old: int) -> int:
        """A number of `size` bytes: a special value, near `old`, or random."""
        how = self.random()
        if how < 0.55:
            value = self.choice(SPECIAL_NUMBERS)
        elif how < 0.85:
            value = old + self.choice((-9, -4, -1, 1, 2, 4, 8, 100))
        else:
            value = self.getrandbits(8 * size)
        return value & ((1 << (8 * size)) - 1)

    def varint(self) -> bytes:
        """A varint: of a special value, random, longer than needed, or without end."""
        how = self.random()
        if how < 0.4:
            return unsigned_varint(self.choice(SPECIAL_NUMBERS))
        if how < 0.8:
            return unsigned_varint(self.getrandbits(self.choice((3, 7, 12, 24, 33, 63))))
        return self.choice((b"\x80\x00", b"\xff" * 9 + b"\x01", b"\xff" * 10 + b"\x02", b"\x80" * 12))


Operator = Callable[[bytes, Dice], bytes]
"""(file, random numbers) -> damaged file. A file without what it works on raises one of `NOT_HERE`."""
OPERATORS: dict[str, Operator] = {}
"""All operators by name."""
ON_BYTES: set[str] = set()
"""Names of the operators after which a file can no longer be taken apart."""
ON_BLOCKS: list[str] = []
"""Names of the operators whose files have right checksums, sizes and sums outside their TILE blocks."""
NOT_HERE = (LookupError, ValueError, OverflowError, struct.error, Refused)
"""What an operator raises on bytes without the thing it works on."""


def _register(name: str, operator: Operator) -> str:
    OPERATORS[name.replace("_", "-")] = operator
    return name.replace("_", "-")


# ------------------------------------------------------------------------------------------------ bytes


def _on_bytes(change: Operator) -> Operator:
    ON_BYTES.add(_register(change.__name__, change))
    return change


@_on_bytes
def flip_bit(data: bytes, dice: Dice) -> bytes:
    """One bit anywhere."""
    out = bytearray(data)
    out[dice.randrange(len(out))] ^= 1 << dice.randrange(8)
    return bytes(out)


@_on_bytes
def flip_bits(data: bytes, dice: Dice) -> bytes:
    """Two to sixteen bits, anywhere or close together."""
    out = bytearray(data)
    start, width = dice.randrange(len(out)), dice.choice((4, 64, len(out)))
    for _ in range(dice.randint(2, 16)):
        out[(start + dice.randrange(width)) % len(out)] ^= 1 << dice.randrange(8)
    return bytes(out)


@_on_bytes
def overwrite_run(data: bytes, dice: Dice) -> bytes:
    """A run of bytes set to 0, to 0xFF, or to random bytes."""
    start = dice.randrange(len(data))
    length = min(len(data) - start, dice.choice((1, 2, 4, 8, 16, 64, 512, 4096)))
    run = dice.choice((bytes(length), b"\xff" * length, dice.randbytes(length)))
    return data[:start] + run + data[start + length :]


@_on_bytes
def truncate_anywhere(data: bytes, dice: Dice) -> bytes:
    """The first bytes only."""
    return data[: dice.randrange(len(data))]


@_on_bytes
def truncate_at_block(data: bytes, dice: Dice) -> bytes:
    """The file up to the beginning of a block."""
    blocks = blocks_of(data)
    return data[: len(data) - sum(len(block.payload) for block in blocks[dice.randrange(len(blocks)) :])]


@_on_bytes
def garbage_tail(data: bytes, dice: Dice) -> bytes:
    """Bytes after the end: random, zeros, or another file."""
    return data + dice.choice((dice.randbytes(dice.randint(1, 64)), bytes(dice.randint(1, 64)), dice.file(data)))


@_on_bytes
def random_body(data: bytes, dice: Dice) -> bytes:
    """Random bytes after a right signature, or after a right header."""
    if dice.random() < 0.5:
        return SIGNATURE + bytes(VERSION) + dice.randbytes(dice.randint(0, 512))
    length = int.from_bytes(data[12:16], "little")
    return data[:length] + dice.randbytes(max(len(data) - length, 0))


@_on_bytes
def splice_bytes(data: bytes, dice: Dice) -> bytes:
    """The beginning of one file and the end of another."""
    other, cut = dice.file(data), dice.randrange(len(data))
    return data[:cut] + other[min(cut, len(other) - 1) if dice.random() < 0.5 else dice.randrange(len(other)) :]


@_on_bytes
def move_bytes(data: bytes, dice: Dice) -> bytes:
    """A piece lost, repeated, or copied over another."""
    start = dice.randrange(len(data))
    piece = data[start : start + dice.choice((1, 4, 9, 12, 32, 136, 1000))]
    how = dice.randrange(3)
    if how == 0:
        return (data[:start] + data[start + len(piece) :]) or b"\0"
    at = dice.randrange(len(data))
    return data[:at] + piece + data[at if how == 1 else at + len(piece) :]


@_on_bytes
def header_field(data: bytes, dice: Dice) -> bytes:
    """Fields of FILE_HEADER after the signature."""
    return _with_lies(data, "FILE_HEADER", 0, dice)


@_on_bytes
def summary_field(data: bytes, dice: Dice) -> bytes:
    """Fields of a LAYER_SUMMARY."""
    number = dice.randrange(len(layer_counts_of(data)))
    return _with_lies(data, "LAYER_SUMMARY", size_of("FILE_HEADER") + size_of("LAYER_SUMMARY") * number, dice)


def _with_lies(data: bytes, name: str, base: int, dice: Dice) -> bytes:
    """Some numbers of the structure at `base` set to others."""
    places = [
        (base + place.offset + i * size, size, place.type)
        for place in structure(name)
        if place.name != "signature"
        for size in [place.size // (place.numbers or 1)]
        for i in range(place.numbers or 1)
    ]
    out = bytearray(data)
    for at, size, type_ in dice.sample(places, min(len(places), dice.choice((1, 1, 1, 2, 3)))):
        if at + size > len(out):
            raise LookupError(name)
        if type_ == "f64":
            out[at : at + 8] = struct.pack("<d", float(dice.choice(_FLOATS)))
        else:
            old = int.from_bytes(out[at : at + size], "little")
            out[at : at + size] = dice.number(size, old).to_bytes(size, "little")
    return bytes(out)


# ------------------------------------------------------------------------------------------------ ROOT and pages

PageChange = Callable[[Pages, Dice], object]


def _on_pages(change: PageChange, *, contents: bool) -> PageChange:
    """Register a change of numbers of ROOT, or of the contents of pages, after which ROOT is right about them."""

    def operator(data: bytes, dice: Dice) -> bytes:
        parts = take_apart(data)
        # Most small files have a single page.
        parts.page_bits = dice.choice((0, 1, parts.page_bits, parts.page_bits))
        parts.settle()
        changes: dict[str, Any] = {"contents" if contents else "root": lambda pages: change(pages, dice)}
        return change_pages(parts.seal(), **changes)

    ON_BYTES.add(_register(change.__name__, operator))
    return change


_on_root = functools.partial(_on_pages, contents=False)
_on_contents = functools.partial(_on_pages, contents=True)


def _lie(row: Any, dice: Dice) -> None:
    """Some numbers of a row of ROOT set to others."""
    names = [name for name in vars(row) if name in _SIZES]
    for name in dice.sample(names, min(len(names), dice.choice((1, 1, 1, 2)))):
        setattr(row, name, dice.number(_SIZES[name], getattr(row, name)))


def _lie_in_column(columns: Sequence[list[int]], sizes: Sequence[int], dice: Dice) -> None:
    column, size = dice.choice([(c, size) for c, size in zip(columns, sizes, strict=True) if c])
    at = dice.randrange(len(column))
    column[at] = dice.number(size, column[at])


def _row_pages(pages: Pages) -> list[tuple[list[Any], int]]:
    """Every row page that there is: the list it is in, and its place there."""
    return [(layer, number) for layer in pages.rows for number, page in enumerate(layer) if page is not None]


@_on_root
def root_entry(pages: Pages, dice: Dice) -> None:
    """Numbers of a block that belongs to no tile."""
    _lie(dice.choice([row for rows in pages.root.models for row in rows]), dice)


@_on_root
def root_page(pages: Pages, dice: Dice) -> None:
    """Numbers that ROOT has of a page, or of its rows in a layer."""
    page = dice.choice(pages.root.pages)
    rows = [row for row in page.rows if row.row_bytes]
    _lie(dice.choice([page, *rows, *rows]), dice)


@_on_root
def page_alike(pages: Pages, dice: Dice) -> None:
    """Copy a page's fields in ROOT, or those of its rows in a layer, to another page: one beginning, equal bytes."""
    groups: list[tuple[Sequence[Any], tuple[list[str], ...]]] = [
        (pages.root.pages, (["gap"], ["tile_bytes", "tile_crc32"], ["rows"])),
        ([row for page in pages.root.pages for row in page.rows], (["row_bytes", "row_crc32"], ["block_bytes"])),
    ]
    rows, names = dice.choice([group for group in groups if len(group[0]) > 1])
    source, target = dice.sample(rows, 2)
    vars(target).update({name: vars(source)[name] for name in dice.choice((*names, list(vars(source))))})


@_on_contents
def tile_number(pages: Pages, dice: Dice) -> None:
    """A depth, a shift or a gap of a tile."""
    page = dice.choice(pages.tiles)
    _lie_in_column((page.depths, page.shifts, page.gaps), (1, 1, 8), dice)


@_on_contents
def repeat_tiles(pages: Pages, dice: Dice) -> None:
    """Depth, shift or gap of a tile, or all of them, as another of its page has them."""
    page = dice.choice([page for page in pages.tiles if len(page.depths) > 1])
    source, target = dice.sample(range(len(page.depths)), 2)
    for column in dice.choice(([page.depths], [page.gaps], [page.depths, page.shifts, page.gaps])):
        column[target] = column[source]


@_on_contents
def row_number(pages: Pages, dice: Dice) -> None:
    """A length, a count or a CRC of a TILE block."""
    layer, number = dice.choice(_row_pages(pages))
    page = layer[number]
    _lie_in_column((page.lengths, page.counts, page.crcs), (6, 4, 4), dice)


@_on_contents
def page_bytes(pages: Pages, dice: Dice) -> None:
    """Bytes or varints of a tile page or a row page."""
    tiles: list[tuple[list[Any], int]] = [(pages.tiles, number) for number in range(len(pages.tiles))]
    group, number = dice.choice([*tiles, *_row_pages(pages)])
    group[number] = RawPage(alter(group[number].pack(), dice))


@_on_bytes
def root_bytes(data: bytes, dice: Dice) -> bytes:
    """Bytes or varints of ROOT."""
    return change_root(data, lambda root: alter(root, dice))


def alter(content: bytes, dice: Dice) -> bytes:
    """Some bytes of a structure replaced: single ones, or varints in place of varints."""
    out = content
    for _ in range(dice.choice((1, 1, 2, 4))):
        # The front holds the numbers that say how long the rest is.
        at = dice.randrange(min(len(out), 40)) if dice.random() < 0.5 else dice.randrange(len(out))
        how = dice.random()
        if how < 0.35:
            piece, past = bytes([dice.choice((0, 1, 2, 127, 128, 255, dice.getrandbits(8)))]), at + 1
        elif how < 0.45:
            piece, past = dice.randbytes(8), at + 8
        elif how < 0.55:
            piece, past = b"", at + dice.randint(1, 9)
        else:
            past = at + 1
            while past < len(out) and out[past - 1] & 0x80:
                past += 1
            piece = dice.varint()
        out = out[:at] + piece + out[past:] or b"\0"
    return out


# ------------------------------------------------------------------------------------------------ blocks

BlockChange = Callable[[list[Block], Dice], object]


def _put_together(data: bytes, blocks: Sequence[Block], gaussians: Sequence[int]) -> bytes:
    """The file with other blocks; of two TILE blocks of a layer and tile the last. Counts of anchors follow."""
    layers = range(1, len(gaussians) + 1)
    kept = {
        (block.layer, block.tile) if block.kind == BlockKind.TILE else number: block
        for number, block in enumerate(blocks)
        if block.layer in layers
    }
    header = take_apart(data).header
    counts, anchors, most = [], 0, 0
    for layer, declared in zip(layers, gaussians, strict=True):
        anchors += sum(b.count for b in kept.values() if (b.kind, b.layer) == (BlockKind.TILE, layer))
        most = anchors if header["profile"] == 0 else max(most, min(declared, anchors * header["slots"]))
        counts.append((anchors, most))
    changed = [
        replace(block, stream_bytes=stream_bytes(block.payload)) if block.kind == BlockKind.TILE else block
        for block in kept.values()
    ]
    return rebuilt(data, changed, counts)


def _on_blocks(change: BlockChange) -> BlockChange:
    """Register a change of the list of blocks."""

    def operator(data: bytes, dice: Dice) -> bytes:
        blocks = blocks_of(data)
        change(blocks, dice)
        return _put_together(data, blocks, [gaussians for _, gaussians in layer_counts_of(data)])

    ON_BLOCKS.append(_register(change.__name__, operator))
    return change


def _on_payload(*kinds: int) -> Callable[[Operator], Operator]:
    """Register a change of the payload of one block of some kinds."""

    def registered(change: Operator) -> Operator:
        def on_list(blocks: list[Block], dice: Dice) -> None:
            row = dice.choice([number for number, block in enumerate(blocks) if block.kind in kinds])
            blocks[row] = replace(blocks[row], payload=change(blocks[row].payload, dice) or b"\0")

        on_list.__name__ = change.__name__
        _on_blocks(on_list)
        return change

    return registered


def _numbers(payload: bytes) -> list[Number]:
    """The numbers of a block, as far as it can be read."""
    found: list[Number] = []
    for kind, context in itertools.product(NUMBERS, _CONTEXTS):
        with contextlib.suppress(ScarError):
            reader = NumberRecorder(payload)
            found = reader.read
            reader.read_all(kind, context)
            break
    return found


def _write(numbers: Iterable[Number]) -> bytes:
    return numbers_block((name, min(max(number, 0), LARGEST)) for name, number in numbers)


@_on_payload(*NUMBERS)
def number_values(payload: bytes, dice: Dice) -> bytes:
    """Some numbers of a block replaced, the others as they were."""
    numbers = _numbers(payload)
    for _ in range(dice.randint(1, 3)):
        at = dice.randrange(min(len(numbers), dice.choice((4, len(numbers)))))
        numbers[at] = numbers[at][0], dice.number(4, numbers[at][1])
    return _write(numbers)


@_on_payload(*NUMBERS)
def number_order(payload: bytes, dice: Dice) -> bytes:
    """Numbers of a block left out, or there twice."""
    numbers = _numbers(payload)
    start, length = dice.randrange(len(numbers)), dice.randint(1, 4)
    return _write(numbers[:start] + dice.choice((0, 2)) * numbers[start : start + length] + numbers[start + length :])


@_on_payload(*NUMBERS)
def number_bomb(payload: bytes, dice: Dice) -> bytes:
    """Large counts, and thousands of numbers that cost next to nothing."""
    numbers = _numbers(payload)
    numbers[0] = numbers[0][0], dice.choice((1, 8, 65536))
    filler = dice.choice(numbers)[0], dice.choice((0, 0, 1, 4095))
    return _write(numbers + [filler] * dice.choice((1 << 8, 1 << 12)))


@_on_payload(BlockKind.HASH_GRID)
def grid_content(payload: bytes, dice: Dice) -> bytes:
    """Numbers in a HASH_GRID block."""
    return alter(payload, dice)


@_on_payload(BlockKind.LAYER)
def layer_row(payload: bytes, dice: Dice) -> bytes:
    """The end of a LAYER block, where stages and steps are."""
    numbers = _numbers(payload)
    for _ in range(dice.choice((1, 1, 2))):
        at = -1 - dice.randrange(min(len(numbers), 10))
        numbers[at] = numbers[at][0], dice.choice((0, 1, 2, 3, 5, 8, 9, 15, 20, 21))
    return _write(numbers)


@_on_payload(BlockKind.TILE)
def substream_field(payload: bytes, dice: Dice) -> bytes:
    """Fields of a SUBSTREAM_RECORD, or the number of records."""
    if dice.random() < 0.2 or not payload[0]:
        return bytes([dice.number(1, payload[0])]) + payload[1:]
    return _with_lies(payload, "SUBSTREAM_RECORD", 1 + _RECORD.size * dice.randrange(payload[0]), dice)


@_on_payload(BlockKind.TILE)
def tile_words(payload: bytes, dice: Dice) -> bytes:
    """The words of the sub-streams of a TILE block, behind a right table; the last word is seldom 0."""
    start, out = 5 + _RECORD.size * payload[0], bytearray(payload)
    for _ in range(dice.randint(1, 4)):
        at = start + 4 * dice.randrange((len(out) - start + 3) // 4)
        out[at : at + 4] = dice.choice((dice.randbytes(4), b"\xff" * 4, b"\1\0\0\0"))[: len(out) - at]
    return bytes(out)


@_on_payload(BlockKind.TILE)
def substreams(payload: bytes, dice: Dice) -> bytes:
    """Sub-streams of a TILE block emptied, lengthened, shortened, doubled or exchanged; their table has no CRC."""
    at, streams = 5 + _RECORD.size * payload[0], []
    for number in range(payload[0]):
        kind, length, _ = _RECORD.unpack_from(payload, 1 + _RECORD.size * number)
        streams.append((kind, payload[at : at + length]))
        at += length
    row = dice.randrange(len(streams))
    kind, words = streams[row]
    choices: list[list[tuple[int, bytes]]] = [
        [],
        [(kind, words[:-4])],
        [(kind, words + dice.randbytes(4))],
        [(dice.randint(0, 12), words)],
        [(kind, dice.choice(streams)[1])],
        [(kind, words), (kind, words)],
    ]
    streams[row : row + 1] = dice.choice(choices)
    table = b"".join(_RECORD.pack(kind, len(words), 0) for kind, words in streams)
    return bytes([len(streams) & 255]) + table + bytes(4) + b"".join(words for _, words in streams)


@_on_blocks
def block_count(blocks: list[Block], dice: Dice) -> None:
    """`count` of an entry: a TILE block then stands for more anchors, or fewer, and all sums agree."""
    tiles = [number for number, block in enumerate(blocks) if block.kind == BlockKind.TILE]
    row = dice.choice(tiles) if dice.random() < 0.8 else dice.randrange(len(blocks))
    count = dice.choice(_COUNTS) if dice.random() < 0.6 else dice.number(2, blocks[row].count)
    blocks[row] = replace(blocks[row], count=count)


@_on_blocks
def drop_block(blocks: list[Block], dice: Dice) -> None:
    """A block and its entry left out."""
    del blocks[dice.randrange(len(blocks))]


@_on_blocks
def duplicate_block(blocks: list[Block], dice: Dice) -> None:
    """A block twice, the copy perhaps of another kind, layer or tile."""
    block = dice.choice(blocks)
    layers, tiles = (sorted({getattr(b, name) or 0 for b in blocks}) for name in ("layer", "tile"))
    kind, layer = dice.choice((*range(1, 9), 16, 17, 64, 65, 128, 255)), dice.choice(layers)
    tile = None if block.tile is None else dice.choice(tiles)
    changes: dict[str, Any] = dice.choice(({}, {"kind": kind}, {"layer": layer}, {"tile": tile}))
    blocks.append(replace(block, **changes))


@_on_blocks
def swap_blocks(blocks: list[Block], dice: Dice) -> None:
    """Two blocks in each other's place: layers, tiles and all but their kind and bytes."""
    a = dice.randrange(len(blocks))
    places = [(block.layer, block.tile) for block in blocks]
    b = dice.choice([number for number, place in enumerate(places) if place != places[a]])
    one, other = blocks[a], blocks[b]
    blocks[a] = replace(one, layer=other.layer, tile=other.tile)
    blocks[b] = replace(other, layer=one.layer, tile=one.tile)


@_on_blocks
def swap_payloads(blocks: list[Block], dice: Dice) -> None:
    """Two blocks with each other's bytes."""
    a = dice.randrange(len(blocks))
    alike = [number for number, block in enumerate(blocks) if block.kind == blocks[a].kind]
    b = dice.choice(alike) if dice.random() < 0.6 else dice.randrange(len(blocks))
    one, other = blocks[a].payload, blocks[b].payload
    blocks[a], blocks[b] = replace(blocks[a], payload=other), replace(blocks[b], payload=one)


@_on_blocks
def splice_blocks(blocks: list[Block], dice: Dice) -> None:
    """A block with the bytes of a block of another file, mostly one of its kind."""
    row, donors = dice.randrange(len(blocks)), blocks_of(dice.choice(dice.others))
    alike = [donor for donor in donors if donor.kind == blocks[row].kind]
    donor = dice.choice(alike if alike and dice.random() < 0.8 else donors)
    blocks[row] = replace(blocks[row], payload=donor.payload)


def drop_layer(data: bytes, dice: Dice) -> bytes:
    """A layer left out, or the last one declared once more without blocks."""
    gaussians = [count for _, count in layer_counts_of(data)]
    if dice.random() < 0.3 and len(gaussians) < 16:
        return _put_together(data, blocks_of(data), [*gaussians, gaussians[-1]])
    layer = dice.randrange(1, len(gaussians) + 1) if len(gaussians) > 1 else dice.randrange(0)
    blocks = [replace(b, layer=b.layer - (b.layer > layer)) for b in blocks_of(data) if b.layer != layer]
    return _put_together(data, blocks, gaussians[: layer - 1] + gaussians[layer:])


ON_BLOCKS.append(_register("drop_layer", drop_layer))


# ------------------------------------------------------------------------------------------------ mutants


@dataclass(frozen=True)
class Mutant:
    """A damaged file and how it came about.

    Attributes:
        data: its bytes.
        operators: names, in the order they were applied.
        sealed: whether checksums were made right afterwards.
    """

    data: bytes
    operators: tuple[str, ...]
    sealed: bool


def mutate(data: bytes, seed: int, others: Sequence[bytes] = ()) -> Mutant:
    """A damaged copy of a sound file; equal arguments give equal bytes.

    Args:
        seed: chooses operators and what they do.
        others: files that blocks or bytes may be taken from.
    """
    dice = Dice(seed)
    names = [dice.choice(list(OPERATORS)) for _ in range(dice.choice((1, 1, 1, 1, 2, 3)))]
    return apply(data, dice, sorted(names, key=ON_BYTES.__contains__), dice.random() < SEAL_CHANCE, others)


def mutate_blocks(data: bytes, seed: int, others: Sequence[bytes] = ()) -> Mutant:
    """A copy with one to three changes of blocks and all checksums right: another sound structure, other contents."""
    dice = Dice(seed)
    return apply(data, dice, [dice.choice(ON_BLOCKS) for _ in range(dice.choice((1, 1, 2, 3)))], True, others)


def apply(data: bytes, dice: Dice, names: Sequence[str], sealed: bool, others: Sequence[bytes] = ()) -> Mutant:
    """The file after these operators, those left out that find nothing to work on."""
    dice.others = others
    done = []
    for name in names:
        try:
            data = OPERATORS[name](data, dice)
        except NOT_HERE:  # the file has nothing of the kind, or can no longer be taken apart
            continue
        done.append(name)
        if not is_file(data):
            break
    return Mutant(reseal(data) if sealed else data, tuple(done), sealed)
