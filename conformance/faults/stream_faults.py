"""The invalid vectors of TILE blocks (SPEC §7.1-§7.7, §8.2, §8.3): one rule broken each, all checksums right.

Symbols that a file must not hold come from a table with another value in its alphabet; the streams stay as they are.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from conformance.decoders.python.fields import key
from conformance.scenes.cases import Case, Fault, refuse
from conformance.scenes.made import Plan, build, channel
from conformance.scenes.neural_models import PredictorPlan
from conformance.surgery.edit import replace_bytes
from conformance.surgery.files import (
    Records,
    blocks_of,
    change_value,
    layer_counts_of,
    rebuilt,
    tile_parts,
    with_substream,
    with_tables,
)
from conformance.surgery.parts import flip_bits
from conformance.writer.file import write_file
from conformance.writer.tables import Record
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Block, Tile
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.container.substreams import pack_substreams
from scarfmt.entropy.rans import RansEncoder, make_uniform
from scarfmt.scene.model import Channel, DecodedContext, LayerRow

Files = dict[str, tuple[bytes, QuantisedScene]]
_TABLE = "bad-substream-table"
_SEAL = "R-8.2-2", "rans-seal"
_SPLIT = "R-7.2-1", "bad-split"
_RANGE = "R-7.5-2", "value-range"
_REACH = "R-7.5-3", "value-range"
_INDEX = "R-7.6-1", "bad-index"


def stream_faults(files: Files) -> Iterator[Case]:
    """Files with a broken TILE block, or symbols that must not be."""
    data = {name: file for name, (file, _) in files.items()}
    for faults in (
        _table_faults(data["explicit-core"]),
        _idle_faults(data["explicit-core"], data["one-symbol"]),
        _rans_faults(data),
        _missing_tables(data),
        _value_faults(data),
        _rest_faults(data["full-block"]),
        _range_faults(),
        _reach_faults(),
    ):
        yield from (refuse(*fault, stage="tiles") for fault in faults)


# ---------------------------------------------------------------------------------------------- the TILE block


def _frame(records: list[tuple[int, int, int]], rest: bytes, count: int | None = None) -> bytes:
    """A TILE block of any records (kind, length, CRC), its table's CRC right."""
    table = bytes([len(records) if count is None else count]) + b"".join(
        bytes([kind]) + length.to_bytes(4, "little") + crc.to_bytes(4, "little") for kind, length, crc in records
    )
    return table + zlib.crc32(table).to_bytes(4, "little") + rest


