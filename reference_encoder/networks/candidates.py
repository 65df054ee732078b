"""Scenes with networks, tried because they may make a smaller file (SPEC §10; encoder side).

Coding with networks is slow, so candidates go by what a trained network says of the bits; `pipeline.best_file`
codes only the last.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from reference_encoder.decide.targets import Targets, refinement_bits
from reference_encoder.networks.affordable import Bounds, seen_by
from reference_encoder.networks.clusters import Clusters, arrange
from reference_encoder.networks.dataset import IndexRows
from reference_encoder.networks.defaults import training_for
from reference_encoder.networks.export import export
from reference_encoder.networks.model import IndexModel
from reference_encoder.networks.predict import choose_predictors
from reference_encoder.networks.rechoose import rechosen
from reference_encoder.networks.train import Trained, TrainOptions, code_uses, train
from reference_encoder.networks.view import NetworkView
from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.tuning import CONTEXT, ROUND_EPOCHS, ROUND_LEARNING_RATE
from scarfmt.arrays import I16
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene, Report
from scarfmt.container.directory import local_bits
from scarfmt.scene.model import LayerRow, SceneModel


def with_rounds(learned: Learned, targets: Targets, options: EncodeOptions, report: Report) -> Learned:
    """After rounds of choosing codewords again, as long as bits saved are worth the added error."""
    for _ in range(EFFORTS[options.effort].rounds):
        tried = another_round(learned, targets, options, report)
        if expected_cost(tried, targets) >= expected_cost(learned, targets):
            break
        learned = tried
    return learned


def expected_cost(learned: Learned, targets: Targets) -> float:
    """J = D + lambda * bits of what the latents take, by the trained network and without coding anything."""
    return targets.cost(learned.scene, 0) + targets.lambda_ * (learned.bits + refinement_bits(learned.scene))


def multiply_adds(scene: QuantisedScene) -> int:
    """Multiply-adds of integer networks that an anchor of the last layer may cost a decoder."""
    products = sum(predictor.multiply_adds for group in scene.predictors.values() for predictor in group)
    return products + (scene.network.multiply_adds(scene.model.max_stages) if scene.network is not None else 0)


def _budget_left(scene: QuantisedScene, options: EncodeOptions) -> float:
    return float("inf") if options.decode_budget is None else options.decode_budget - multiply_adds(scene)


def with_predictors(scene: QuantisedScene, options: EncodeOptions, report: Report) -> QuantisedScene | None:
    """The scene with a predictor for every step of every component where one pays; None if none does."""
    report("predictors", 0.0)
    model = replace(scene.model, context=CONTEXT)
    bits = [local_bits(scene.fields, tile) for tile in scene.tiles]
    found = choose_predictors(model, scene.contents, bits, options.seed, options.effort, options.bits_per_ns)
    report("predictors", 1.0)
    return replace(scene, model=model, predictors=found) if found else None


def affordable_predictors(scene: QuantisedScene, options: EncodeOptions, report: Report) -> QuantisedScene | None:
    """:func:`with_predictors` within the budget of a decoder; None if none pays or all together are too dear."""
    found = with_predictors(scene, options, report)
    return None if found is None or _budget_left(found, options) < 0 else found


@dataclass(frozen=True)
class Learned:
    """A scene with an index network, and the network as it was trained.

    Attributes:
        scene: indices and books in the order of the clusters.
        model: the network of the scene, in torch.
        view: what it sees.
        training: how it was trained.
        clusters: sizes of the clusters of both books.
        bits: of indices and network, estimated.
    """

    scene: QuantisedScene
    model: IndexModel
    view: NetworkView
    training: TrainOptions
    clusters: tuple[tuple[int, ...], ...]
    bits: float


def with_index_network(
    scene: QuantisedScene, options: EncodeOptions, report: Report, most_ns: float = math.inf
) -> Learned | None:
    """The scene with a trained index network, codebooks in the order of its clusters.

    None without indices, or where not even the narrowest network keeps to the budget and to `most_ns`, the nanoseconds
    that a decoder may spend on it; then nothing is trained.
    """
    old = scene.codebooks
    if old is None:
        return None
    scene = with_neural_layers(scene)
    model = scene.model
    bounds = Bounds(scene, old, _budget_left(scene, options), most_ns)
    kinds = (False, True) if EFFORTS[options.effort].attention else (False,)
    shapes = [shape for shape in map(bounds.widest, kinds) if shape is not None]
    if not shapes:
        return None
    view, rows = NetworkView.of(scene, seen_by(scene, old), EFFORTS[options.effort].training.rows, options.seed)
    scene, rows, sizes = arranged(scene, rows)
    books = scene.codebooks
    assert books is not None
    training = training_for(len(rows), options.effort, options.seed)
    best: Trained | None = None
    for shape in shapes:
        tried = train(rows, books, sizes, shape, training, partial(report, "entropy network"))
        best = tried if best is None or tried.bits < best.bits else best
    assert best is not None
    network = export(best.model, view.columns(model), books)
    return Learned(replace(scene, network=network, grid=view.grid), best.model, view, training, sizes, best.bits)


def arranged(scene: QuantisedScene, rows: IndexRows) -> tuple[QuantisedScene, IndexRows, tuple[tuple[int, ...], ...]]:
    """The scene and its rows with both books in the order of clusters, and the sizes of the clusters of each."""
    old = scene.codebooks
    assert old is not None
    coarse, residual = code_uses(rows, old.sizes)
    books, clusters = arrange(old, (coarse, residual))
    rows = replace(rows, codes=_renumbered(rows.codes, clusters))
    contents = tuple(_recoded(scene.model, content, clusters) for content in scene.contents)
    return replace(scene, contents=contents, codebooks=books), rows, tuple(c.sizes for c in clusters)


def another_round(learned: Learned, targets: Targets, options: EncodeOptions, report: Report) -> Learned:
    """Codewords chosen again at the network's prices, and the network trained on for a while on what was chosen."""
    scene, books = learned.scene, learned.scene.codebooks
    assert books is not None
    scene = rechosen(scene, learned.model, learned.view, targets, partial(report, "codewords"))
    most = EFFORTS[options.effort].training.rows
    rows = learned.view.rows(scene, range(len(scene.tiles)), most, options.seed)
    training = replace(learned.training, epochs=max(1, round(learned.training.epochs * ROUND_EPOCHS)))
    training = replace(training, learning_rate=ROUND_LEARNING_RATE)
    shape, start = learned.model.shape, deepcopy(learned.model)
    trained = train(rows, books, learned.clusters, shape, training, partial(report, "entropy network"), start)
    network = export(trained.model, learned.view.columns(scene.model), books)
    return replace(learned, scene=replace(scene, network=network), model=trained.model, bits=trained.bits)


def with_neural_layers(scene: QuantisedScene) -> QuantisedScene:
    """The scene with all its indices to be coded by an index network, which it does not have yet."""
    context = scene.model.context if scene.predictors else CONTEXT
    layers = tuple(_neural(row) for row in scene.model.layers)
    return replace(scene, model=replace(scene.model, context=context, layers=layers))


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
