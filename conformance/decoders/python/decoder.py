"""A whole file: what :mod:`conformance.decoders.python.static` reads, and what SPEC-neural.md adds to it."""

from __future__ import annotations

from functools import partial

from conformance.decoders.python.arithmetic import Matrix, Vector
from conformance.decoders.python.context import Context, fine
from conformance.decoders.python.fields import INDICES, LATENT, MASKS, OFFSETS, Rans, key, require
from conformance.decoders.python.front import (
    CODEBOOKS,
    DECODER_MLP,
    ENTROPY_NETWORK,
    HASH_GRID,
    PREDICTORS,
    SCENE_MLP,
)
from conformance.decoders.python.hash_grid import Grid, parse_grid
from conformance.decoders.python.index_network import Network, check_network, parse_network
from conformance.decoders.python.models import Row, has_latents, parse_networks
from conformance.decoders.python.neural_indices import IndexReader
from conformance.decoders.python.numbers import Numbers
from conformance.decoders.python.predictors import (
    ATTRIBUTES,
    Predictor,
    StepInputs,
    check_predictors,
    parse_predictors,
)
from conformance.decoders.python.static import StaticDecoder, deinterleave, f32
from conformance.decoders.python.tile import Key, Tile, table_contexts
from conformance.decoders.python.work import Work

Around = dict[int, tuple[Matrix, Vector]]
"""Cell means and count features of anchors."""


def has_stages(row: Row, number: int) -> bool:
    """Whether a class has so many stages in a layer."""
    return max(stages for stages, _ in row.classes) >= number


def has_step(row: Row, i: int, step: int) -> bool:
    """Whether a class has a step of channel i in a layer."""
    return any(steps[i] >= step for _, steps in row.classes)