def _table_faults(base: bytes) -> Iterator[Fault]:
    """Faults of the table of sub-streams. The content of a record is not read if another rule comes first."""

    def raw(payload: Callable[[bytes], bytes]) -> bytes:
        """Whatever becomes of the block: all its bytes count as FRAMING."""
        blocks = blocks_of(base)
        row = next(i for i, block in enumerate(blocks) if (block.kind, block.layer) == (BlockKind.TILE, 1))
        blocks[row] = replace(blocks[row], payload=payload(blocks[row].payload), stream_bytes={})
        return rebuilt(base, blocks)

    def tile(change: Callable[[list[tuple[int, int, int]], bytes], bytes]) -> bytes:
        def edit(payload: bytes) -> bytes:
            parts = tile_parts(payload)
            records = [(int(kind), len(part), zlib.crc32(part)) for kind, part in parts.items()]
            return change(records, b"".join(parts.values()))

        return raw(edit)

    word = bytes([1, 0, 0, 0])
    eleven = [(kind, 4, zlib.crc32(word)) for kind in range(1, 12)]
    fits, order = ("R-7.1-1", _TABLE), ("R-7.1-3", _TABLE)
    yield ("records-twelve", "a table of twelve records", *fits,
           tile(lambda _, __: _frame([*eleven, (12, 4, zlib.crc32(word))], 12 * word)))
    yield ("records-beyond", "a table of records past the end of its block", *fits,
           tile(lambda r, _: _frame(r, b"", 11)))
    yield "records-no-crc", "a block of four bytes has no room for the CRC", *fits, tile(lambda _, __: bytes(4))
    yield ("records-crc", "the CRC of the table is wrong, that of the block is right", "R-7.1-2", "crc-mismatch",
           raw(lambda payload: flip_bits(payload, 1 + 9 * payload[0])))
    yield ("substream-crc-first", "the CRC of the first sub-stream is wrong", "R-7.1-5", "crc-mismatch",
           tile(lambda r, p: _frame([(*r[0][:2], r[0][2] ^ 1), *r[1:]], p)))
    yield ("record-kind-0", "a record of kind 0", *order,
           tile(lambda r, p: _frame([(0, 4, zlib.crc32(word)), *r], word + p)))
    yield ("record-kind-12", "a record of the kind FRAMING", *order,
           tile(lambda r, p: _frame([*r, (12, 4, zlib.crc32(word))], p + word)))
    yield "records-descend", "two records swapped", *order, tile(lambda r, p: _frame([r[1], r[0], *r[2:]], p))
    yield ("records-equal", "two records of one kind", *order,
           tile(lambda r, p: _frame([r[0], r[0], *r[1:]], p[: r[0][1]] + p)))
    yield ("record-empty", "a record of no bytes", *order,
           tile(lambda r, p: _frame([(r[0][0], 0, 0), *r[1:]], p[r[0][1] :])))
    yield "record-odd", "a sub-stream of six bytes", *order, tile(_six_bytes)
    yield ("offsets-explicit-crc", "OFFSETS in the explicit profile, with a wrong CRC", "R-7.1-4", _TABLE,
           tile(lambda r, p: _frame([*r, (11, 4, zlib.crc32(word) ^ 1)], p + word)))
    yield "substreams-gap", "four bytes after the last sub-stream", *order, tile(lambda r, p: _frame(r, p + word))
    yield ("substreams-beyond", "the last sub-stream ends past the block", *order,
           tile(lambda r, p: _frame([*r[:-1], (r[-1][0], r[-1][1] + 4, r[-1][2])], p)))


def _six_bytes(records: list[tuple[int, int, int]], parts: bytes) -> bytes:
    kind, length, _ = records[-1]
    six = bytes([1, 2, 3, 4, 5, 6])
    return _frame([*records[:-1], (kind, 6, zlib.crc32(six))], parts[: len(parts) - length] + six)


def _idle_faults(base: bytes, constant: bytes) -> Iterator[Fault]:
    """Records of kinds that code nothing in their block (R-7.1-4), or that hold words nobody reads."""
    rule = "R-7.1-4", _TABLE
    word = bytes([1, 0, 0, 0])
    for name, stream in (("positions", Stream.POSITIONS), ("classes", Stream.CLASSES)):
        yield (f"{name}-without-anchors", f"{stream.name} in a block in which no anchor appears", *rule,
               _second_block(constant, {stream: word}, 0))
    yield ("channel-without-table", "a channel that the channel table does not have", *rule,
           with_substream(constant, 1, Stream.COLOUR, lambda _: word))
    yield ("offsets-explicit", "OFFSETS in the explicit profile", *rule,
           with_substream(base, 1, Stream.OFFSETS, lambda _: word))
    yield ("anchors-without-class", "an anchor appears in a layer in which no class does", "R-7.3-1", "bad-class",
           _second_block(constant, {}, 1))
    yield ("anchors-without-class-seal", "the same, and POSITIONS, which comes first, does not end in the empty state",
           *_SEAL, _second_block(constant, {Stream.POSITIONS: word}, 1))


def _second_block(constant: bytes, parts: dict[Stream, bytes], new: int) -> bytes:
    """The file, which has no TILE block in layer 2, with one there, in which `new` anchors appear."""
    first = layer_counts_of(constant)[0][0]
    sizes = {int(stream): len(part) for stream, part in parts.items()}
    block = Block(BlockKind.TILE, 2, pack_substreams(parts), tile=0, count=new, stream_bytes=sizes)
    counts = [(first, first), (first + new, first + new)]
    return rebuilt(constant, [*blocks_of(constant), block], counts)


# ---------------------------------------------------------------------------------------------- rANS streams, tables


