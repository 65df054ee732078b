"""Which integer networks a file gets: whatever makes it smaller, by measured bytes (SPEC §10; encoder side).

Predictors of channel values come first, each only if it saves more than it takes; then the index network. With it,
codewords are chosen again at its prices; a round of that is kept if bits and error together, in the encoder's currency,
are less than before. Coding with networks is slow, so rounds go by what the trained network says of the bits, and only
the last is coded; the network stays if what it codes and its own blocks then cost less than indices under static
tables. The static file is made in any case: what is returned is never larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from reference_encoder.decide.targets import Targets, refinement_bits
from reference_encoder.latent.rechoose import rechosen
from reference_encoder.networks.clusters import Clusters, arrange
from reference_encoder.networks.dataset import ContextOptions
from reference_encoder.networks.defaults import BUDGETS, LATENTS, narrower, shape_for, training_for
from reference_encoder.networks.export import export
from reference_encoder.networks.model import IndexModel, NetworkShape
from reference_encoder.networks.predict import choose_predictors
from reference_encoder.networks.train import Trained, TrainOptions, build, code_uses, train
from reference_encoder.networks.view import NetworkView
from reference_encoder.options import EncodeOptions
from scarfmt.blocks.tables import pack_tables
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene, Report, silent, write_scene
from scarfmt.container.bytefields import compress
from scarfmt.container.directory import local_bits
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.container.source import BytesSource
from scarfmt.engines import best_engine
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import LimitExceeded
from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS, Limits
from scarfmt.neural.network import IndexNetwork
from scarfmt.scene.model import DecodedContext, LayerRow, SceneModel
from scarfmt.tools.truncate import truncate

I16 = NDArray[np.int16]

CONTEXT = DecodedContext(passes_log2=2, occupancies=(32, 4))
"""Finer contexts save a little more and cost a decoder more runs: docs/decisions/0009."""

ROUNDS = {1: 0, 2: 1, 3: 3}
"""Rounds of choosing codewords again, by effort."""
_SHARE, _RATE = 0.25, 0.01
"""Of the first training's epochs, and learning rate, in each round."""


def smallest_file(
    scene: QuantisedScene, options: EncodeOptions, report: Report = silent, targets: Targets | None = None
) -> bytes:
    """The bytes of the smallest file found for a scene; with `targets`, of the best by bytes and error together.

    Args:
        scene: quantised, with static tables only.
        options: `decode_budget` bounds what is tried; of `effort`, 1 tries nothing, and 3 several networks.
        report: told (stage, fraction done).
        targets: what the codewords are to reproduce; None keeps the indices as they are.
    """
    static = write_scene(scene, report, best_engine())
    if options.effort == 1 or options.decode_budget == 0:
        return static
    predicted = with_predictors(scene, options, report)
    if predicted is not None and _budget_left(predicted, options) < 0:
        predicted = None
    learned = with_index_network(predicted or scene, options, report)
    if learned is not None and learned.bits < 8 * index_bytes(static):
        learned = learned if targets is None else with_rounds(learned, targets, options, report)
        data = write_scene(learned.scene, report, best_engine())
        if _cost(learned.scene, data, targets) < _cost(scene, static, targets):
            return _smaller(static, data)
    return static if predicted is None else _smaller(static, write_scene(predicted, report, best_engine()))


def _cost(scene: QuantisedScene, data: bytes, targets: Targets | None) -> float:
    """What a scene's latents cost in its file `data`: bits, and with `targets` error."""
    reader = SceneReader(BytesSource(data), limits=FORMAT_LIMITS)
    size = index_bytes(data) + sum(layer.stream_bytes[Stream.LATENT] for layer in reader.header.layers)
    return 8.0 * size if targets is None else targets.cost(scene, size)


def _smaller(static: bytes, neural: bytes) -> bytes:
    return neural if len(neural) < len(static) and within_limits(neural) else static


def within_limits(data: bytes, limits: Limits = DEFAULT_LIMITS) -> bool:
    """Whether readers of these limits take a file, and all that truncation makes of it (SPEC R-13.2-2)."""
    try:
        for layer in range(1, SceneReader(BytesSource(data)).layers + 1):
            SceneReader(BytesSource(truncate(BytesSource(data), layer)), limits=limits).models()
    except LimitExceeded:
        return False
    return True


