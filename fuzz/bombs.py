"""The worst files that are known: as much time and memory as a file below 1 MiB can be made to take.

``python -m fuzz.bombs`` builds each, decodes and validates it in a process of its own, and prints what that took.
"""

from __future__ import annotations

import argparse
import itertools
import resource
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from fuzz.target import decode_all, validate_all
from fuzz.testing.networks import random_network
from scarfmt.blocks.codebooks import pack_codebooks
from scarfmt.blocks.index_network import pack_network
from scarfmt.blocks.layer import pack_layer
from scarfmt.blocks.mlp import Linear, QuantisedMlp, pack_networks
from scarfmt.blocks.predictors import pack_predictors
from scarfmt.blocks.tables import pack_tables
from scarfmt.container.file import Block, HeaderFields, Tile, write_container
from scarfmt.container.schema import BlockKind, Profile, Stream
from scarfmt.container.substreams import pack_substreams
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.neural.arithmetic import Linear as Exact
from scarfmt.neural.network import Inputs
from scarfmt.neural.predictors import Predictor, input_width
from scarfmt.scene.model import Channel, Codebooks, DecodedContext, LayerRow, SceneModel

NOTHING = pack_substreams({})
"""A TILE block without sub-streams: whatever is decoded from it is the first symbol of its table."""
MIB = 1 << 20
MOST_SECONDS = 120


def channels(*wanted: tuple[Stream, int]) -> tuple[Channel, ...]:
    """Channels with so many components, each alike."""
    return tuple(Channel(stream, (0.5,) * n) for stream, n in wanted)


def zero_tables(model: SceneModel) -> dict[TableKey, SymbolTable]:
    """Tables of the one symbol 0 for everything that can be coded."""
    keys = [TableKey(Stream.POSITIONS, 0, 0, n) for n in range(2, 18)]
    keys += [TableKey(Stream.MASKS, 0, 0, n) for n in range(33)]
    for index, channel in enumerate(model.channels):
        steps = max(row.steps[kind][index] for row in model.layers for kind in range(row.class_count))
        keys += [
            TableKey(channel.stream, component, step, context)
            for component, step in itertools.product(range(channel.components), range(1, steps + 1))
            for context in range(5)
        ]
    stages = model.max_stages
    keys += [TableKey(Stream.INDICES, stage, 0, c) for stage in range(1, stages + 1) for c in (0, 1, 16, 17)]
    return {key: one_symbol() for key in sorted(keys)}


def one_symbol(value: int = 0) -> SymbolTable:
    """A table that reads nothing."""
    return SymbolTable(np.array([value], np.int64), np.ones(1, np.int64))


def build(
    model: SceneModel,
    counts: Sequence[int],
    size: int = 0,
    *,
    tables: dict[TableKey, SymbolTable] | None = None,
    models: Sequence[tuple[int, bytes, int]] = (),
    tile: bytes = NOTHING,
) -> bytes:
    """A file of one TILE block a tile, in layer 1, with so many anchors each.

    Args:
        size: of a block that nobody reads.
        tables: by default :func:`zero_tables`.
        models: (kind, payload, count) of further blocks of layer 1.
    """
    fields = HeaderFields(model.profile, 0, model.slots, 32, (0.0, 0.0, 0.0), 1.0)
    tiles = [Tile(7, 4, number) for number in range(len(counts))]
    opening = model.channels, model.context
    tables = zero_tables(model) if tables is None else tables
    blocks = [
        Block(BlockKind.LAYER, number, pack_layer(row, opening if number == 1 else None), count=row.class_count)
        for number, row in enumerate(model.layers, start=1)
    ]
    blocks.append(Block(BlockKind.TABLES, 1, pack_tables(tables), count=len(tables)))
    blocks += [Block(kind, 1, payload, count=count) for kind, payload, count in models]
    blocks += [Block(200, 1, bytes(size))] if size > 0 else []
    blocks += [Block(BlockKind.TILE, 1, tile, n, count) for n, count in enumerate(counts) if count]
    total = sum(counts)
    return write_container(fields, tiles, blocks, [(total, total if model.profile == 0 else 0)] * len(model.layers))


SCALE = (Stream.SCALE, 3)


def scales(layers: int = 1) -> SceneModel:
    """SCALE in one step from layer 1 on, and nothing else."""
    return SceneModel(Profile.EXPLICIT, 1, channels(SCALE), (LayerRow((0,), ((1,),)),) * layers)