def _rans_faults(data: dict[str, bytes]) -> Iterator[Fault]:
    constant, base, anchors = data["one-symbol"], data["explicit-core"], data["anchors"]
    word = bytes([1, 0, 0, 0])
    for stream in (Stream.CLASSES, Stream.SCALE, Stream.INDICES):
        yield (f"{stream.name.lower()}-unread", f"{stream.name} codes nothing, but has a word", *_SEAL,
               with_substream(constant, 1, stream, lambda _: word))
    yield ("indices-without-stages", "INDICES in a layer in which no anchor gets a stage", *_SEAL,
           with_substream(data["sixteen-layers"], 1, Stream.INDICES, lambda _: word))
    for stream, file in (
        (Stream.POSITIONS, constant), (Stream.MASKS, anchors), (Stream.OFFSETS, anchors), (Stream.LATENT, base),
    ):
        layer = 2 if stream == Stream.LATENT else 1
        yield (f"{stream.name.lower()}-word-more", f"{stream.name} has a word more than its symbols take", *_SEAL,
               with_substream(file, layer, stream, lambda part: word + part))
    yield ("neural-seal", "INDICES in entropy mode 1 does not end in the empty state", *_SEAL,
           with_substream(data["index-plain"], 1, Stream.INDICES, lambda part: word + part))
    yield ("words-missing", "a stream without its first word: the reader goes on, the end is wrong", *_SEAL,
           with_substream(data["sh-from-network"], 1, Stream.INDICES, lambda part: part[4:]))
    yield ("word-zero", "a stream of one word, which is 0", "R-8.2-1", "rans-last-word",
           with_substream(constant, 1, Stream.SCALE, lambda _: bytes(4)))


def _missing_tables(data: dict[str, bytes]) -> Iterator[Fault]:
    rule = "R-8.3-3", "missing-table"
    core = "explicit-core"
    for name, what, file, layer, drop in (
        ("positions", "POSITIONS has no table", "duplicates", 1, _of(Stream.POSITIONS)),
        ("classes", "CLASSES has no table", core, 3, _of(Stream.CLASSES)),
        ("masks", "MASKS has no table", "anchors", 1, _of(Stream.MASKS)),
        ("residual", "POSITION_RESIDUAL has no table", core, 2, _of(Stream.POSITION_RESIDUAL)),
        ("latent", "LATENT has no table", core, 2, _of(Stream.LATENT)),
        ("offsets", "OFFSETS has no table", "anchors", 1, _of(Stream.OFFSETS)),
        ("indices", "INDICES has no table", "explicit-refined", 1, _of(Stream.INDICES)),
        ("bins", "no table of the bins of large nodes", "duplicates", 1, _node(17)),
        ("trits", "a refinement has no table", core, 2, _of(Stream.SCALE, step=2)),
        ("predicted", "a context number of a predictor has no table", "predictors", 1, _of(Stream.OPACITY, 0, 1)),
    ):
        yield f"no-table-{name}", what, *rule, _drop(data[file], layer, drop)
    yield ("table-late", "a table of layer 2 does not code symbols of layer 1", *rule, _late_table(data[core]))


Pick = Callable[[Record], bool]


def _of(stream: Stream, component: int | None = None, step: int | None = None, context: int | None = None) -> Pick:
    """Whether a record is of this stream, and of a component, step and context, where they are given."""
    wanted = component, step, context

    def picks(record: Record) -> bool:
        kind, *found = record.digits
        return kind == stream and all(a in (None, b) for a, b in zip(wanted, found, strict=True))

    return picks


def _node(anchors: int) -> Pick:
    """The table of splits of so many anchors; 17 for the bins of larger nodes."""
    return _of(Stream.POSITIONS, 0, 0, anchors)


def _drop(data: bytes, layer: int, drop: Pick) -> bytes:
    return with_tables(data, layer, lambda records: [record for record in records if not drop(record)])


def _late_table(base: bytes) -> bytes:
    moved: Records = []

    def take(records: Records) -> Records:
        moved[:] = filter(_of(Stream.ROTATION), records)
        return [record for record in records if record not in moved]

    taken = with_tables(base, 1, take)
    return with_tables(taken, 2, lambda records: sorted(
        {**{r.key: r for r in moved}, **{r.key: r for r in records}}.values(), key=lambda record: record.key))


# ---------------------------------------------------------------------------------------------- symbols


def _with_value(data: bytes, layer: int, pick: Pick, old: int | None, new: int) -> bytes:
    """The file with a value of the alphabets picked changed; `old` None: their last, or the first if `new` is less."""

    def change(records: Records) -> Records:
        return [_change(record, old, new) if pick(record) else record for record in records]

    return with_tables(data, layer, change)


