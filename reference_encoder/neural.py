"""Which integer networks a file gets: whatever makes it smaller, by measured bytes (SPEC §10; encoder side).

Candidates are tried one on top of the other: predictors of channel values, then the index network. Each is
kept only if the file it gives is smaller than the one before, so a file is never larger than its static form.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from reference_encoder.entropy.clusters import Clusters, arrange
from reference_encoder.entropy.dataset import ContextOptions, index_rows, lattice_positions
from reference_encoder.entropy.defaults import BUDGETS, LATENTS, shape_for, training_for
from reference_encoder.entropy.export import export
from reference_encoder.entropy.grid import fit_box, wave_grid
from reference_encoder.entropy.train import code_uses, train
from reference_encoder.options import EncodeOptions
from reference_encoder.predict import choose_predictors
from scarfmt.directory import local_bits, tile_frame
from scarfmt.model import DecodedContext, LayerRow, SceneModel
from scarfmt.neural.network import Inputs
from scarfmt.tile import TileContent
from scarfmt.writer import QuantisedScene, Report, silent, write_scene

I16 = NDArray[np.int16]
Candidate = Callable[[QuantisedScene, EncodeOptions, Report], QuantisedScene | None]

CONTEXT = DecodedContext(passes_log2=2, occupancies=(32, 4))
"""Finer contexts save a little more and cost a decoder more runs: docs/decisions/0009."""


def smallest_file(scene: QuantisedScene, options: EncodeOptions, report: Report = silent) -> bytes:
    """The bytes of the smallest file found for a scene.

    Args:
        scene: quantised, with static tables only.
        options: `decode_budget` bounds what is tried.
        report: told (stage, fraction done).
    """
    best = write_scene(scene, report)
    candidates: tuple[Candidate, ...] = (with_predictors, with_index_network)
    for candidate in candidates:
        tried = candidate(scene, options, report)
        if tried is None or not _affordable(tried, options):
            continue
        data = write_scene(tried, report)
        if len(data) < len(best):
            scene, best = tried, data
    return best


def multiply_adds(scene: QuantisedScene) -> int:
    """Multiply-adds of integer networks that an anchor of the last layer may cost a decoder."""
    products = sum(predictor.multiply_adds for group in scene.predictors.values() for predictor in group)
    return products + (scene.network.multiply_adds(scene.model.max_stages) if scene.network is not None else 0)


def _affordable(scene: QuantisedScene, options: EncodeOptions) -> bool:
    return options.decode_budget is None or multiply_adds(scene) <= options.decode_budget


def with_predictors(scene: QuantisedScene, options: EncodeOptions, report: Report) -> QuantisedScene | None:
    """The scene with a predictor for every step of every component where one pays; None if none does."""
    if options.decode_budget == 0:
        return None
    report("predictors", 0.0)
    model = replace(scene.model, context=CONTEXT)
    bits = [local_bits(scene.fields, tile) for tile in scene.tiles]
    found = choose_predictors(model, scene.contents, bits, options.seed, options.effort)
    report("predictors", 1.0)
    return replace(scene, model=model, predictors=found) if found else None


def with_index_network(scene: QuantisedScene, options: EncodeOptions, report: Report) -> QuantisedScene | None:
    """The scene with a trained index network, codebooks in the order of its clusters; None without indices."""
    if options.decode_budget == 0 or scene.codebooks is None:
        return None
    context = scene.model.context if scene.predictors else CONTEXT
    model = replace(scene.model, context=context, layers=tuple(_neural(row) for row in scene.model.layers))
    seen = ContextOptions(context.passes_log2, context.occupancies, latents=min(LATENTS, scene.codebooks.dimension))
    bits = [local_bits(scene.fields, tile) for tile in scene.tiles]
    most = BUDGETS[options.effort].rows
    rows = index_rows(model, scene.contents, bits, scene.codebooks, seen, most, options.seed)
    coarse, residual = code_uses(rows, scene.codebooks.sizes)
    books, clusters = arrange(scene.codebooks, (coarse, residual))
    positions = lattice_positions(rows, scene.contents, [tile_frame(scene.fields, tile) for tile in scene.tiles])
    grid = wave_grid(fit_box(positions)[0])
    inputs = np.concatenate([rows.inputs, grid.features(positions)], axis=1)
    rows = replace(rows, inputs=inputs, codes=_renumbered(rows.codes, clusters))
    shape = shape_for(rows.symbols, books.dimension)
    trained = train(
        rows,
        books,
        [c.sizes for c in clusters],
        shape,
        training_for(len(rows), options.effort, options.seed),
        partial(report, "entropy network"),
    )
    attributes = sum(model.channels[index].components for index in model.attributes)
    columns = Inputs(
        model.layers[-1].class_count,
        seen.own,
        attributes,
        len(context.occupancies),
        seen.latents,
        seen.latent_shift,
        grid.width,
    )
    network = export(trained.model, columns, books)
    contents = tuple(_recoded(model, content, clusters) for content in scene.contents)
    return replace(scene, model=model, contents=contents, codebooks=books, network=network, grid=grid)


def _neural(row: LayerRow) -> LayerRow:
    return replace(row, neural=max(row.stages) > 0)


def _renumbered(codes: I16, clusters: Sequence[Clusters]) -> I16:
    """(n, M) indices by the clusters' new numbers: the coarse book's, then the residual book's."""
    ranks = [found.ranks.astype(np.int16) for found in clusters]
    return np.stack([ranks[min(stage, 1)][codes[:, stage]] for stage in range(codes.shape[1])], axis=1)


def _recoded(model: SceneModel, content: TileContent, clusters: Sequence[Clusters]) -> TileContent:
    received = model.stages(len(model.layers), content.classes)
    indices = _renumbered(content.indices, clusters) * (np.arange(model.max_stages) < received[:, None])
    return replace(content, indices=indices.astype(np.int16))