class Decoder(StaticDecoder):
    """A file's first layers (SPEC §4, steps 1 to 11)."""

    def read_models(self) -> None:
        """Lists 6 and 7 of §12.2."""
        self.books: dict[int, list[list[int]]] = {}
        self.predictors: list[dict[Key, Predictor]] = []
        self.network: Network | None = None
        self.grid: Grid | None = None
        latents = self.first_layer(lambda row: has_latents(row, self.channels))
        neural = self.first_layer(lambda row: row.mode == 1)
        first = [self.first_layer(partial(has_stages, number=number)) for number in (1, 2)]
        allowed = {CODEBOOKS: first, DECODER_MLP: [latents], SCENE_MLP: [int(self.profile == 1)]}
        allowed |= {HASH_GRID: [neural], ENTROPY_NETWORK: [neural]}
        for k in range(1, self.k + 1):
            for kind, layers in allowed.items():
                require(k in layers or self.model(k, kind) is None, "unexpected-block")
        self.read_decoder(latents)
        self._codebooks(first)
        self._scene_networks()
        if neural:
            self._index_network(neural)
        for k in range(1, self.k + 1):
            self._predictors(k)
        require(Work(self).total() <= (1 << 32) + self.limits.work_per_byte * self.file_length, "limit-work")

    def _codebooks(self, first: list[int]) -> None:
        for k in range(1, self.k + 1):
            wanted = [number for number, layer in enumerate(first) if layer == k]
            if wanted:
                books = parse_codebooks(self.numbers(self.needed(k, CODEBOOKS)))
                require(list(books) == wanted, "bad-codebook")
                self.books |= books
        require(all(len(book[0]) == self.dimension for book in self.books.values()), "bad-mlp")

    def _scene_networks(self) -> None:
        block = self.model(1, SCENE_MLP)
        networks = parse_networks(self.numbers(block)) if block is not None else []
        self.check_outputs()
        if self.profile:
            feature = self.networks[0][-1][0] if self.networks else 0
            require([len(shape) for shape in networks] == [2, 2, 2], "bad-mlp")
            require([shape[1][0] for shape in networks] == [self.slots, 7 * self.slots, 3 * self.slots], "bad-mlp")
            inputs = {shape[0][1] for shape in networks}
            require(inputs in ({feature + 3}, {feature + 4}), "bad-mlp")
        self.networks += networks

    def _index_network(self, layer: int) -> None:
        network = self.network = parse_network(self.numbers(self.needed(layer, ENTROPY_NETWORK)))
        grid = self.model(layer, HASH_GRID)
        self.grid = parse_grid(grid) if grid is not None else None
        features = sum(level.features for level, _ in self.grid.levels) if self.grid else 0
        attributes = sum(channel.components for channel in self.channels if channel.stream in ATTRIBUTES)
        fits = (network.attributes, network.depths, network.grid) == (attributes, len(self.opening.targets), features)
        stages = max(stages for row in self.rows for stages, _ in row.classes)
        fits &= max(network.dims, network.latents) <= self.dimension and network.tokens + 1 >= stages
        fits &= all(b < len(network.heads) and len(network.heads[b].biases) == len(self.books[b]) for b in self.books)
        require(fits, "bad-network")
        check_network(network, self.books)

    def _predictors(self, k: int) -> None:
        block, before = self.model(k, PREDICTORS), self.predictors[-1] if self.predictors else {}
        added = parse_predictors(self.numbers(block)) if block is not None else {}
        components = {channel.stream: channel.components for channel in self.channels}
        for stream, component, step in added:
            i = next((i for i, channel in enumerate(self.channels) if channel.stream == stream), None)
            require(i is not None and component < components[stream], "bad-predictor")
            assert i is not None
            require(self.first_layer(partial(has_step, i=i, step=step)) == k, "bad-predictor")
        check_predictors(added, components, len(self.opening.targets))
        self.predictors.append({**before, **added})

    # ------------------------------------------------------------------------------------------ tiles

    def begin(self, tile: Tile, number: int) -> None:
        self.around = Context(tile.code, self.local_bits(number), self.opening.targets, self.opening.passes_log2)

    def read_channel(self, rans: Rans, tile: Tile, k: int, i: int) -> None:
        if self.channels[i].stream == OFFSETS:
            read_offsets(rans, tile, k, i)
        else:
            super().read_channel(rans, tile, k, i)

    def read_masks(self, rans: Rans, tile: Tile, k: int) -> None:
        read_masks(rans, tile, k)

    def read_step(self, rans: Rans, tile: Tile, k: int, place: tuple[int, int, list[int]]) -> None:
        stream, components = self.channels[place[0]].stream, range(self.channels[place[0]].components)
        if any((stream, j, place[1]) in self.predictors[k - 1] for j in components):
            self._predict_step(rans, tile, k, place)
        else:
            super().read_step(rans, tile, k, place)

    def read_indices(self, rans: Rans, tile: Tile, k: int, number: int) -> None:
        if self.rows[k - 1].mode == 1:
            self._neural_indices(rans, tile, k, number)
        else:
            self._indices(rans, tile, k)

    def _fine(self, tile: Tile, k: int, i: int, a: int) -> list[int]:
        """Fine values of a channel of an anchor after layer k."""
        n = self.steps(k, i, tile.klass[a])
        return [fine(v, n) for v in tile.v[i][a]]

    def _attributes(self, tile: Tile, k: int, a: int, past: int) -> list[int]:
        """Fine values of the attribute channels below channel `past` after layer k."""
        chosen = [i for i in range(past) if self.channels[i].stream in ATTRIBUTES]
        return [v for i in chosen for v in self._fine(tile, k, i, a)]

    def _predict_step(self, rans: Rans, tile: Tile, k: int, place: tuple[int, int, list[int]]) -> None:
        i, n, chosen = place
        v, stream, components = tile.v[i], self.channels[i].stream, self.channels[i].components
        sums = self.around.cells(components)
        for a, klass in enumerate(tile.klass):
            if self.steps(k - 1, i, klass) >= n:
                sums.add(a, self._fine(tile, k - 1, i, a))
        for part in self.around.passes(chosen):
            around = {a: sums.around(a) for a in part}
            own = {a: [fine(x, n - 1) for x in v[a]] for a in part}
            before = {a: self._attributes(tile, k, a, i) for a in part}

            inputs = {a: StepInputs(tile.klass[a], before[a], own[a], v[a], n) for a in part}

            def contexts(j: int, inputs: dict[int, StepInputs] = inputs, around: Around = around) -> list[int]:
                predictor = self.predictors[k - 1].get((stream, j, n))
                if predictor is None:
                    return table_contexts(tile, i, j, n, list(inputs))
                found = [predictor.context(x.of(j, around[a])) for a, x in inputs.items()]
                self.traces[k - 1].contexts.setdefault((stream, j, n), []).extend(found)
                return found

            self.refine(rans, tile, (i, n, part), contexts)
            for a in part:
                sums.add(a, [fine(x, n) for x in v[a]])

    def _neural_indices(self, rans: Rans, tile: Tile, k: int, number: int) -> None:
        assert self.network is not None
        before = [self.stages(k - 1, c) for c in tile.klass]
        after = [self.stages(k, c) for c in tile.klass]
        settled = [self._attributes(tile, k, a, len(self.channels)) for a in range(len(before))]
        grid = self.grid

        def features(a: int) -> list[int]:
            return grid.features(self.middle(number, tile.code[a])) if grid else []

        reader = IndexReader(self.network, self.books, self.around, tile.klass, settled, features)
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
            values = rans.read_by_context(key(INDICES, stage, 0, 0), contexts)
            require(all(0 <= value < len(self.books[min(stage - 1, 1)]) for value in values), "bad-index")
            for a, value in zip(chosen, values, strict=True):
                tile.index[a][stage] = value
            self.traces[k - 1].see(f"INDICES.{stage}", rans.first)

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
        corner = [x << (self.lattice_bits - depth) for x in deinterleave(prefix)]
        return [c + (x << shift) + (1 << shift >> 1) for c, x in zip(corner, deinterleave(code), strict=True)]


