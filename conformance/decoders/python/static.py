"""A whole file without networks and masks, read in the order of SPEC §12.2: container, static coding, channels, values.

Files of the explicit profile without codebooks need nothing else; :mod:`conformance.decoders.python.decoder` adds what
SPEC-neural.md has. Nothing here is fast, and nothing is imported but the standard library.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from functools import partial

from conformance.decoders.python.fields import (
    CLASSES,
    INDICES,
    LATENT,
    MASKS,
    OFFSETS,
    POSITION_RESIDUAL,
    POSITIONS,
    Rans,
    Refused,
    Table,
    cumulative,
    key,
    require,
)
from conformance.decoders.python.front import (
    DECODER_MLP,
    LAYER,
    LIMITS,
    NO_TILE,
    PREDICTORS,
    TABLES,
    TILE,
    Limits,
    Root,
    read_entries,
    read_header,
    read_tiles,
)
from conformance.decoders.python.models import (
    Opening,
    Row,
    Shape,
    check_opening,
    check_rows,
    has_latents,
    parse_layer,
    parse_networks,
    parse_tables,
)
from conformance.decoders.python.numbers import Budget, Numbers
from conformance.decoders.python.positions import read_positions
from conformance.decoders.python.tile import NAMES, Tile, Trace, substreams, table_contexts


class StaticDecoder:
    """A file's first layers. `traces` has one element a layer.

    Raises:
        Refused: with the id of the first check that fails (SPEC §12.2).
    """

    def __init__(self, data: bytes, layers: int | None = None, limits: Limits = LIMITS) -> None:
        header, summaries = read_header(data, limits)
        self.limits = limits
        self.profile, self.degree, self.slots = header["profile"], header["sh_degree"], header["slots"]
        self.lattice_bits, self.origin, self.voxel = header["lattice_bits"], header["origin"], header["voxel"]
        self.file_length, self.k = header["file_length"], layers or len(summaries)
        root = Root(data, limits)
        root.check(header, summaries)
        self.pages = len(root.pages)
        self.tiles = read_tiles(data, root)
        self.blocks: dict[tuple[int, int, int], tuple[bytes, int]] = {}
        self.damaged: set[tuple[int, int, int]] = set()
        for entry in read_entries(data, root):
            block, place = data[entry.offset : entry.offset + entry.length], (entry.layer, entry.kind, entry.tile)
            self.blocks[place] = block, entry.count
            # A block it has no need of is no reason to refuse (R-5.6-3): neither METADATA nor an unknown one.
            read = entry.layer <= self.k and (entry.kind <= PREDICTORS or entry.kind == TILE)
            if read and zlib.crc32(block) != entry.crc32:
                self.damaged.add(place)
        require(all(kind == TILE for _, kind, _ in self.damaged), "crc-mismatch")
        self.traces = [Trace() for _ in range(self.k)]
        self.budget = Budget((1 << 20) + limits.numbers_per_byte * self.file_length)
        self._layer_table()
        self.read_models()

    def model(self, layer: int, kind: int) -> bytes | None:
        return self.blocks.get((layer, kind, NO_TILE), (None, 0))[0]

    def numbers(self, block: bytes) -> Numbers:
        """The numbers of a block, which count towards those that the file may have (SPEC §13.2)."""
        return Numbers(block, self.budget)

    def needed(self, layer: int, kind: int) -> bytes:
        block = self.model(layer, kind)
        if block is None:
            raise Refused("missing-block")
        return block

    def _layer_table(self) -> None:
        """Lists 4 and 5 of §12.2."""
        self.opening = Opening([], 0, [])
        self.rows: list[Row] = []
        self.tables: list[dict[int, Table]] = []
        for k in range(1, self.k + 1):
            row, self.opening = parse_layer(self.numbers(self.needed(k, LAYER)), k, self.opening)
            self.rows.append(row)
            tables, added = dict(self.tables[-1] if self.tables else {}), self.model(k, TABLES)
            if added is not None:
                found = parse_tables(self.numbers(added)).items()
                tables |= {number: Table(values, cumulative(weights)) for number, (values, weights) in found}
            self.tables.append(tables)
        self.channels = self.opening.channels
        check_opening(self.opening, self.profile)
        check_rows(self.rows, self.channels, self.profile)

    def first_layer(self, holds: Callable[[Row], bool]) -> int:
        """The first layer whose row is so, 0 if there is none."""
        return next((k for k, row in enumerate(self.rows, start=1) if holds(row)), 0)

    def read_models(self) -> None:
        """Lists 6 and 7 of §12.2 for files that have one model at most, DECODER_MLP."""
        latents = self.first_layer(lambda row: has_latents(row, self.channels))
        for k in range(1, self.k + 1):
            for kind in range(DECODER_MLP - 1, PREDICTORS):
                expected = kind == DECODER_MLP and k == latents
                require(expected or self.model(k, kind) is None, "unexpected-block")
        self.read_decoder(latents)
        self.check_outputs()

    def read_decoder(self, layer: int) -> None:
        """DECODER_MLP, of the first layer with a latent; 0 for none."""
        self.networks: list[Shape] = []
        self.dimension = 0
        if layer:
            self.networks = parse_networks(self.numbers(self.needed(layer, DECODER_MLP)))
            require(len(self.networks) == 1, "bad-mlp")
            self.dimension = self.networks[0][0][1]
        refined = [channel for channel in self.channels if channel.stream == LATENT]
        require(not layer or all(channel.components == self.dimension for channel in refined), "bad-mlp")

    def check_outputs(self) -> None:
        """R-7.9-3."""
        if self.networks and not self.profile:
            colour = any(NAMES[channel.stream] == "COLOUR" for channel in self.channels)
            require(self.networks[0][-1][0] == 3 * ((self.degree + 1) ** 2 - colour), "bad-mlp")

    def classes(self, k: int) -> int:
        return len(self.rows[k - 1].classes) if k else 0

    def stages(self, k: int, c: int) -> int:
        return self.rows[k - 1].classes[c][0] if c < self.classes(k) else 0

    def steps(self, k: int, i: int, c: int) -> int:
        return self.rows[k - 1].classes[c][1][i] if c < self.classes(k) else 0

    # ------------------------------------------------------------------------------------------ 7 and 8 tiles

    def tile(self, number: int) -> Tile:
        out = Tile(self.slots if self.profile else 0, self.channels)
        for k in range(1, self.k + 1):
            place = (k, TILE, number)
            require(place not in self.damaged, "crc-mismatch")
            block, new = self.blocks.get(place, (None, 0))
            kinds = {INDICES, *(channel.stream for channel in self.channels), *((MASKS,) if self.profile else ())}
            kinds |= {POSITIONS, CLASSES} if new else set()
            self._layer(out, k, substreams(block, kinds) if block else {}, new, number)
        return out

    def _layer(self, tile: Tile, k: int, parts: dict[int, bytes], new: int, number: int) -> None:
        def read(stream: int, reader: Callable[[Rans], None]) -> None:
            rans = Rans(parts.get(stream, b""), self.tables[k - 1])
            reader(rans)
            rans.seal()
            trace = self.traces[k - 1]
            trace.used |= rans.used
            trace.unwritten |= rans.first is not None and stream not in parts
            if stream != INDICES:
                trace.see(NAMES[stream], rans.first)

        if new:
            codes: list[int] = []
            read(POSITIONS, lambda rans: codes.extend(read_positions(rans, new, self.local_bits(number))))
            read(CLASSES, lambda rans: self._classes(rans, tile, k, codes))
        if self.profile:
            read(MASKS, lambda rans: self.read_masks(rans, tile, k))
        self.begin(tile, number)
        for i, channel in enumerate(self.channels):
            read(channel.stream, partial(self.read_channel, tile=tile, k=k, i=i))
            if channel.stream == POSITION_RESIDUAL:
                self._check_residuals(tile, k, i)
        read(INDICES, lambda rans: self.read_indices(rans, tile, k, number))

    def _check_residuals(self, tile: Tile, k: int, i: int) -> None:
        for c, values in zip(tile.klass, tile.v[i], strict=True):
            n = self.steps(k, i, c)
            require(all(abs(float(v) * self.width(i, j, n)) <= 1 for j, v in enumerate(values)), "value-range")

    def begin(self, tile: Tile, number: int) -> None:
        """Called when the anchors of a layer of a tile are known."""

    def read_masks(self, rans: Rans, tile: Tile, k: int) -> None:
        """Slots that turn on: of the anchor profile."""

    def read_indices(self, rans: Rans, tile: Tile, k: int, number: int) -> None:
        """Codewords: of files with codebooks."""

    def local_bits(self, number: int) -> int:
        return int(self.lattice_bits - sum(self.tiles[number][:2]))

    def _classes(self, rans: Rans, tile: Tile, k: int, codes: list[int]) -> None:
        f, p, new = self.classes(k - 1), self.classes(k), len(codes)
        classes = [f + v for v in rans.read(key(CLASSES, 0, 0, 0), new)] if p - f > 1 else [f] * new
        require(all(f <= c < p for c in classes), "bad-class")
        for code, klass in zip(codes, classes, strict=True):
            tile.append(code, klass)

    def read_channel(self, rans: Rans, tile: Tile, k: int, i: int) -> None:
        for n in range(1, 21):
            chosen = [a for a, c in enumerate(tile.klass) if self.steps(k - 1, i, c) < n <= self.steps(k, i, c)]
            if chosen:
                self.read_step(rans, tile, k, (i, n, chosen))

    def read_step(self, rans: Rans, tile: Tile, k: int, place: tuple[int, int, list[int]]) -> None:
        """Step n of channel i for some anchors, in layer k."""
        i, n, chosen = place
        self.refine(rans, tile, place, lambda j: table_contexts(tile, i, j, n, chosen))

    def refine(
        self, rans: Rans, tile: Tile, place: tuple[int, int, list[int]], contexts: Callable[[int], list[int]]
    ) -> None:
        """The symbols of a step, component by component, with the contexts of each."""
        (i, n, chosen), v = place, tile.v[place[0]]
        trits = []
        for j in range(self.channels[i].components):
            values = rans.read_by_context(key(self.channels[i].stream, j, n, 0), contexts(j))
            if n > 1:
                trits.append(values)
                continue
            for a, x in zip(chosen, values, strict=True):
                v[a][j] = x
        require(all(-1 <= t <= 1 for values in trits for t in values), "bad-trit")
        for j, values in enumerate(trits):
            for a, t in zip(chosen, values, strict=True):
                v[a][j] = 3 * v[a][j] + t
        require(all(abs(x) < 1 << 31 for a in chosen for x in v[a]), "value-range")

    # ------------------------------------------------------------------------------------------ 9 reconstruction

    def width(self, i: int, j: int, n: int) -> float:
        return cell_width(self.channels[i].first_widths[j], n)

    def positions(self, number: int, tile: Tile) -> list[list[float]]:
        depth, shift, prefix = self.tiles[number]
        corner = [x << (self.lattice_bits - depth) for x in deinterleave(prefix)]
        residual = next((i for i, channel in enumerate(self.channels) if channel.stream == POSITION_RESIDUAL), None)
        out = []
        for a, code in enumerate(tile.code):
            local, place = deinterleave(code), []
            for axis in range(3):
                r = None
                if residual is not None:
                    n = self.steps(self.k, residual, tile.klass[a])
                    r = float(tile.v[residual][a][axis]) * self.width(residual, axis, n)
                t = lattice_place(corner[axis], local[axis], shift, r)
                place.append(self.origin[axis] + self.voxel * t)
            out.append(place)
        return out

    def value(self, i: int, c: int, values: list[int]) -> list[float]:
        n = 1 if self.channels[i].stream == OFFSETS else self.steps(self.k, i, c)
        return [f32(float(v) * self.width(i, j, n)) for j, v in enumerate(values)]


def cell_width(first_width: float, n: int) -> float:
    """w(n) of SPEC §9: the width of a cell after n steps."""
    return first_width / float(3 ** (n - 1)) if n else 0.0


def lattice_place(corner: int, local: int, shift: int, r: float | None) -> float:
    """t of SPEC §9.1 along one axis; r is None without a channel POSITION_RESIDUAL."""
    cell = float(1 << shift)
    t = (float(corner) + float(local) * cell) + cell / 2.0
    return t if r is None else t + cell * r


def deinterleave(code: int) -> list[int]:
    return [sum((code >> (3 * bit + axis) & 1) << bit for bit in range(21)) for axis in range(3)]


def f32(x: float) -> float:
    """x rounded to binary32, to nearest, ties to even."""
    return float(struct.unpack("<f", struct.pack("<f", x))[0])
