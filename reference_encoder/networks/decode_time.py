"""The decoding work of the networks of a scene, and its time by the decoder model (encoder side).

:mod:`scarfmt.coding.decoder_model` has the nanoseconds; here are the numbers of what is done so many times.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import I64
from scarfmt.coding.decoder_model import DECODER
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Stream
from scarfmt.scene.model import MAX_CLASSES, LayerRow, SceneModel


@dataclass(frozen=True)
class Work:
    """The decoding work of networks of one kind.

    Attributes:
        multiply_adds: of all anchors.
        anchors: for which their inputs are made, each as often as that happens; of predictors, for every component.
    """

    multiply_adds: int
    anchors: int


def class_counts(contents: Sequence[TileContent]) -> I64:
    """(MAX_CLASSES,) anchors of each class."""
    counts = np.zeros(MAX_CLASSES, np.int64)
    for content in contents:
        counts += np.bincount(content.classes, minlength=MAX_CLASSES)
    return counts


def received(model: SceneModel, channel: int, step: int, counts: I64) -> int:
    """Anchors that receive a step of a channel, in whatever layer, given (MAX_CLASSES,) anchors of each class."""
    steps = np.array([row[channel] for row in model.layers[-1].steps])
    return int(counts[: len(steps)][steps >= step].sum())


def predictor_work(scene: QuantisedScene) -> dict[Stream, Work]:
    """The work of the predictors of each channel that has any."""
    counts, model = class_counts(scene.contents), scene.model
    products: dict[tuple[Stream, int], int] = {}
    for predictor in (predictor for group in scene.predictors.values() for predictor in group):
        key = predictor.stream, predictor.step
        products[key] = products.get(key, 0) + predictor.multiply_adds
    work: dict[Stream, Work] = {}
    for (stream, step), each in sorted(products.items()):
        channel, known = model.channel_index(stream), work.get(stream, Work(0, 0))
        assert channel is not None
        anchors = received(model, channel, step, counts)
        components = model.channels[channel].components
        work[stream] = Work(known.multiply_adds + each * anchors, known.anchors + components * anchors)
    return work


def index_work(scene: QuantisedScene) -> Work:
    """The work of the index network in all layers that are coded by it."""
    if scene.network is None:
        return Work(0, 0)
    counts, coded = class_counts(scene.contents), list(_coded_stages(scene.model))
    products = sum(int(counts[kind]) * scene.network.multiply_adds(after) for kind, after in coded)
    return Work(products, sum(int(counts[kind]) for kind, _ in coded))


def index_network_ns(scene: QuantisedScene) -> float:
    """Nanoseconds that the index network of a scene takes of a decoder."""
    work = index_work(scene)
    return DECODER.index_network_ns(work.multiply_adds, work.anchors)


def networks_ns(scene: QuantisedScene) -> float:
    """Nanoseconds that all integer networks of a scene take of a decoder."""
    predictors = predictor_work(scene).values()
    return index_network_ns(scene) + sum(DECODER.predictors_ns(work.multiply_adds, work.anchors) for work in predictors)


def _coded_stages(model: SceneModel) -> Iterator[tuple[int, int]]:
    """(class, stages after it) of every layer that gives a class stages by the network."""
    before: LayerRow | None = None
    for row in model.layers:
        for kind, after in enumerate(row.stages):
            known = before.stages[kind] if before is not None and kind < before.class_count else 0
            if row.neural and after > known:
                yield kind, after
        before = row
