"""Blocks changed in sound files: the C library against the definition in NumPy, without a file around them.

``python -m fuzz.campaign --kind blocks`` takes the blocks of a sound file, changes one by the operators of
:mod:`fuzz.testing.mutators`, makes the checksums in it right, and gives it to both. They must read equal values or
refuse with one id. What the container refuses is for the kinds of whole files.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from conformance.surgery.reseal import resealed_tile
from fuzz.case import Case
from fuzz.corpus import Seed, corpus
from fuzz.target import decoded
from fuzz.testing.mutators import NOT_HERE, ON_PAYLOADS, Dice, flip_bit, flip_bits, overwrite_run, splice_bytes
from reference_decoder.decoded import empty_anchors
from scarfmt.coding.models import NOTHING_OPENED, ModelBlocks, SceneModels, load_models
from scarfmt.coding.reader import ALL_STREAMS, SceneReader, TileBlocks
from scarfmt.coding.work import Contents
from scarfmt.container.directory import Entry
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import BytesSource
from scarfmt.errors import ScarError
from scarfmt.limits import MAX_ANCHORS_PER_TILE
from scarfmt.native.binding import load
from scarfmt.native.file import NativeFile
from scarfmt.scene.model import Opening

MAX_BYTES = 3000
"""Of a file to change: more is learnt in a second from small ones."""
MAX_WORK = 1 << 24
"""Multiply-adds of tiles decoded by both with changed models."""
_Known = dict[tuple[int, int], tuple[Opening, int, Any]]
_ANYWHERE = (flip_bit, flip_bits, overwrite_run, splice_bytes)


class _Remembered(ModelBlocks):
    """Model blocks of which only one is another than before: the rest is parsed once.

    Args:
        payloads: of each block.
        contents: what frames may unfold to.
        known: by kind and layer: what it was parsed after, how much its frames took, and the result.
        changed: kind and layer of the one that is another; None for none.
    """

    def __init__(
        self, payloads: dict[Entry, bytes], contents: Contents, known: _Known, changed: tuple[int, int] | None
    ) -> None:
        super().__init__(payloads, contents.decompress)
        self._contents, self._known, self._changed = contents, known, changed

    def parsed(self, kind: BlockKind, layer: int, opening: Opening = NOTHING_OPENED) -> Any:
        key = int(kind), layer
        if self._changed is not None and key != self._changed and key in self._known:
            after, used, result = self._known[key]
            if after is opening:
                self._contents.left -= used
                return result
        left = self._contents.left
        result = super().parsed(kind, layer, opening)
        if self._changed is None:
            self._known[key] = opening, left - self._contents.left, result
        return result


class Sound:
    """A sound file taken apart, with what both engines make of its models."""

    def __init__(self, seed: Seed) -> None:
        self.name = seed.name
        self._reader = reader = SceneReader(BytesSource(seed.data))
        self._layers = reader.layers
        reader.container.load(self._layers, None)
        self._tiles = list(range(reader.header.tile_count))
        self._extent = reader.extent(self._layers, np.arange(reader.header.tile_count))
        self._payloads = reader.model_payloads(self._layers)
        self._supply = list(reader.supply(self._layers, self._tiles, ALL_STREAMS))
        self._known: _Known = {}
        self._models = self._opened(self._payloads), self._loaded(self._payloads, None)
        self.blocks: dict[Entry, bytes] = dict(self._payloads)
        for row in self._supply:
            self.blocks |= {entry: payload for entry, payload in row if entry is not None and payload is not None}

    def answers(self, entry: Entry, payload: bytes, count: int) -> tuple[str, str]:
        """What the C library and the definition make of the file with another block: the refusal id, or values.

        Args:
            entry: of the block.
            payload: in its place.
            count: of anchors, in the place of the entry's.
        """
        if entry.tile is None:
            return self._of_models({**self._payloads, entry: payload}, (entry.kind, entry.layer))
        other = replace(entry, length=len(payload), crc32=zlib.crc32(payload), count=count)
        row = [(other, payload) if here == entry else (here, data) for here, data in self._supply[entry.tile]]
        return self._of_tile(*self._models, entry.tile, row)

    def _of_models(self, payloads: dict[Entry, bytes], changed: tuple[int, int]) -> tuple[str, str]:
        native = self._opened(payloads)
        try:
            models = self._loaded(payloads, changed)
        except ScarError as error:
            return native.refusal or "models", error.refusal
        if native.refusal is not None:
            return native.refusal, "models"
        work = models.work.total(self._extent)
        counted = native.work(self._extent.tiles, self._extent.anchors, self._extent.splits)
        if counted not in (-1, work):
            return f"work {counted}", f"work {work}"
        both = (self._of_tile(native, models, tile, self._supply[tile]) for tile in self._tiles if work <= MAX_WORK)
        return next((pair for pair in both if pair[0] != pair[1]), ("", ""))

    def _of_tile(self, native: NativeFile, models: SceneModels, tile: int, row: TileBlocks) -> tuple[str, str]:
        given = [(entry.count if entry else 0, payload) for entry, payload in row]
        found = native.tile(self._reader.container.tile(tile), given, ALL_STREAMS)
        try:
            content = self._reader.tile(models, tile, row, ALL_STREAMS)
        except ScarError as error:
            return "values" if found is not None else native.tile_refusal() or "nothing", error.refusal
        if found is None:
            return native.tile_refusal() or "nothing", "values"
        channels, fields = native.channels, self._reader.header.fields
        rooms = [
            empty_anchors(fields, self._layers, lambda: models, channels, native.stages, len(content)) for _ in range(2)
        ]
        rooms[0].put_native(tile, found)
        rooms[1].put_content(self._reader, models.model, tile, content)
        one, other = (b"".join(array.tobytes() for array in room.arrays()) for room in rooms)
        return ("", "") if one == other else ("values of C", "values of NumPy")

    def _opened(self, payloads: dict[Entry, bytes]) -> NativeFile:
        header = self._reader.header
        blocks = {(entry.layer, entry.kind): payload for entry, payload in payloads.items()}
        return NativeFile(load(), header.fields, header.file_length, self._layers, blocks)

    def _loaded(self, payloads: dict[Entry, bytes], changed: tuple[int, int] | None) -> SceneModels:
        header = self._reader.header
        contents = Contents(header.file_length, self._reader.container.limits)
        return load_models(header.fields, self._layers, _Remembered(payloads, contents, self._known, changed))


class Changes:
    """Mutant n: a block of a sound file, and what takes its place."""

    def __init__(self, files: list[Sound], seed: int) -> None:
        self._files, self._seed = files, seed
        self._blocks = [list(file.blocks.items()) for file in files]
        self._alike: dict[int, list[bytes]] = {}
        for entry, payload in (item for items in self._blocks for item in items):
            self._alike.setdefault(entry.kind, []).append(payload)

    def __call__(self, number: int) -> tuple[Sound, Entry, bytes, int]:
        """The file, the block's entry, the bytes and the count that take its place."""
        dice = Dice(self._seed << 40 | number)
        at = dice.randrange(len(self._files))
        entry, payload = dice.choice(self._blocks[at])
        dice.others = self._alike[entry.kind]
        count = entry.count
        for _ in range(dice.choice((1, 1, 1, 2, 3))):
            try:
                payload = self._changed(entry.kind, payload, dice) or b"\0"
            except NOT_HERE:
                continue
        if entry.tile is not None:
            if dice.random() < 0.1:
                count = min(dice.choice((1, 2, count + 1, max(1, count - 1), 2 * count)), MAX_ANCHORS_PER_TILE)
            payload = resealed_tile(payload)
        return self._files[at], entry, payload, count

    def _changed(self, kind: int, payload: bytes, dice: Dice) -> bytes:
        if dice.random() < 0.05:
            return dice.choice(dice.others)
        of_kind = ON_PAYLOADS.get(kind, ())
        if of_kind and dice.random() < 0.8:
            return dice.choice(of_kind)(payload, dice)
        return dice.choice(_ANYWHERE)(payload, dice)


def prepare(seed: int) -> Callable[[int], Case]:
    """Changed blocks of the sound files of the corpus."""
    # Decoders may differ on files of `either`.
    files = [seed for seed in corpus() if len(seed.data) <= MAX_BYTES and not seed.name.startswith("either/")]
    return partial(case, Changes([Sound(one) for one in files if not decoded(one.data)], seed))


def case(make: Changes, number: int) -> Case:
    """A changed block, and the answers of both engines about it."""
    file, entry, payload, count = make(number)
    name = f"{number} {file.name}: layer {entry.layer} {BlockKind(entry.kind).name}, count {count}"
    return Case(name, payload, partial(compare, file, entry, payload, count))


def compare(file: Sound, entry: Entry, payload: bytes, count: int) -> tuple[str, str | None]:
    """What both engines make of a block: the refusal or "decoded", and whether they differ."""
    native, defined = file.answers(entry, payload, count)
    if native == defined:
        return native or "decoded", None
    if "bad-zstd" in (native, defined):
        return "either", None  # Zstandard libraries may differ (R-5.8-4)
    return "different", f"the C library: {native}, NumPy: {defined}"
