"""The directory of a scene of 10^9 Gaussians: its bytes, and how few of them a reader takes before its first tile.

    python -m benchmarks.directory [--short] [--no-write]

Front and reader are those of the package; what lies behind the front is zeros that take no memory. Cubes, lengths and
counts are drawn with a fixed seed: tiles of one size scattered over an octree level, blocks of a few bytes a Gaussian.
"""

from __future__ import annotations

import argparse
import math
import time
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from benchmarks.report import add_arguments, dated, load_results, replace_section, save_results, table
from benchmarks.scenes import REPOSITORY
from scarfmt.container.file import Container, HeaderFields, encode_front, read_header
from scarfmt.container.schema import ENTRY_DTYPE, NO_TILE, TILE_DTYPE, BlockFlag, BlockKind, Profile, Stream
from scarfmt.container.source import HEAD_BYTES, BytesSource, RangeSource
from scarfmt.container.table_rules import Table
from scarfmt.tools.inspection import inspect

NAME = "directory"
PAGE = REPOSITORY / "docs" / "scaling.md"
ASKED_BYTES = 256 << 10
"""Maximum bytes that may be read until the first tile of layer 1 is known."""
MODELS = {BlockKind.LAYER: 120, BlockKind.TABLES: 9000, BlockKind.CODEBOOKS: 7000, BlockKind.PREDICTORS: 4000}
"""Bytes of the models of a layer, about those of real scenes."""
GAUSSIANS = (0.3, 0.3, 0.2, 0.2, 0.0)
"""Share of the Gaussians that first appears in each layer."""
BYTES = (0.8, 1.0, 1.2, 1.4, 1.6)
"""Bytes of a layer for every Gaussian of a tile."""
OLD_TILE, OLD_ENTRY = 12, 32
"""Bytes of a tile and of a block in the directory of format 0.1, which was read whole."""


class Case(NamedTuple):
    """A scene: how many tiles, of how many Gaussians each."""

    tiles: int
    gaussians: int


CASES = (Case(61_000, 16_384), Case(200_000, 5_000))
SHORT = (Case(3_000, 5_000),)


class Remote(RangeSource):
    """A file behind a URL: the first request brings its head, the blocks are zeros."""

    def __init__(self, front: bytes, head_bytes: int) -> None:
        super().__init__(read_header(BytesSource(front), allow_truncated=True).file_length)
        self._front = front
        self._head = self._fetch(0, head_bytes)
        self.reads, self.bytes_read = 1, len(self._head)

    def _fetch(self, offset: int, length: int) -> bytes:
        return self._front[offset : offset + length].ljust(min(length, self.size - offset), b"\0")

    def _transfer(self, offset: int, length: int) -> bytes:
        kept = max(0, len(self._head) - offset)
        if length <= kept:
            return self._head[offset : offset + length]
        return self._head[offset:] + super()._transfer(offset + kept, length - kept)


def front_of(case: Case, seed: int = 1) -> bytes:
    """The front of the scene."""
    random = np.random.default_rng(seed)
    tiles = np.zeros(case.tiles, TILE_DTYPE)
    # One cube in eight of a level is taken, as where a surface passes through space.
    tiles["depth"] = depth = math.ceil(math.log(8 * case.tiles, 8))
    tiles["shift"] = random.integers(0, 3, case.tiles)
    tiles["prefix"] = np.sort(random.choice(8**depth, case.tiles, replace=False))
    fields = HeaderFields(Profile.EXPLICIT, 3, 1, 21, (0.0, 0.0, 0.0), 0.01, case.tiles * case.gaussians)
    rows, counts, streams, anchors = [], [], [], 0
    for layer in range(1, len(BYTES) + 1):
        models, blocks = _models(layer), _blocks(layer, case, random)
        rows += [models, blocks]
        anchors += int(blocks["count"].sum(dtype=np.int64))
        counts.append((anchors, anchors))
        streams.append([0] * len(Stream))
        streams[-1][Stream.MODELS] = int(models["length"].sum())
        streams[-1][Stream.FRAMING] = int(blocks["length"].sum())
    return encode_front(fields, tiles, np.concatenate(rows), counts, streams)


