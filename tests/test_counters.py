"""The counts of a decode: asking for less does less, and the counts are right.

They are compared with what the writer emits, with what another decoder reads symbol by symbol, and with the sizes of
the products an array library is asked for. Nothing here is timed.
"""

from __future__ import annotations

import collections
import functools
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
import pytest

from conformance.decoders.python import decoder as minimal_decoder
from conformance.decoders.python.fields import Rans
from conformance.decoders.python.hash_grid import Grid as MinimalGrid
from conformance.decoders.python.predictors import Predictor as MinimalPredictor
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from reference_decoder.backends import backend as engine_of
from reference_decoder.bake import bake
from reference_decoder.decode import decode, iter_tiles
from reference_decoder.dequantise import tile_boxes
from reference_decoder.stream_ply import export_ply
from scarfmt.arrays import Ints
from scarfmt.coding.engine import NumpyEngine
from scarfmt.coding.reader import ALL_STREAMS, SceneReader
from scarfmt.coding.tile import needed_streams, put_layer
from scarfmt.coding.writer import QuantisedScene, layer_counts, write_scene
from scarfmt.container.directory import tile_frame
from scarfmt.container.schema import BlockKind, Profile, Stream
from scarfmt.container.source import BytesSource
from scarfmt.container.substreams import MAX_TABLE_SIZE, unpack_table
from scarfmt.counters import Coding, Counters, Part, transfers
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import TableKey
from scarfmt.neural.operations import NUMPY, Array, Operations
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.gaussians import AnchorModel
from scarfmt.tools.inspection import inspect
from scarfmt.tools.truncate import truncate

VECTORS = Path(__file__).resolve().parents[1] / "conformance" / "vectors"
VALID = sorted((VECTORS / "valid").glob("*/input.scar"))
NAMES = [path.parent.name for path in VALID]
ALWAYS = {Stream.POSITIONS, Stream.CLASSES, Stream.MASKS}

SCENES = {
    "static": lambda: random_scene(2, anchors=300, tiles=4),
    "static-anchors": lambda: random_scene(3, Profile.ANCHOR, anchors=120),
    "neural": lambda: neural_scene(28, anchors=80, tiles=3, layers=2),
    "neural-sources": lambda: neural_scene(3, anchors=80, tiles=2),
    "neural-anchors": lambda: neural_scene(3, Profile.ANCHOR, anchors=60, tiles=2, layers=2),
}
each_scene = pytest.mark.parametrize("name", SCENES)


@functools.cache
def written(name: str) -> tuple[QuantisedScene, bytes]:
    """A scene and its file, made once."""
    scene = SCENES[name]()
    return scene, write_scene(scene)


def counted(data: bytes, layers: int | None = None, backend: str = "auto", threads: int = 1) -> Counters:
    """The counts of decoding all tiles to integers."""
    counters = Counters()
    source = BytesSource(data)
    with transfers(source, counters):
        reader = SceneReader(source, engine=engine_of(backend))
        for _ in reader.tiles(reader.models(layers, counters), threads=threads, counters=counters):
            pass
    return counters


def together(parts: Sequence[Counters]) -> Counters:
    total = Counters()
    for part in parts:
        total.add(part)
    return total


def of_tiles(counters: Counters) -> dict[str, Any]:
    """The counts of tiles, without what is read and prepared once for all of them."""
    out = dict(vars(counters))
    for once in ("bytes_read", "reads", "model_blocks"):
        del out[once]
    out["multiply_adds"] = {part: n for part, n in counters.multiply_adds.items() if part != Part.INDEX_TABLES}
    return out