def _change(record: Record, old: int | None, new: int) -> Record:
    if old is None:
        old = record.values[0] if new < record.values[0] else record.values[-1]
    return change_value(record, old, new) if old in record.values else record


def _value_faults(data: dict[str, bytes]) -> Iterator[Fault]:
    """Symbols that must not be, from alphabets that have them."""
    cls, mask, trit, index = ("R-7.3-1", "bad-class"), ("R-7.4-1", "bad-mask"), ("R-7.5-1", "bad-trit"), _INDEX
    classes, masks, core, refined = _of(Stream.CLASSES), _of(Stream.MASKS), "explicit-core", "explicit-refined"
    first, second = _of(Stream.INDICES, 1), _of(Stream.INDICES, 2)
    scale, rotation, residual = (
        _of(stream, step=2) for stream in (Stream.SCALE, Stream.ROTATION, Stream.POSITION_RESIDUAL)
    )
    rows: tuple[tuple[str, str, tuple[str, str], str, int, Pick, int | None, int], ...] = (
        ("split-above", "more anchors in the lower half than the node has", _SPLIT, "sh-from-network", 1, _node(2),
         None, 3),
        ("split-negative", "fewer than no anchors in the lower half", _SPLIT, "sh-from-network", 1, _node(2), None, -1),
        ("split-bin-16", "a bin of 16", _SPLIT, "duplicates", 1, _node(17), None, 16),
        ("split-bin-negative", "a bin of -1", _SPLIT, "duplicates", 1, _node(17), None, -1),
        ("class-above", "a class that does not appear yet", cls, core, 3, classes, None, 2),
        ("class-before", "a class that appeared in an earlier layer", cls, core, 3, classes, None, -1),
        ("mask-two", "a mask symbol of 2", mask, "anchors", 1, masks, 1, 2),
        ("mask-negative", "a mask symbol of -1", mask, "anchors", 1, masks, 0, -1),
        ("trit-two", "a refinement of 2", trit, core, 2, scale, 1, 2),
        ("trit-minus-two", "a refinement of -2", trit, core, 3, rotation, -1, -2),
        ("trit-predicted", "a refinement of 2 with a predictor", trit, "predictors", 2, scale, 1, 2),
        ("trit-residual", "a refinement of -2 of POSITION_RESIDUAL", trit, core, 3, residual, -1, -2),
        ("index-negative", "an index of -1", index, refined, 1, first, None, -1),
        ("index-above", "an index of 12 in a codebook of 12", index, refined, 1, first, None, 12),
        ("index-residual", "an index of stage 2 beyond the residual codebook", index, refined, 2, second, None, 12),
    )
    for name, purpose, rule, file, layer, pick, old, new in rows:
        yield name, purpose, *rule, _with_value(data[file], layer, pick, old, new)
    word = bytes([1, 0, 0, 0])
    above = _with_value(data[core], 3, classes, None, 2)
    yield ("class-above-positions", "a class that does not appear yet, after POSITIONS with a word too many", *_SEAL,
           with_substream(above, 3, Stream.POSITIONS, lambda part: word + part))
    yield ("class-above-seal", "a class that does not appear yet, in CLASSES with a word too many", *cls,
           with_substream(above, 3, Stream.CLASSES, lambda part: word + part))
    yield "mask-two-later", "a mask symbol of 2 in layer 2", *mask, with_tables(data["anchors"], 2, _masks_of_two)
    late = _with_value(data[refined], 3, _of(Stream.INDICES, 1, 0, 16), None, 12)
    yield ("index-above-without-table", "an index of 12 in one context, and no table for the next of that stage",
           "R-8.3-3", "missing-table", _drop(late, 3, _of(Stream.INDICES, 1, 0, 32)))


def _rest_faults(full: bytes) -> Iterator[Fault]:
    """Of 65536 anchors the bin 0 is 4097 wide: its rest travels as 1 and 4095 of two uniform tables."""
    bins = _node(17)
    one_bin = with_tables(full, 1, lambda records: [
        Record(record.key, (0,), (1,)) if bins(record) else record for record in records
    ])
    for name, low in (("split-rest", 4095), ("split-rest-edge", 1)):
        rest = RansEncoder()
        rest.encode(np.array([1]), make_uniform(2))
        rest.encode(np.array([low]), make_uniform(4096))
        yield (name, f"a rest of {4096 + low} in a bin 4097 wide", *_SPLIT,
               with_substream(one_bin, 1, Stream.POSITIONS, replace_bytes(rest.finish())))