def index_bytes(data: bytes) -> int:
    """What the indices of a file take: sub-streams, static tables, index network and hash grid."""
    reader = SceneReader(BytesSource(data), limits=FORMAT_LIMITS)
    own = (BlockKind.ENTROPY_NETWORK, BlockKind.HASH_GRID)
    total = sum(layer.stream_bytes[Stream.INDICES] for layer in reader.header.layers)
    total += sum(entry.length for entry in reader.container.entries if entry.kind in own)
    before: dict[TableKey, SymbolTable] = {}
    for tables in reader.models().tables:
        sent = {key: t for key, t in tables.items() if key.stream == Stream.INDICES and before.get(key) is not t}
        total += len(compress(pack_tables(sent))) if sent else 0
        before = tables
    return total


def with_rounds(learned: Learned, targets: Targets, options: EncodeOptions, report: Report) -> Learned:
    """After rounds of choosing codewords again, as long as bits saved are worth the added error."""
    for _ in range(ROUNDS[options.effort]):
        tried = another_round(learned, targets, options, report)
        if expected_cost(tried, targets) >= expected_cost(learned, targets):
            break
        learned = tried
    return learned


def expected_cost(learned: Learned, targets: Targets) -> float:
    """J = D + lambda * bits of what the latents take, by the trained network and without coding anything."""
    return targets.cost(learned.scene, 0) + targets.rate * (learned.bits + refinement_bits(learned.scene))


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
    found = choose_predictors(model, scene.contents, bits, options.seed, options.effort)
    report("predictors", 1.0)
    return replace(scene, model=model, predictors=found) if found else None


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


def with_index_network(scene: QuantisedScene, options: EncodeOptions, report: Report) -> Learned | None:
    """The scene with a trained index network, codebooks in the order of its clusters.

    None without indices, or where not even the narrowest network keeps to the budget.
    """
    old = scene.codebooks
    if old is None:
        return None
    context = scene.model.context if scene.predictors else CONTEXT
    model = replace(scene.model, context=context, layers=tuple(_neural(row) for row in scene.model.layers))
    scene = replace(scene, model=model)
    seen = ContextOptions(context.passes_log2, context.occupancies, latents=min(LATENTS, old.dimension))
    view, rows = NetworkView.of(scene, seen, BUDGETS[options.effort].rows, options.seed)
    coarse, residual = code_uses(rows, old.sizes)
    books, clusters = arrange(old, (coarse, residual))
    rows = replace(rows, codes=_renumbered(rows.codes, clusters))
    sizes = tuple(c.sizes for c in clusters)
    training = training_for(len(rows), options.effort, options.seed)

    def untrained(shape: NetworkShape) -> IndexNetwork:
        return export(build(rows, books, sizes, shape, options.seed), view.columns(model), books)

    best: Trained | None = None
    for attention in (False, True) if options.effort == 3 else (False,):
        shape: NetworkShape | None = shape_for(rows.symbols, books.dimension, attention)
        while shape is not None and untrained(shape).multiply_adds(model.max_stages) > _budget_left(scene, options):
            shape = narrower(shape)
        if shape is None:
            continue
        tried = train(rows, books, sizes, shape, training, partial(report, "entropy network"))
        best = tried if best is None or tried.bits < best.bits else best
    if best is None:
        return None
    contents = tuple(_recoded(model, content, clusters) for content in scene.contents)
    network = export(best.model, view.columns(model), books)
    scene = replace(scene, contents=contents, codebooks=books, network=network, grid=view.grid)
    return Learned(scene, best.model, view, training, sizes, best.bits)


def another_round(learned: Learned, targets: Targets, options: EncodeOptions, report: Report) -> Learned:
    """Codewords chosen again at the network's prices, and the network trained on for a while on what was chosen."""
    scene, books = learned.scene, learned.scene.codebooks
    assert books is not None
    scene = rechosen(scene, learned.model, learned.view, targets, partial(report, "codewords"))
    most = BUDGETS[options.effort].rows
    rows = learned.view.rows(scene, range(len(scene.tiles)), most, options.seed)
    training = replace(learned.training, epochs=max(1, round(learned.training.epochs * _SHARE)), rate=_RATE)
    shape, start = learned.model.shape, deepcopy(learned.model)
    trained = train(rows, books, learned.clusters, shape, training, partial(report, "entropy network"), start)
    network = export(trained.model, learned.view.columns(scene.model), books)
    return replace(learned, scene=replace(scene, network=network), model=trained.model, bits=trained.bits)


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
