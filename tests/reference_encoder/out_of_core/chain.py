"""A small scene in ranges, encoded step by step in one process."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from reference_encoder.importance.weights import Weights
from reference_encoder.options import EncodeOptions
from reference_encoder.out_of_core.code import add_histograms, build_models, code_layers, count_symbols
from reference_encoder.out_of_core.fit import Fit, apply
from reference_encoder.out_of_core.fit_scene import fit_scene
from reference_encoder.out_of_core.judge import combine_quality, judge, render_pictures
from reference_encoder.out_of_core.measure import measure, sample_range
from reference_encoder.out_of_core.overview import Overview, build_overview, summarise_range
from reference_encoder.out_of_core.types import Bounds, Models, Range, Rows
from reference_encoder.rdo.lattice import cut_cubes
from scarfmt.arrays import F64, I64
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.schema import BlockKind
from scarfmt.formats import load
from scarfmt.limits import MAX_TILE_DEPTH
from scarfmt.scene.gaussians import GaussianScene

EXAMPLE = Path(__file__).parents[3] / "examples" / "plush-toys.ply"
EVERY = 3
OPTIONS = EncodeOptions(effort=1, corrections=0, tile_anchors=1024)


@lru_cache
def example() -> GaussianScene:
    """Some Gaussians of the example scene."""
    scene = load(EXAMPLE)
    assert isinstance(scene, GaussianScene)
    return scene.take(np.arange(0, len(scene), EVERY))


def bounds_of(scene: GaussianScene) -> Bounds:
    """The bounds of a whole scene."""
    (lx, ly, lz), (hx, hy, hz) = scene.positions.min(axis=0).tolist(), scene.positions.max(axis=0).tolist()
    return Bounds((lx, ly, lz), (hx, hy, hz), len(scene), scene.sh_degree)


def partition(scene: GaussianScene, size: int) -> list[tuple[Range, GaussianScene]]:
    """Ranges of about `size` Gaussians."""
    path = bounds_of(scene).paths(scene.positions)
    order = np.argsort(path, kind="stable")
    depth, prefix, first = cut_cubes(path[order], MAX_TILE_DEPTH, max(1, size // 8))
    past = np.append(first[1:], len(scene))
    edges, codes = [0], [0]
    for at, end, here, code_ in zip(first, past, depth, prefix, strict=True):
        if end - edges[-1] > size:
            edges.append(int(at))
            codes.append(int(code_) << 3 * (MAX_TILE_DEPTH - int(here)))
    edges.append(len(scene))
    codes.append(1 << 3 * MAX_TILE_DEPTH)
    return [
        (Range(k, codes[k], codes[k + 1], edges[k + 1] - edges[k]), scene.take(order[edges[k] : edges[k + 1]]))
        for k in range(len(edges) - 1)
    ]


@dataclass(frozen=True)
class Chain:
    """All that the steps hand on."""

    overview: Overview
    ranges: Sequence[tuple[Range, GaussianScene]]
    measured: Sequence[Weights]
    fit: Fit
    contents: Sequence[tuple[QuantisedScene, I64]]
    models: Models
    segments: Sequence[tuple[Rows, Sequence[bytes]]]

    @property
    def whole(self) -> QuantisedScene:
        """All ranges as one."""
        tiles = tuple(tile for scene, _ in self.contents for tile in scene.tiles)
        return self.fit.scene(tiles, tuple(content for scene, _ in self.contents for content in scene.contents))


def overviewed(
    scene: GaussianScene, ranges: Sequence[tuple[Range, GaussianScene]], options: EncodeOptions = OPTIONS
) -> Overview:
    """The overview of all ranges."""
    bounds = bounds_of(scene)
    summaries = [summarise_range(here, part, bounds, options) for part, here in ranges]
    return build_overview(summaries, [part for part, _ in ranges], bounds, options)


@lru_cache
def encoded(size: int) -> Chain:
    """The example in ranges of about `size` Gaussians."""
    ranges = partition(example(), size)
    overview = overviewed(example(), ranges)
    measured = [measure(overview, *each) for each in ranges]
    samples = [sample_range(overview, *each, weights) for each, weights in zip(ranges, measured, strict=True)]
    shown = {number: render_pictures(overview, *ranges[number], measured[number]) for number in overview.judging}

    def judged(fit: Fit) -> list[F64]:
        return [judge(overview, fit, ranges[k][0], seen) for k, seen in shown.items()]

    fit = fit_scene(overview, samples, judged)
    quality = combine_quality(overview, judged(fit))
    contents = [apply(overview, fit, *each, weights) for each, weights in zip(ranges, measured, strict=True)]
    counted = [count_symbols(*content) for content in contents]
    histograms = add_histograms([found for found, _ in counted])
    models = build_models(overview, fit, histograms, {"quality": quality.figures()})
    segments = []
    for _, symbols in counted:
        rows, sizes, payloads = zip(*code_layers(models, symbols), strict=True)
        segments.append((Rows(symbols[0], rows, np.stack(sizes)), payloads))
    return Chain(overview, ranges, measured, fit, contents, models, segments)


def written(chain: Chain) -> bytes:
    """All ranges gathered, and written with the models of the chain."""
    metadata = next(block.payload for block in chain.models.blocks if block.kind == BlockKind.METADATA)
    return write_scene(replace(chain.whole, metadata=json.loads(metadata)))
