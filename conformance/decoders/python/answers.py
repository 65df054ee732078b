"""The readable decoder's answers in the decoder protocol (PROTOCOL.md), for every exact stage."""

from __future__ import annotations

import argparse
import hashlib
import json
import mmap
import os
import struct
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from conformance.decoders.python.container import container_fields
from conformance.decoders.python.decoder import Decoder
from conformance.decoders.python.fields import OFFSETS, POSITION_RESIDUAL, Refused
from conformance.decoders.python.metadata import read_metadata
from conformance.decoders.python.streaming import read_streaming
from conformance.decoders.python.tile import NAMES, Tile


class Array(NamedTuple):
    """Numbers of a type, in C order."""

    dtype: str
    shape: Sequence[int]
    values: list[Any]


Arrays = dict[str, Array]

EXACT = ("models", "context", "frequencies", "indices", "integers", "sums", "values")
READERS = {"metadata": read_metadata, "streaming": read_streaming}
"""Readers of blocks that a decode reads only if asked."""
STAGES = ("container", *EXACT, *READERS)
CAPABILITIES = {
    "protocol": "scar-conformance 2",
    "decoder": "scarfmt readable decoder 0.3",
    "versions": ["0.3"],
    "profiles": ["explicit", "anchor"],
    "stages": list(STAGES),
}
_MAPPED = 1 << 24
"""Bytes of a file from which on it is mapped, not read."""
_FIRST = 8
_CODES = {"<u4": "I", "<u8": "Q", "|u1": "B", "<u2": "H", "<i4": "i", "<f8": "d", "<f4": "f"}


def array(dtype: str, shape: Sequence[int], values: Iterable[Any]) -> Array:
    """An array of these numbers."""
    return Array(dtype, shape, list(values))


def pin(found: Array) -> dict[str, Any]:
    """Type, shape, SHA-256 and the first numbers of an array."""
    code = _CODES[found.dtype]
    data = struct.pack(f"<{len(found.values)}{code}", *found.values)
    first = struct.unpack_from(f"<{min(len(found.values), _FIRST)}{code}", data)
    digest = hashlib.sha256(data).hexdigest()
    return {"dtype": found.dtype, "shape": list(found.shape), "sha256": digest, "first": list(first)}


def _flat(rows: Iterable[Iterable[Any]]) -> list[Any]:
    return [x for row in rows for x in row]