class Tally(Emitter):
    """An emitter that counts what the writer says of one sub-stream."""

    def __init__(self, stream: Stream, symbols: collections.Counter[tuple[Stream, Coding]]) -> None:
        self._stream, self._symbols = stream, symbols
        self.steps: collections.Counter[tuple[int, int, int]] = collections.Counter()

    def emit(self, key: TableKey, values: Ints) -> None:
        self._symbols[self._stream, Coding.STATIC] += len(values)
        self.steps[key.stream, key.component, key.step] += len(values)

    def emit_uniform(self, size: int, values: Ints) -> None:
        self._symbols[self._stream, Coding.UNIFORM] += len(values)

    def emit_rows(self, weights: Any, values: Ints) -> None:
        self._symbols[self._stream, Coding.MODELLED] += len(values)


def emitted(scene: QuantisedScene, layer: int) -> tuple[collections.Counter[tuple[Stream, Coding]], int]:
    """Symbols the writer emits in a layer, and multiply-adds of the predictors that choose tables for some."""
    symbols: collections.Counter[tuple[Stream, Coding]] = collections.Counter()
    neural, products = scene.neural(layer), 0
    for tile, content in zip(scene.tiles, scene.contents, strict=True):
        tallies = {stream: Tally(stream, symbols) for stream in Stream}
        put_layer(scene.model, layer, tile_frame(scene.fields, tile), content, tallies.__getitem__, neural)
        for key, predictor in neural.predictors.items():
            assert isinstance(predictor, Predictor)
            products += tallies[Stream(key[0])].steps[key] * predictor.multiply_adds
    return symbols, products


@each_scene
def test_layer_by_layer_the_decoder_reads_the_symbols_the_writer_emits(name: str) -> None:
    """For every sub-stream and coding, k layers take the symbols of k layers and none of the others."""
    scene, data = written(name)
    symbols: collections.Counter[tuple[Stream, Coding]] = collections.Counter()
    products = anchors = visits = 0
    for layer, (known, _) in enumerate(layer_counts(scene), start=1):
        more = emitted(scene, layer)
        symbols, products = symbols + more[0], products + more[1]
        anchors, visits = known, visits + known
        found = counted(data, layer)
        assert found.symbols == symbols
        assert found.multiply_adds[Part.PREDICTORS] == products
        assert (found.anchors, found.visits) == (anchors, visits)


@each_scene
def test_each_layer_less_takes_less(name: str) -> None:
    """In every count; and as much as decoding a file that ends there, but for the bytes of the longer directory."""
    scene, data = written(name)
    found = [counted(data, layers) for layers in range(1, len(scene.model.layers) + 1)]
    for few, more in itertools.pairwise(found):
        assert few.bytes_read < more.bytes_read
        assert few.visits < more.visits
        assert few.model_blocks < more.model_blocks
        assert few.symbols_of() < more.symbols_of()
        assert few.symbols <= more.symbols
        assert few.multiply_adds <= more.multiply_adds
    for layers, whole in enumerate(found, start=1):
        assert of_tiles(counted(truncate(BytesSource(data), layers))) == of_tiles(whole)