def _masks_of_two(records: Records) -> Records:
    """The records with tables of all mask contexts in which 1 became 2."""
    keys = [key(Stream.MASKS, 0, 0, on) for on in range(10)]
    contexts = {number: Record(number, (0, 2), (1, 1)) for number in keys}
    return sorted({**{record.key: record for record in records}, **contexts}.values(), key=lambda record: record.key)


def _constant_plan(name: str, predictors: tuple[PredictorPlan, ...] = (), layers: tuple[int, ...] = (1, 2)) -> Plan:
    """Every value is -5 * 3^(n-1)."""
    channels = (channel(Stream.SCALE, 0.5, 3),)
    rows = tuple(LayerRow((0,), ((n,),)) for n in layers)
    return Plan(name, channels, rows, (Tile(0, 0, 0),), (20,), bits=5, constant=True, predictors=predictors,
                context=DecodedContext(1, (4,)))


def _range_faults() -> Iterator[Fault]:
    """3 * 715827882 + 1 is 2^31 - 1."""
    plain = write_file(build(_constant_plan("range")))
    together = write_file(build(_constant_plan("range at once", layers=(2,))))
    # One bucket: the context of the predicted step stays 0, whatever the value.
    predicted = write_file(build(_constant_plan("range predicted", (PredictorPlan(Stream.SCALE, 1, 2, 0, (1, 1)),))))

    def overflowing(data: bytes, layer: int, trit: int) -> bytes:
        first = _with_value(data, 1, _of(Stream.SCALE, 1, 1), -5, -715827883)
        if not trit:
            return first
        return _with_value(first, layer, _of(Stream.SCALE, 1, 2), 0, trit)

    yield "value-beyond", "-2^31 - 1 after the second step", *_RANGE, overflowing(plain, 2, 0)
    yield "value-lowest", "-2^31 after the second step: in 32 bits, but not allowed", *_RANGE, overflowing(plain, 2, 1)
    yield ("value-beyond-at-once", "-2^31 - 2 after the second step, which travels with the first", *_RANGE,
           overflowing(together, 1, -1))
    yield ("value-beyond-predicted", "-2^31 after the second step, which has a predictor", *_RANGE,
           overflowing(predicted, 2, 1))

    def above(data: bytes, context: int) -> bytes:
        """3 * 715827883 - 1; the record of the refinement is for the context of values above 1."""
        first = _with_value(data, 1, _of(Stream.SCALE, 1, 1), -5, 715827883)
        return with_tables(first, 2, lambda records: [
            Record(r.key + context, (-1,), (1,)) if r.digits[1:3] == (1, 2) else r for r in records
        ])

    yield "value-above", "2^31 after the second step", *_RANGE, above(plain, 4)
    yield "value-above-predicted", "2^31 after the second step, which has a predictor", *_RANGE, above(predicted, 0)


def _reach_faults() -> Iterator[Fault]:
    """Faults of residuals that are -5 fifths of a cell."""
    residuals = Channel(Stream.POSITION_RESIDUAL, (0.2,) * 3)
    channels = (residuals, channel(Stream.SCALE, 0.5, 3))
    rows = (LayerRow((0,), ((1, 1),)), LayerRow((0,), ((1, 2),)), LayerRow((0,), ((2, 2),)))
    plan = Plan("reach", channels, rows, (Tile(0, 0, 0),), (9,), bits=5, constant=True)
    data = write_file(build(plan))

    first, second = (_of(Stream.POSITION_RESIDUAL, 2, step) for step in (1, 2))
    yield "residual-beyond", "a position residual of -1.2", *_REACH, _with_value(data, 1, first, -5, -6)
    yield "residual-above", "a position residual of 1.2", *_REACH, _with_value(data, 1, first, -5, 6)
    yield ("residual-beyond-later", "a position residual that leaves -1 in its second step, in layer 3", *_REACH,
           _with_value(data, 3, second, 0, -1))
