"""The cost of decoding a box of a file against decoding all of it: bytes, symbols, time (`benchmarks.child`)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.child import timed
from reference_decoder.decode import decode
from reference_decoder.dequantise import tile_boxes
from scarfmt.arrays import F64
from scarfmt.coding.reader import SceneReader
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import open_source
from scarfmt.counters import Counters

Job = dict[str, Any]
Box = tuple[list[float], list[float]]

SEED = 5
CORE = (10.0, 90.0)
"""Percentiles, axis by axis, of the anchors between which the core lies."""
PLACES = ("anchor", "anywhere", "whole")
"""Boxes round anchors of the core; anywhere in the core; round any anchor, of the volume that all anchors take up."""


def boxes(positions: F64, share: float, place: str, count: int, seed: int = SEED) -> list[Box]:
    """Lowest and highest corners of `count` boxes that have a share of the volume of the core, or of the whole.

    Args:
        positions: (N, 3) of the anchors; their order does not matter.
        share: of the volume; the box has the proportions of what it is a share of.
        place: one of `PLACES`.
        count: how many; equal arguments give equal boxes.
        seed: another one gives others.
    """
    random = np.random.default_rng(seed)
    low, high = positions.min(axis=0), positions.max(axis=0)
    if place != "whole":
        low, high = np.percentile(positions, CORE, axis=0)
    half = (high - low) * share ** (1 / 3) / 2
    if place == "anywhere":
        centres = low + half + random.random((count, 3)) * (high - low - 2 * half)
    else:
        inside = positions[((positions >= low) & (positions <= high)).all(axis=1)]
        ordered = inside[np.lexsort(inside.T)]
        centres = ordered[random.integers(0, len(ordered), count)]
    return [((centre - half).tolist(), (centre + half).tolist()) for centre in centres]


def choose(job: Job) -> dict[str, Any]:
    """Boxes in a file, by place and share, `counts` of each share, and the share of the anchors in each."""
    positions = decode(job["file"], attributes=["positions"]).positions
    assert positions is not None  # they were asked for
    found = []
    for place in PLACES:
        for share, count in job["counts"]:
            chosen = boxes(positions, share, place, count)
            inside = [float(((positions >= low) & (positions <= high)).all(axis=1).mean()) for low, high in chosen]
            found.append({"place": place, "share": share, "boxes": chosen, "anchors": inside})
    return {"regions": found}


def sizes(job: Job) -> dict[str, Any]:
    """The bytes of the parts of a file, and the bytes and tiles that each region of `regions` reads."""
    with open_source(job["file"]) as source:
        reader = SceneReader(source)
        header, rows = reader.header, reader.container.directory
        own = rows["kind"] == BlockKind.TILE
        fixed = header.data_offset + int(rows["length"][~own].sum())
        of_tile = np.bincount(rows["tile"][own], rows["length"][own], header.tile_count)
        low, high = tile_boxes(reader.lattice, reader.container.tile_table)
    regions = []
    for region in job["regions"]:
        hit = np.array([((low <= b) & (high >= a)).all(axis=1) for a, b in region["boxes"]])
        regions.append({"bytes": (fixed + hit @ of_tile).tolist(), "tiles": hit.sum(axis=1).tolist()})
    return {
        "file_bytes": header.file_length,
        "layer_bytes": [sum(layer.stream_bytes) for layer in header.layers],
        "tiles": header.tile_count,
        "front_bytes": header.data_offset,
        "model_bytes": fixed - header.data_offset,
        "regions": regions,
    }


def times(job: Job) -> dict[str, Any]:
    """Processor seconds and symbols of all of a file, of its models alone, and of the boxes of each region."""
    counters = Counters()
    decode(job["file"], counters=counters)
    full = timed(lambda: decode(job["file"]).scene, runs=2)
    regions = [_region(job["file"], region["boxes"]) for region in job["regions"]]
    again = timed(lambda: decode(job["file"]).scene, runs=1)
    opening = timed(lambda: _open(job["file"]), runs=3)
    return {
        "cpu": min(full["cpus"] + again["cpus"]),
        "opening": min(opening["cpus"]),
        "symbols": counters.symbols_of(),
        "regions": regions,
    }


def _open(path: str) -> None:
    with open_source(path) as source:
        SceneReader(source).models()


def _region(path: str, chosen: Sequence[Box]) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {"cpus": [], "symbols": [], "reads": []}
    for low, high in chosen:
        start = time.process_time()
        counters = Counters()
        _ = decode(path, box=(low, high), counters=counters).scene
        found["cpus"].append(time.process_time() - start)
        found["symbols"].append(counters.symbols_of())
        found["reads"].append(counters.reads)
    return found