def parse_codebooks(numbers: Numbers) -> dict[int, list[list[int]]]:
    """The codebooks of a block by number (SPEC §7.8)."""
    d = numbers.count(64, "d")
    require(d >= 1, "bad-codebook")
    count = numbers.count(2, "book_count")
    require(count >= 1, "bad-codebook")
    books: dict[int, list[list[int]]] = {}
    for _ in range(count):
        number, size = numbers.count(255, "number"), numbers.count(4096, "size")
        require(max(books, default=-1) < number <= 1 and size >= 1, "bad-codebook")
        columns = []
        for component in range(d):
            columns.append(numbers.signed(size, "words", component))
            require(max(map(abs, columns[-1])) <= 65535, "bad-codebook")
        books[number] = [list(word) for word in zip(*columns, strict=True)]
    numbers.seal()
    return books


def read_masks(rans: Rans, tile: Tile, k: int) -> None:
    on = [sum(layer > 0 for layer in slots) for slots in tile.slot_layer]
    for s in range(tile.slots):
        chosen = [a for a, slots in enumerate(tile.slot_layer) if slots[s] == 0]
        bits = rans.read_by_context(key(MASKS, 0, 0, 0), [on[a] for a in chosen])
        require(all(bit in (0, 1) for bit in bits), "bad-mask")
        for a, bit in zip(chosen, bits, strict=True):
            if bit:
                tile.slot_layer[a][s] = k
                on[a] += 1


def read_offsets(rans: Rans, tile: Tile, k: int, i: int) -> None:
    pairs = [(a, s) for a, slots in enumerate(tile.slot_layer) for s, layer in enumerate(slots) if layer == k]
    for j in range(3):
        for (a, s), value in zip(pairs, rans.read_by_context(key(OFFSETS, j, 1, 0), [0] * len(pairs)), strict=True):
            tile.v[i][a][s][j] = value