def _models(layer: int) -> Table:
    rows = np.zeros(len(MODELS), ENTRY_DTYPE)
    rows["kind"], rows["flags"], rows["layer"], rows["tile"] = list(MODELS), BlockFlag.CRITICAL, layer, NO_TILE
    rows["length"] = list(MODELS.values())
    return rows


def _blocks(layer: int, case: Case, random: np.random.Generator) -> Table:
    rows = np.zeros(case.tiles, ENTRY_DTYPE)
    rows["kind"], rows["flags"], rows["layer"] = BlockKind.TILE, BlockFlag.CRITICAL, layer
    rows["tile"] = np.arange(case.tiles)
    rows["length"] = case.gaussians * BYTES[layer - 1] * random.lognormal(0, 0.3, case.tiles) + 60
    rows["count"] = random.binomial(case.gaussians, GAUSSIANS[layer - 1], case.tiles)
    rows["crc32"] = random.integers(0, 1 << 32, case.tiles)
    return rows


def measure(case: Case) -> dict[str, Any]:
    """The bytes of a scene's directory, and the bytes that a reader fetches of it."""
    front = front_of(case)
    source = Remote(front, HEAD_BYTES)
    container = Container.open(source)
    tile = case.tiles // 2
    entry = container.find(BlockKind.TILE, 1, tile)
    assert entry is not None
    place = container.tile(tile)
    found = {"first_bytes": source.bytes_read, "first_reads": source.reads, "first_tile_depth": place.depth}
    assert found["first_bytes"] <= ASKED_BYTES, f"{found['first_bytes']} bytes until a tile of layer 1 is known"
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        Container.open(Remote(front, HEAD_BYTES)).load()
        seconds.append(time.perf_counter() - start)
    look = Remote(front, 0)
    inspect(look)
    header = container.header
    old = OLD_TILE * case.tiles + OLD_ENTRY * len(BYTES) * (case.tiles + len(MODELS))
    return {
        "tiles": case.tiles,
        "gaussians": header.gaussian_count,
        "layers": header.layer_count,
        "pages": header.page_count,
        "root_bytes": header.root_length,
        "directory_bytes": len(front) - header.header_length,
        "tile_bytes": int(container.root.pages["tile_bytes"].sum()) / case.tiles,
        "row_bytes": int(container.root.rows["row_bytes"].sum()) / (case.tiles * len(BYTES)),
        "old_bytes": old,
        "load_seconds": min(seconds),
        "inspect_bytes": look.bytes_read,
        "inspect_reads": look.reads - 1,
        **found,
    }


def markdown(results: dict[str, Any]) -> str:
    """The table of the page."""
    runs = sorted(results.values(), key=lambda run: int(run["tiles"]))
    lines = [
        ("Gaussians", "gaussians", "{:,}"),
        ("tiles, each with a block in all of 5 layers", "tiles", "{:,}"),
        ("directory in 0.1, read whole: bytes", "old_bytes", "{:,}"),
        ("directory: bytes", "directory_bytes", "{:,}"),
        ("of these ROOT", "root_bytes", "{:,}"),
        ("a tile in its tile page: bytes (12 in 0.1)", "tile_bytes", "{:.2f}"),
        ("a block in its row page: bytes (32 in 0.1)", "row_bytes", "{:.2f}"),
        ("a block of layer 1 is known after: bytes", "first_bytes", "{:,}"),
        ("in requests", "first_reads", "{}"),
        ("all pages read: seconds", "load_seconds", "{:.2f}"),
        ("`inspect` reads: bytes", "inspect_bytes", "{:,}"),
    ]
    rows = [[name, *(form.format(run[key]) for run in runs)] for name, key, form in lines]
    return table(["", *(f"{run['tiles']:,} tiles" for run in runs)], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, scenes=False)
    arguments = parser.parse_args()
    results = {} if arguments.no_write or arguments.short else load_results(NAME)
    for case in SHORT if arguments.short else CASES:
        results[f"{case.tiles} tiles of {case.gaussians}"] = measure(case)
    save_results(NAME, results, not arguments.no_write)
    show = print if arguments.no_write else partial(replace_section, NAME, page=PAGE)
    show(dated(markdown(results), NAME, not arguments.no_write))


if __name__ == "__main__":
    main()