def _network(*widths: int) -> QuantisedMlp:
    pairs = itertools.pairwise(widths)
    flat = ((np.ones((b, a), np.int16), np.ones(b, np.float32), np.zeros(b, np.float32)) for a, b in pairs)
    return QuantisedMlp(tuple(Linear(*layer) for layer in flat))


def _decoder(*widths: int) -> tuple[int, bytes, int]:
    return BlockKind.DECODER_MLP, pack_networks((_network(*widths),)), 1


def _divide(anchors: int) -> list[int]:
    """Anchors of each tile, as many in a tile as there can be."""
    return [min(65536, anchors - first) for first in range(0, anchors, 65536)]


def small_tiles(
    count: int = 15_500, layers: int = 1, anchors: int = 2, tile: bytes = NOTHING, size: int = MIB
) -> bytes:
    """TILE blocks of five bytes, as many as the limit of work lets a file of so many bytes have."""
    return build(scales(layers), [anchors] * count, size - 16 * count - 1000, tile=tile)


def many_steps(anchors: int, size: int, wide: int = 64) -> bytes:
    """All steps of a wide latent for many anchors, from empty streams."""
    row = LayerRow((0,), ((1, 20),))
    model = SceneModel(Profile.EXPLICIT, 1, channels(SCALE, (Stream.LATENT, wide)), (row,))
    return build(model, _divide(anchors), size, models=[_decoder(wide, 3)])


def wide_decoder(anchors: int, size: int) -> bytes:
    """A latent decoder of a million weights, for many anchors."""
    model = SceneModel(Profile.EXPLICIT, 1, channels(SCALE, (Stream.LATENT, 64)), (LayerRow((0,), ((1, 1),)),))
    return build(model, _divide(anchors), size, models=[_decoder(64, 950, 1024, 3)])


def _draw(anchors: int, slots: int, features: int, size: int) -> bytes:
    """Anchors of so many slots, all turned on, whose networks take so many features and no direction beyond three."""
    wanted = ((Stream.SCALE, 6), (Stream.LATENT, 1), (Stream.OFFSETS, 3))
    model = SceneModel(Profile.ANCHOR, slots, channels(*wanted), (LayerRow((0,), ((1, 1, 1),)),))
    nets = tuple(_network(features + 3, 1, outputs * slots) for outputs in (1, 7, 3))
    tables = zero_tables(model)
    if slots > 1:
        tables.update({key: one_symbol(1) for key in tables if key.stream == Stream.MASKS})
    blocks = [_decoder(1, features), (BlockKind.SCENE_MLP, pack_networks(nets), 3)]
    return build(model, _divide(anchors), size, tables=tables, models=blocks)


def _large_tables(tables: int, symbols: int, size: int) -> bytes:
    """Tables that nothing needs, of few bytes."""
    found = zero_tables(scales())
    table = SymbolTable(np.arange(symbols), np.ones(symbols, np.int64))
    found.update({TableKey(200, n >> 16, n >> 8 & 255, n & 255): table for n in range(tables)})
    return build(scales(), [2], size, tables=dict(sorted(found.items())))


