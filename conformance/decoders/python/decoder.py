"""A second decoder, written from SPEC.md alone: standard library, plain loops, its pseudo-code function by function.

It shows that the text suffices, and is a start for a port. It decodes the exact class (SPEC §5-§8, §9.1, §9.2, §10) of
valid files whose Zstandard frames are like those of the vectors; of the refusals it makes only those the pseudo-code
spells out. ``python -m conformance.decoders.python FILE --layers K --stage STAGE`` answers as PROTOCOL.md says.
"""

from __future__ import annotations

import struct
import zlib

from conformance.decoders.python.context import Context, fine
from conformance.decoders.python.fields import (
    CLASSES,
    INDICES,
    LATENT,
    MASKS,
    OFFSETS,
    POSITION_RESIDUAL,
    POSITIONS,
    Payload,
    Rans,
    Table,
    key,
    parse_tables,
    require,
)
from conformance.decoders.python.front import NO_TILE, TILE, Root, read_entries, read_tiles
from conformance.decoders.python.hash_grid import Grid, parse_grid
from conformance.decoders.python.index_network import Network, parse_network
from conformance.decoders.python.models import Opening, Row, network_inputs, parse_codebooks, parse_layer
from conformance.decoders.python.neural_indices import IndexReader
from conformance.decoders.python.positions import read_positions
from conformance.decoders.python.predictors import ATTRIBUTES, Key, Predictor, StepInputs, parse_predictors
from conformance.decoders.python.tile import NAMES, Tile, Trace, read_masks, read_offsets, substreams, table_contexts


