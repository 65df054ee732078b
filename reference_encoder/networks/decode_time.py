"""What the networks of a scene take of a decoder, by the model of one (encoder side).

:mod:`scarfmt.coding.decoder_model` has the nanoseconds; here are the numbers of what is done so many times.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from scarfmt.arrays import I64
from scarfmt.coding.decoder_model import DECODER
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.model import MAX_CLASSES, LayerRow, SceneModel


def class_counts(contents: Sequence[TileContent]) -> I64:
    """(MAX_CLASSES,) anchors of each class."""
    counts = np.zeros(MAX_CLASSES, np.int64)
    for content in contents:
        counts += np.bincount(content.classes, minlength=MAX_CLASSES)
    return counts


def received(model: SceneModel, channel: int, step: int, counts: I64) -> int:
    """Anchors that receive a step of a channel, in whatever layer."""
    steps = np.array([row[channel] for row in model.layers[-1].steps])
    return int(counts[: len(steps)][steps >= step].sum())


def predictors_ns(scene: QuantisedScene) -> float:
    """Nanoseconds that the predictors of a scene take of a decoder."""
    found = [predictor for group in scene.predictors.values() for predictor in group]
    counts = class_counts(scene.contents)

    def anchors(predictor: Predictor) -> int:
        channel = scene.model.channel_index(predictor.stream)
        assert channel is not None
        return received(scene.model, channel, predictor.step, counts)

    shared = {(predictor.stream, predictor.step): anchors(predictor) for predictor in found}
    products = sum(predictor.multiply_adds * anchors(predictor) for predictor in found)
    return DECODER.predictor_multiply_add * products + DECODER.predicted * sum(shared.values())


def index_network_ns(scene: QuantisedScene) -> float:
    """Nanoseconds that the index network of a scene takes of a decoder in all layers that are coded by it."""
    if scene.network is None:
        return 0.0
    counts = class_counts(scene.contents)
    return sum(
        int(counts[kind]) * (DECODER.index_row + DECODER.index_multiply_add * scene.network.multiply_adds(after))
        for kind, after in _coded_stages(scene.model)
    )


def networks_ns(scene: QuantisedScene) -> float:
    """Nanoseconds that all integer networks of a scene take of a decoder."""
    return predictors_ns(scene) + index_network_ns(scene)


def _coded_stages(model: SceneModel) -> Iterator[tuple[int, int]]:
    """(class, stages after it) of every layer that gives a class stages by the network."""
    before: LayerRow | None = None
    for row in model.layers:
        for kind, after in enumerate(row.stages):
            known = before is not None and kind < before.class_count
            if row.neural and after > (before.stages[kind] if before is not None and known else 0):
                yield kind, after
        before = row