class Answers:
    """The arrays of each stage after the last layer of a decoder."""

    def __init__(self, decoder: Decoder) -> None:
        self.decoder = decoder
        self.tiles = [decoder.tile(number) for number in range(len(decoder.tiles))]
        self.trace = decoder.traces[-1]
        self.n = sum(len(tile.code) for tile in self.tiles)

    def stage(self, name: str) -> dict[str, Any]:
        """The arrays of an exact stage as they are answered, by name."""
        found: Arrays = getattr(self, name)()
        return {name: pin(one) for name, one in sorted(found.items())}

    def models(self) -> Arrays:
        d = self.decoder
        out = {f"codebook.{b}": array("<i4", (len(book), len(book[0])), _flat(book)) for b, book in d.books.items()}
        for number, (level, bits) in enumerate(d.grid.levels if d.grid else []):
            out[f"grid.bits.{number}"] = array("|u1", (level.entries, level.features), bits)
        return out

    def context(self) -> Arrays:
        d, out = self.decoder, {}
        if d.grid:
            places = [d.middle(i, code) for i, tile in enumerate(self.tiles) for code in tile.code]
            width = sum(level.features for level, _ in d.grid.levels)
            out["grid.features"] = array("<i4", (self.n, width), _flat(map(d.grid.features, places)))
        embedded = self.trace.embedded
        if embedded:
            out["embedding"] = array("<i4", (len(embedded), len(embedded[0])), _flat(embedded))
        for (stream, j, step), contexts in self.trace.contexts.items():
            if contexts:
                out[f"context.{NAMES[stream]}.{j}.{step}"] = array("<i4", (len(contexts),), contexts)
        return out

    def frequencies(self) -> Arrays:
        return {f"frequencies.{name}": array("<u4", (len(f),), f) for name, f in self.trace.frequencies.items()}

    def indices(self) -> Arrays:
        stages = max((stages for stages, _ in self.decoder.rows[-1].classes), default=0)
        rows = [row[1 : stages + 1] for tile in self.tiles for row in tile.index]
        return {"index": array("<u2", (self.n, stages), _flat(rows))}

    def integers(self) -> Arrays:
        out = {
            "tile": array("<u4", (self.n,), (number for number, tile in enumerate(self.tiles) for _ in tile.code)),
            "code": array("<u8", (self.n,), _flat(tile.code for tile in self.tiles)),
            "class": array("|u1", (self.n,), _flat(tile.klass for tile in self.tiles)),
        }
        if self.decoder.profile:
            rows = [row for tile in self.tiles for row in tile.slot_layer]
            out["slot_layer"] = array("|u1", (self.n, self.decoder.slots), _flat(rows))
        for i, channel in enumerate(self.decoder.channels):
            rows = [row for _, row in self._rows(i)]
            out[f"v.{NAMES[channel.stream]}"] = array("<i4", self._shape(i), _flat(rows))
        return out

    def sums(self) -> Arrays:
        d = self.decoder
        if not d.dimension:
            return {}
        sums = _flat(d.codeword_sum(*at) for at in self._anchors())
        return {"codeword_sum": array("<i4", (self.n, d.dimension), sums)}

    def values(self) -> Arrays:
        d = self.decoder
        places = _flat(d.positions(number, tile) for number, tile in enumerate(self.tiles))
        out = {"position": array("<f8", (self.n, 3), _flat(places))}
        for i, channel in enumerate(d.channels):
            if channel.stream != POSITION_RESIDUAL:
                values = _flat(d.value(i, klass, row) for klass, row in self._rows(i))
                out[f"value.{NAMES[channel.stream]}"] = array("<f4", self._shape(i), values)
        if d.dimension:
            out["latent"] = array("<f4", (self.n, d.dimension), _flat(d.latent(*at) for at in self._anchors()))
        return out

    def _anchors(self) -> list[tuple[Tile, int]]:
        return [(tile, a) for tile in self.tiles for a in range(len(tile.code))]

    def _shape(self, i: int) -> list[int]:
        channel = self.decoder.channels[i]
        slots = [self.decoder.slots] if channel.stream == OFFSETS else []
        return [self.n, *slots, channel.components]

    def _rows(self, i: int) -> list[tuple[int, list[int]]]:
        """Class and integers of each anchor, or of each slot, of a channel."""
        rows = [(tile.klass[a], row) for tile in self.tiles for a, row in enumerate(tile.v[i])]
        if self.decoder.channels[i].stream == OFFSETS:
            return [(klass, row) for klass, slots in rows for row in slots]
        return rows


def answer(data: bytes, layers: int, stage: str) -> dict[str, Any]:
    """The answer to one question; `layers` 0 is all, stage ``all`` the container and every exact stage."""
    if stage == "capabilities":
        return {"capabilities": CAPABILITIES}
    try:
        if stage in READERS:
            return {"stages": {stage: {stage: READERS[stage](data)}}}
        answers = Answers(Decoder(data, layers or None))
    except Refused as refusal:
        return {"refused": str(refusal), "offset": None, "message": "a rule is broken"}
    stages = {name: {"arrays": answers.stage(name)} for name in EXACT if stage in ("all", name)}
    container = {"container": {"container": container_fields(data)}} if stage in ("all", "container") else {}
    return {"stages": {**container, **stages}}


def answer_file(path: Path, layers: int, stage: str) -> dict[str, Any]:
    """The answer to a question about a file, which may be sparse and larger than memory."""
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_size < _MAPPED:
            return answer(file.read(), layers, stage)
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
            return answer(mapped, layers, stage)  # type: ignore[arg-type]


def main(arguments: list[str]) -> int:
    """Answer one question, or those on standard input, a line each."""
    parser = argparse.ArgumentParser(prog="python -m conformance.decoders.python")
    parser.add_argument("file", type=Path, nargs="?")
    parser.add_argument("--layers", type=int, default=0)
    parser.add_argument("--stage", choices=("all", "capabilities", *STAGES), default="all")
    parser.add_argument("--session", action="store_true", help="read questions from standard input")
    options = parser.parse_args(arguments)
    if options.session == (options.file is not None):
        parser.error("give a file or --session")
    if not options.session:
        print(json.dumps(answer_file(options.file, options.layers, options.stage)))
        return 0
    for line in sys.stdin:
        asked = json.loads(line)
        print(json.dumps(answer_file(Path(asked["file"]), asked["layers"], asked["stage"])), flush=True)
    return 0