class Decoder:
    """A file's first layers (SPEC §4, steps 1 to 11). `traces` has one element a layer."""

    def __init__(self, data: bytes, layers: int | None = None) -> None:
        head = Payload(data)
        require(head.take(9) == bytes.fromhex("8953434152 0d0a1a0a"), "bad-signature")
        require(head.fields("BB") == (0, 2), "unsupported-version")
        _, length, self.file_length = head.fields("BIQ")
        (crc,) = struct.unpack("<I", data[length - 4 : length])
        require(zlib.crc32(data[: length - 4]) == crc, "header-crc-mismatch")
        self.profile, self.degree, layer_count, self.slots, self.lattice_bits, *_ = head.fields("8B")
        self.k = layers or layer_count
        head.at = 56
        *self.origin, self.voxel = head.fields("4d")
        root = Root(data)
        self.pages = len(root.pages)
        self.tiles = read_tiles(data, root)
        self.blocks: dict[tuple[int, int, int], tuple[bytes, int]] = {}
        for entry in read_entries(data, root):
            require(entry.kind in (*range(1, 9), 16, 64) or not entry.flags & 1, "unknown-critical-block")
            block = data[entry.offset : entry.offset + entry.length]
            # A block it has no need of is no reason to refuse (R-5.6-3): neither METADATA nor an unknown one.
            unused = entry.kind > TILE or entry.layer > self.k
            require(unused or zlib.crc32(block) == entry.crc32, "crc-mismatch")
            self.blocks[entry.layer, entry.kind, entry.tile] = block, entry.count
        self.traces = [Trace() for _ in range(self.k)]
        self._models()

    def _model(self, layer: int, kind: int) -> bytes | None:
        return self.blocks.get((layer, kind, NO_TILE), (None, 0))[0]

    def _models(self) -> None:
        self.opening = Opening([], 0, [])
        self.rows: list[Row] = []
        self.tables: list[dict[int, Table]] = []
        self.books: dict[int, list[list[int]]] = {}
        self.dimension = 0
        self.predictors: list[dict[Key, Predictor]] = []
        self.network: Network | None = None
        self.grid: Grid | None = None
        for k in range(1, self.k + 1):
            block = self._model(k, 1)
            require(block is not None, "missing-block")
            row, self.opening = parse_layer(block or b"", k, self.opening)
            self.rows.append(row)
            added = self._model(k, 2)
            self.tables.append({**(self.tables[-1] if self.tables else {}), **(parse_tables(added) if added else {})})
            books, decoder = self._model(k, 3), self._model(k, 4)
            self.books |= parse_codebooks(books) if books else {}
            self.dimension = network_inputs(decoder) if decoder else self.dimension
            self._neural_models(k)
        self.channels = self.opening.channels

    def _neural_models(self, k: int) -> None:
        grid, network, predictors = (self._model(k, kind) for kind in (6, 7, 8))
        self.grid = parse_grid(grid) if grid else self.grid
        self.network = parse_network(network) if network else self.network
        before = self.predictors[-1] if self.predictors else {}
        self.predictors.append({**before, **(parse_predictors(predictors) if predictors else {})})

    def classes(self, k: int) -> int:
        return len(self.rows[k - 1].classes) if k else 0

    def stages(self, k: int, c: int) -> int:
        return self.rows[k - 1].classes[c][0] if c < self.classes(k) else 0

    def steps(self, k: int, i: int, c: int) -> int:
        return self.rows[k - 1].classes[c][1][i] if c < self.classes(k) else 0

    def tile(self, number: int) -> Tile:
        out = Tile(self.slots if self.profile else 0, self.channels)
        for k in range(1, self.k + 1):
            block, new = self.blocks.get((k, TILE, number), (None, 0))
            parts = substreams(block) if block else {}
            self._layer(out, k, parts, new, number)
        return out

    def _layer(self, tile: Tile, k: int, parts: dict[int, bytes], new: int, number: int) -> None:
        depth, shift = self.tiles[number][:2]
        b = self.lattice_bits - depth - shift
        trace = self.traces[k - 1]

        def opened(stream: int) -> Rans:
            return Rans(parts.get(stream, b""), self.tables[k - 1])

        def close(stream: int, rans: Rans) -> None:
            rans.seal()
            trace.used |= rans.used
            trace.unwritten |= rans.first is not None and stream not in parts
            if stream != INDICES:
                trace.see(NAMES[stream], rans.first)

        if new:
            rans = opened(POSITIONS)
            codes = read_positions(rans, new, b)
            close(POSITIONS, rans)
            rans, f, p = opened(CLASSES), self.classes(k - 1), self.classes(k)
            classes = [f + v for v in rans.read(key(CLASSES, 0, 0, 0), new)] if p - f > 1 else [f] * new
            close(CLASSES, rans)
            require(all(f <= c < p for c in classes), "bad-class")
            for code, klass in zip(codes, classes, strict=True):
                tile.append(code, klass)
        if self.profile:
            rans = opened(MASKS)
            read_masks(rans, tile, k)
            close(MASKS, rans)
        context = Context(tile.code, b, self.opening.targets, self.opening.passes_log2)
        for i, channel in enumerate(self.channels):
            rans = opened(channel.stream)
            if channel.stream == OFFSETS:
                read_offsets(rans, tile, k, i)
            else:
                self._channel(rans, tile, k, i, context)
            close(channel.stream, rans)
        rans = opened(INDICES)
        if self.rows[k - 1].mode == 1:
            self._neural_indices(rans, tile, k, context, number)
        else:
            self._indices(rans, tile, k)
        close(INDICES, rans)

    def _channel(self, rans: Rans, tile: Tile, k: int, i: int, context: Context) -> None:
        channel = self.channels[i]
        before = [self.steps(k - 1, i, c) for c in tile.klass]
        after = [self.steps(k, i, c) for c in tile.klass]
        for n in range(1, 21):
            chosen = [a for a in range(len(before)) if before[a] < n <= after[a]]
            components = range(len(channel.rules))
            if chosen and any((channel.stream, j, n) in self.predictors[k - 1] for j in components):
                self._predicted_step(rans, tile, k, (i, n, chosen), context)
                continue
            for j in components:
                self._refine(rans, tile, (i, j, n), chosen, table_contexts(tile, i, j, n, chosen))

    def _refine(
        self, rans: Rans, tile: Tile, place: tuple[int, int, int], chosen: list[int], contexts: list[int]
    ) -> None:
        """Step n of component j of channel i for some anchors."""
        (i, j, n), v = place, tile.v[place[0]]
        values = rans.read_by_context(key(self.channels[i].stream, j, n, 0), contexts)
        for a, x in zip(chosen, values, strict=True):
            if n == 1:
                v[a][j] = tile.first[i][a][j] = x
            else:
                require(-1 <= x <= 1, "bad-trit")
                v[a][j] = 3 * v[a][j] + x
            require(abs(v[a][j]) < 1 << 31, "value-range")

    def _fine(self, tile: Tile, k: int, i: int, a: int) -> list[int]:
        """Fine values of a channel of an anchor after layer k."""
        n = self.steps(k, i, tile.klass[a])
        return [fine(v, n) for v in tile.v[i][a]]

    def _attributes(self, tile: Tile, k: int, a: int, past: int) -> list[int]:
        """Fine values of the attribute channels below channel `past` after layer k."""
        chosen = [i for i in range(past) if self.channels[i].stream in ATTRIBUTES]
        return [v for i in chosen for v in self._fine(tile, k, i, a)]

    def _predicted_step(
        self, rans: Rans, tile: Tile, k: int, place: tuple[int, int, list[int]], context: Context
    ) -> None:
        i, n, chosen = place
        v, stream, components = tile.v[i], self.channels[i].stream, len(self.channels[i].rules)
        sums = context.cells(components)
        for a, klass in enumerate(tile.klass):
            if self.steps(k - 1, i, klass) >= n:
                sums.add(a, self._fine(tile, k - 1, i, a))
        for part in context.passes(chosen):
            around = {a: sums.around(a) for a in part}
            own = {a: [fine(x, n - 1) for x in v[a]] for a in part}
            before = {a: self._attributes(tile, k, a, i) for a in part}
            for j in range(components):
                predictor = self.predictors[k - 1].get((stream, j, n))
                contexts = table_contexts(tile, i, j, n, part)
                if predictor:
                    inputs = [StepInputs(tile.klass[a], before[a], own[a], tile.first[i][a], n) for a in part]
                    contexts = [predictor.context(x.of(j, around[a])) for a, x in zip(part, inputs, strict=True)]
                    self.traces[k - 1].contexts.setdefault((stream, j, n), []).extend(contexts)
                self._refine(rans, tile, (i, j, n), part, contexts)
            for a in part:
                sums.add(a, [fine(x, n) for x in v[a]])

    def _neural_indices(self, rans: Rans, tile: Tile, k: int, context: Context, number: int) -> None:
        assert self.network is not None
        before = [self.stages(k - 1, c) for c in tile.klass]
        after = [self.stages(k, c) for c in tile.klass]
        settled = [self._attributes(tile, k, a, len(self.channels)) for a in range(len(before))]
        grid = self.grid

        def features(a: int) -> list[int]:
            return grid.features(self.middle(number, tile.code[a])) if grid else []

        reader = IndexReader(self.network, self.books, context, tile.klass, settled, features)
        reader.read(rans, tile.index, before, after)
        self.traces[k - 1].embedded += reader.embedded
        for stage, table in sorted(reader.tables.items()):
            self.traces[k - 1].see(f"INDICES.{stage}", table)

    def _indices(self, rans: Rans, tile: Tile, k: int) -> None:
        before = [self.stages(k - 1, c) for c in tile.klass]
        after = [self.stages(k, c) for c in tile.klass]
        for stage in range(1, 9):
            chosen = [a for a in range(len(before)) if before[a] < stage <= after[a]]
            contexts = [16 * tile.klass[a] + (stage > 1 and tile.index[a][stage - 1] == 0) for a in chosen]
            rans.forget()
            for a, value in zip(chosen, rans.read_by_context(key(INDICES, stage, 0, 0), contexts), strict=True):
                require(0 <= value < len(self.books[min(stage - 1, 1)]), "bad-index")
                tile.index[a][stage] = value
            self.traces[k - 1].see(f"INDICES.{stage}", rans.first)

    # ------------------------------------------------------------------------------------------ 9 reconstruction

    def width(self, i: int, j: int, n: int) -> float:
        return cell_width(self.channels[i].first_widths[j], n)

    def positions(self, number: int, tile: Tile) -> list[list[float]]:
        depth, shift, prefix = self.tiles[number]
        corner = [x << (self.lattice_bits - depth) for x in deinterleaved(prefix)]
        residual = next((i for i, channel in enumerate(self.channels) if channel.stream == POSITION_RESIDUAL), None)
        out = []
        for a, code in enumerate(tile.code):
            local, place = deinterleaved(code), []
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

    def codeword_sum(self, tile: Tile, a: int) -> list[int]:
        z = [0] * self.dimension
        for stage in range(1, self.stages(self.k, tile.klass[a]) + 1):
            z = [x + y for x, y in zip(z, self.books[min(stage - 1, 1)][tile.index[a][stage]], strict=True)]
        return z

    def latent(self, tile: Tile, a: int) -> list[float]:
        z = self.codeword_sum(tile, a)
        refined = next((i for i, channel in enumerate(self.channels) if channel.stream == LATENT), None)
        if refined is None:
            return [float(x) for x in z]
        more = self.value(refined, tile.klass[a], tile.v[refined][a])
        return [f32(float(x) + y) for x, y in zip(z, more, strict=True)]

    def middle(self, number: int, code: int) -> list[int]:
        """The lattice point in the middle of an anchor's cell."""
        depth, shift, prefix = self.tiles[number]
        corner = [x << (self.lattice_bits - depth) for x in deinterleaved(prefix)]
        return [c + (x << shift) + (1 << shift >> 1) for c, x in zip(corner, deinterleaved(code), strict=True)]


def cell_width(first_width: float, n: int) -> float:
    """w(n) of SPEC §9: the width of a cell after n steps."""
    return first_width / float(3 ** (n - 1)) if n else 0.0


def lattice_place(corner: int, local: int, shift: int, r: float | None) -> float:
    """t of SPEC §9.1 along one axis; r is None without a channel POSITION_RESIDUAL."""
    cell = float(1 << shift)
    t = (float(corner) + float(local) * cell) + cell / 2.0
    return t if r is None else t + cell * r


def deinterleaved(code: int) -> list[int]:
    return [sum((code >> (3 * bit + axis) & 1) << bit for bit in range(21)) for axis in range(3)]


def f32(x: float) -> float:
    """x rounded to binary32, to nearest, ties to even."""
    return float(struct.unpack("<f", struct.pack("<f", x))[0])