@pytest.mark.parametrize("path", VALID, ids=NAMES)
def test_another_decoder_reads_as_many_symbols(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The decoder written from the specification alone, which reads one symbol after the other."""
    calls: collections.Counter[str] = collections.Counter()
    symbol, context, features = Rans.symbol, MinimalPredictor.context, MinimalGrid.features

    def counting_symbol(self: Rans, table: Any) -> int:
        # The member of a cluster of one codeword takes no bits: to no other decoder is it a symbol.
        calls["symbols"] += len(table.cumulative) > 2 or table in self.tables.values()
        return symbol(self, table)

    def counting_context(self: MinimalPredictor, x: list[int]) -> int:
        layers = [self.output, *([self.hidden] if self.hidden else [])]
        calls["predictors"] += sum(len(layer.weights) * len(layer.weights[0]) for layer in layers)
        return context(self, x)

    def counting_features(self: MinimalGrid, place: list[int]) -> list[int]:
        calls["anchors with a grid"] += 1
        return features(self, place)

    data = path.read_bytes()
    other = minimal_decoder.Decoder(data)
    # From here on: the bits of a grid are symbols, too, but of no tile.
    monkeypatch.setattr(Rans, "symbol", counting_symbol)
    monkeypatch.setattr(MinimalPredictor, "context", counting_context)
    monkeypatch.setattr(MinimalGrid, "features", counting_features)
    for tile in range(len(other.tiles)):
        other.tile(tile)
    found = counted(data)
    assert found.symbols_of() == calls["symbols"] > 0
    assert found.multiply_adds[Part.PREDICTORS] == calls["predictors"]
    grid = SceneReader(BytesSource(data)).models().grid
    vertices = 0 if grid is None else sum(level.features * 2 ** len(level.axes) for level in grid.levels)
    assert found.multiply_adds[Part.HASH_GRID] == calls["anchors with a grid"] * vertices


class CountingOperations:
    """NumPy's operations, and the multiply-adds they are asked for."""

    def __init__(self, hidden: int) -> None:
        self._hidden = hidden
        self.total = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(NUMPY, name)

    def product(self, x: Array, weights: Array) -> Array:
        self.total += x.shape[0] * x.shape[1] * weights.shape[1]
        return NUMPY.product(x, weights)

    def dots(self, a: Array, b: Array) -> Array:
        self.total += a.size
        return NUMPY.dots(a, b)

    def shares(self, scores: Array, exp2: Array) -> Array:
        # Each share then weighs one value, element by element.
        self.total += scores.size * self._hidden
        return NUMPY.shares(scores, exp2)


@pytest.mark.parametrize("path", [path for path in VALID if "index" in path.parent.name or "neural" in str(path)])
def test_the_index_network_multiplies_what_is_counted(path: Path) -> None:
    """Every product the evaluator asks an array library for, and no other."""
    data = path.read_bytes()
    network = SceneReader(BytesSource(data)).models().network
    assert network is not None
    counting = CountingOperations(network.hidden)
    reader = SceneReader(BytesSource(data), engine=NumpyEngine(cast(Operations, counting)))
    models, counters = reader.models(), Counters()
    for _ in reader.tiles(models, counters=counters):
        pass
    assert models.codebooks is not None
    # Products of codewords are made in binary64, without the array library.
    tables = sum(models.codebooks.sizes) * network.gru[0].inputs[0].size
    assert counting.total == (
        counters.multiply_adds[Part.INDEX_NETWORK] + counters.multiply_adds[Part.INDEX_TABLES] - tables
    )
    assert counters.multiply_adds[Part.INDEX_NETWORK] > 0


@each_scene
def test_counts_do_not_depend_on_how_it_is_computed(name: str) -> None:
    """Threads, array library, the compiled library or none, all tiles at once or each on its own."""
    scene, data = written(name)
    whole = counted(data)
    assert whole == counted(data, threads=2) == counted(data, backend="torch") == counted(data, threads=3)
    assert counted(data, backend="numpy") == whole
    parts, source = Counters(), BytesSource(data)
    with transfers(source, parts):
        reader = SceneReader(source)
        models = reader.models(counters=parts)
        for tile in range(len(scene.tiles)):
            list(reader.tiles(models, [tile], counters=parts))
    # Only neighbours that share a request: the bytes are the same.
    parts.reads = whole.reads
    assert parts == whole


@each_scene
def test_tiles_alone_take_together_what_all_take(name: str) -> None:
    """The counts of single tiles add up to those of all; a tile that is not requested counts nothing."""
    scene, data = written(name)
    whole, parts = Counters(), []
    decode(data, counters=whole)
    opening = Counters()
    decode(data, tiles=[], counters=opening)
    for tile in range(len(scene.tiles)):
        part = Counters()
        decode(data, tiles=[tile], counters=part)
        assert part.tiles == (len(scene.contents[tile]) > 0)
        assert part.anchors == len(scene.contents[tile])
        parts.append(part)
    assert of_tiles(together(parts)) == of_tiles(whole)
    assert of_tiles(opening) == of_tiles(Counters())
    assert sum(part.bytes_read - opening.bytes_read for part in parts) == whole.bytes_read - opening.bytes_read


def test_a_box_takes_what_the_tiles_it_meets_take() -> None:
    """No byte or symbol of the others."""
    data = write_scene(random_scene(5, anchors=400, tiles=8))
    reader = SceneReader(BytesSource(data))
    low, high = tile_boxes(reader.lattice, reader.container.tile_table)
    box = (low[3] + 0.4 * (high[3] - low[3]), high[3] - 0.4 * (high[3] - low[3]))
    hit = np.flatnonzero(((low <= box[1]) & (high >= box[0])).all(axis=1)).tolist()
    assert 0 < len(hit) < 8
    in_box, of_hit, whole = Counters(), Counters(), Counters()
    decode(data, box=box, counters=in_box)
    decode(data, tiles=hit, counters=of_hit)
    decode(data, counters=whole)
    assert in_box == of_hit
    assert 0 < in_box.symbols_of() < whole.symbols_of()
    nowhere = Counters()
    assert len(decode(data, box=((90, 90, 90), (91, 91, 91)), counters=nowhere)) == 0
    assert of_tiles(nowhere) == of_tiles(Counters())


@each_scene
def test_attributes_take_the_sub_streams_they_need_and_no_other(name: str) -> None:
    """To the byte and to the symbol; an index network that decodes nothing is not even prepared."""
    _, data = written(name)
    whole, part, opening = counted(data), Counters(), Counters()
    decode(data, tiles=[], counters=opening)
    decode(data, attributes=["positions", "opacity"], counters=part)
    reader = SceneReader(BytesSource(data))
    models = reader.models()
    wanted = {Stream.POSITION_RESIDUAL, Stream.OPACITY}
    needed = needed_streams(models.model, wanted, models.neural()[-1]) | ALWAYS
    assert Stream.INDICES not in needed
    expected = {key: count for key, count in whole.symbols.items() if key[0] in needed}
    assert part.symbols == expected
    assert part.symbols_of() < whole.symbols_of()
    assert part.multiply_adds <= whole.multiply_adds
    assert set(part.multiply_adds) <= {Part.PREDICTORS}
    read = 0
    for entry in reader.container.entries:
        if entry.kind == BlockKind.TILE:
            table = unpack_table(reader.container.read_block(entry), entry.length)
            read += min(entry.length, MAX_TABLE_SIZE)
            read += sum(record.length for stream, record in table.items() if stream in needed)
    assert part.bytes_read - opening.bytes_read == read


def test_points_cost_few_of_the_symbols_and_bytes() -> None:
    """A preview of a static file needs no colours and no networks."""
    data = write_scene(random_scene(2, anchors=2000, sh_degree=3))
    whole, part = Counters(), Counters()
    decode(data, counters=whole)
    decode(data, attributes=["positions"], counters=part)
    assert 2 * part.symbols_of() < whole.symbols_of()
    assert 4 * part.bytes_read < 3 * whole.bytes_read


@pytest.mark.parametrize("seed", range(4))
def test_slots_that_are_off_cost_no_offsets(seed: int) -> None:
    """Three numbers for each slot that is on by the layer decoded."""
    scene = random_scene(seed, Profile.ANCHOR, anchors=80)
    data = write_scene(scene)
    for layer, (_, gaussians) in enumerate(layer_counts(scene), start=1):
        assert counted(data, layer).symbols_of(streams={Stream.OFFSETS}) == 3 * gaussians


def test_a_file_whose_slots_are_all_off_has_no_offsets() -> None:
    """Masks say so; nothing else is read for them."""
    found = counted((VECTORS / "edge" / "anchors-slots-off" / "input.scar").read_bytes())
    assert found.anchors > 0
    assert found.symbols_of(streams={Stream.MASKS}) > 0
    assert found.symbols_of(streams={Stream.OFFSETS}) == 0


def test_a_static_file_multiplies_nothing_until_it_is_activated() -> None:
    """Then the latent decoder's weights, once an anchor."""
    scene = next(s for s in (random_scene(seed) for seed in range(50)) if s.decoder is not None and s.fields.sh_degree)
    counters = Counters()
    decoded = decode(write_scene(scene), counters=counters)
    assert not counters.multiply_adds
    assert counters.symbols_of(codings={Coding.MODELLED}) == 0
    decoded.activated(counters=counters)
    assert scene.decoder is not None
    weights = sum(layer.weights.size for layer in scene.decoder.layers)
    assert counters.multiply_adds == {Part.LATENT_DECODER: weights * len(decoded)}


def test_parts_taken_one_by_one_count_alike() -> None:
    """`iter_tiles`, `decode` and a PLY of the same file, which opens it once more to know how many rows follow."""
    data = write_scene(neural_scene(28, anchors=150, tiles=4))
    whole, parts, exported = Counters(), Counters(), Counters()
    decoded = decode(data, counters=whole)
    assert sum(map(len, iter_tiles(data, counters=parts))) == len(decoded)
    assert parts == whole
    decoded.activated(counters=whole)
    source = BytesSource(data)
    SceneReader(source)
    export_ply(data, cast(BinaryIO, _Nowhere()), counters=exported)
    whole.bytes_read, whole.reads = whole.bytes_read + source.bytes_read, whole.reads + source.reads
    assert exported == whole


class _Nowhere:
    def write(self, data: bytes) -> int:
        return len(data)


def test_baking_runs_the_scene_networks_for_every_eye() -> None:
    """All three, for each anchor."""
    decoded = decode((VECTORS / "valid" / "anchors" / "input.scar").read_bytes())
    model, counters = decoded.scene, Counters()
    assert isinstance(model, AnchorModel)
    bake(model, np.array([[0.0, 0.0, 9.0], [9.0, 0.0, 0.0]]), counters=counters)
    weights = sum(layer.size for mlp in model.mlps.values() for layer in mlp.weights)
    assert counters.multiply_adds == {Part.SCENE_NETWORKS: 2 * len(decoded) * weights}


@pytest.mark.parametrize("path", VALID, ids=NAMES)
def test_looking_at_a_file_reads_its_header_and_opening_it_its_directory(path: Path) -> None:
    """`inspect` needs one read; no block is read until models or tiles are requested."""
    source = BytesSource(path.read_bytes())
    inspect(source)
    assert source.reads == 1
    assert source.bytes_read <= 2280
    header_bytes, reader = source.bytes_read, SceneReader(source)
    header = reader.header
    assert source.bytes_read - header_bytes == header_bytes + header.data_offset - header.header_length


def test_counters_add_up() -> None:
    """Every count, and the report names each of them."""
    one = Counters(1, 2, 3, 4, 5, 6, 7)
    one.symbols[Stream.SCALE, Coding.STATIC] = 8
    one.multiply(Part.HASH_GRID, 3, 4)
    one.multiply(Part.PREDICTORS, 0, 4)
    two = together([one, one])
    assert (two.bytes_read, two.reads, two.model_blocks, two.tile_blocks) == (2, 4, 6, 8)
    assert (two.tiles, two.anchors, two.visits) == (10, 12, 14)
    report = two.report()
    assert report["symbols_by_stream"] == {"scale": 16}
    assert report["symbols_by_coding"] == {"static": 16, "uniform": 0, "modelled": 0}
    assert report["multiply_adds"] == report["multiply_adds_by_part"]["hash_grid"] == 24
    assert report["multiply_adds_by_part"]["predictors"] == 0
    assert (report["symbols"], report["blocks"]) == (16, 14)


def test_streams_that_can_be_asked_for_are_counted_apart() -> None:
    """No symbol belongs to a sub-stream that no file has."""
    found = counted(write_scene(random_scene(1)))
    assert {stream for stream, _ in found.symbols} <= ALL_STREAMS