def _index(anchors: int, size: int, *, hidden: int, tiles: int = 1) -> bytes:
    """An index network for two codebooks of the largest size."""
    rng = np.random.default_rng(3)
    books = Codebooks(rng.integers(-9, 9, (4096, 8)), rng.integers(-9, 9, (4096, 8)))
    model = SceneModel(
        Profile.EXPLICIT, 1, channels(SCALE), (LayerRow((8,), ((1,),), True),), DecodedContext(3, (64, 16, 4, 1))
    )
    inputs = Inputs(1, True, 3, 4, 8, 0, 0)
    network = random_network(
        rng, books, inputs, stages=8, hidden=hidden, gru_layers=4, codeword_dims=8, activation_bits=8,
    )  # fmt: skip
    blocks = [
        _decoder(8, 3),
        (BlockKind.CODEBOOKS, pack_codebooks({0: books.coarse, 1: books.residual}), 2),
        (BlockKind.ENTROPY_NETWORK, pack_network(network), 1),
    ]
    return build(model, [anchors // tiles] * tiles, size, models=blocks)


def _large_grid(size: int) -> bytes:
    """A hash grid of 2^24 bits in fifty bytes."""
    rng = np.random.default_rng(3)
    books = Codebooks(rng.integers(-9, 9, (4, 2)), np.zeros((0, 2), np.int64))
    model = SceneModel(Profile.EXPLICIT, 1, channels(SCALE), (LayerRow((1,), ((1,),), True),), DecodedContext(0, (4,)))
    level = struct.pack("<BIBB", 0, 65535, 19, 8)
    grid = struct.pack("<3I2B", 0, 0, 0, 32, 4) + 4 * level + 4 * (b"\x80" + bytes(4))
    network = random_network(rng, books, Inputs(1, True, 3, 1, 0, 0, 32), stages=1)
    blocks = [
        _decoder(2, 3),
        (BlockKind.CODEBOOKS, pack_codebooks({0: books.coarse}), 1),
        (BlockKind.ENTROPY_NETWORK, pack_network(network), 1),
        (BlockKind.HASH_GRID, grid, 4),
    ]
    return build(model, [100], size, models=blocks)


def _many_predictors(anchors: int, size: int, tiles: int = 1) -> bytes:
    """A predictor of 64 hidden units for every step of every component."""
    wanted = (SCALE, (Stream.ROTATION, 3), (Stream.OPACITY, 1), (Stream.COLOUR, 3))
    context = DecodedContext(3, (64, 16, 4, 1))
    model = SceneModel(Profile.EXPLICIT, 1, channels(*wanted), (LayerRow((0,), ((20,) * 4,)),), context)
    predictors = []
    for index, channel in enumerate(model.channels):
        width = input_width(model, index)
        for component, step in itertools.product(range(channel.components), range(1, 21)):
            hidden = Exact(np.zeros((64, width), np.int32), np.zeros(64, np.int64), 0)
            output = Exact(np.zeros((2, width + 64), np.int32), np.zeros(2, np.int64), 0)
            predictors.append(Predictor(channel.stream, component, step, hidden, output, (16, 16)))
    block = (BlockKind.PREDICTORS, pack_predictors(predictors), len(predictors))
    return build(model, [anchors // tiles] * tiles, size, models=[block])


BOMBS: dict[str, Callable[[], bytes]] = {
    "empty tiles": lambda: build(scales(16), [0] * 342_000),
    "small tiles": small_tiles,
    "small tiles of one anchor": lambda: small_tiles(30_500, 1, 1),
    "small tiles, 16 layers": lambda: small_tiles(2_000, 16),
    "broken tiles": lambda: small_tiles(tile=b"\x0c\0\0\0\0"),  # each is a finding of its own
    "many steps, small file": lambda: many_steps(9_000, 0),
    "many steps": lambda: many_steps(200_000, MIB - 5000),
    "many steps, one component": lambda: many_steps(1_000_000, MIB - 5000, 1),
    "wide decoder": lambda: wide_decoder(55_000, MIB - 5000),
    "wide features": lambda: _draw(65_536, 1, 1000, 0),
    "wide features, large file": lambda: _draw(65_000, 1, 1000, MIB - 9000),
    "many slots": lambda: _draw(260_000, 32, 1, MIB - 9000),
    "large tables": lambda: _large_tables(380, 4096, MIB - 9000),
    "many tables": lambda: _large_tables(65_000, 1, MIB - 130_000),
    "deep network": lambda: _index(2600, 0, hidden=255),
    "shallow network": lambda: _index(15_000, MIB - 55_000, hidden=8, tiles=150),
    "large grid": lambda: _large_grid(MIB - 9000),
    "many predictors": lambda: _many_predictors(24_000, MIB - 600_000),
    "many predictors, small tiles": lambda: _many_predictors(1000, MIB - 600_000, 50),
}


def _limit_time() -> None:
    """A file that takes more than MOST_SECONDS of the processor ends the process that measures it."""
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS))


def measure(path: Path) -> None:
    """Print what decoding and validating a file takes, in this process."""
    data = path.read_bytes()
    for name, act in (("decode", decode_all), ("validate", validate_all)):
        base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        start = time.process_time()
        answer = act(data)
        spent = time.process_time() - start
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - base
        print(f"  {name:9} {spent:7.2f} s {peak / 1024:7.0f} MiB  {answer or 'accepted'}", flush=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure is not None:
        measure(arguments.measure)
        return
    folder = Path("build/bombs")
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in BOMBS.items():
        path = folder / f"{name.replace(' ', '-').replace(',', '')}.scar"
        path.write_bytes(make())
        print(f"{name}: {path.stat().st_size:,} bytes", flush=True)
        command = [sys.executable, "-m", "fuzz.bombs", "--measure", str(path)]
        subprocess.run(command, preexec_fn=_limit_time, check=False)


if __name__ == "__main__":
    main()
