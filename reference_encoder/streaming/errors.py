"""How far Gaussians of a file are from their final values after each layer (encoder only, informative)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from reference_encoder.decide.targets import joined_classes
from reference_encoder.judge.finished import network_outputs, values_by_stream
from reference_encoder.measure.attributes import from_scene
from reference_encoder.measure.sensitivity import SH_C0, measure
from reference_encoder.measure.weights import KindWeights, Weights
from reference_encoder.tuning import GAUSSIAN_ABSENCE
from scarfmt.arrays import F32, F64, Bools
from scarfmt.coding.writer import QuantisedScene, keep_layers
from scarfmt.container.schema import Stream
from scarfmt.scene.gaussians import GaussianScene

_DC = np.array([3.0, 3.0, 2.0])
"""Squared norms of the columns that make Y, G, O red, green and blue (SPEC §9.4)."""
ABSENCE = GAUSSIAN_ABSENCE
"""Cost of a missing splat, in squared relative changes of a splat. Its neighbours are usually missing, too."""


@dataclass(frozen=True)
class LayerErrors:
    """The errors that remain for all N anchors of a file after a layer.

    Attributes:
        shape: (N,) float64 squared relative change of the splats, at most :data:`ABSENCE`; that where there are none.
        colour: (N,) float64 squared change of their colour, red, green and blue together.
    """

    shape: F64
    colour: F64


@dataclass(frozen=True)
class State:
    """Values of the n anchors there are after a layer.

    Attributes:
        layer: from 1.
        there: (N,) bool which they are, of all anchors of the file.
        values: (n, components) of every channel.
        outputs: (n, outputs) of the latent decoder, 0 before anything of a latent is there.
    """

    layer: int
    there: Bools
    values: Mapping[Stream, F32]
    outputs: F32


def states(scene: QuantisedScene) -> Iterator[State]:
    """Values after each layer."""
    every = joined_classes(scene)
    latent = scene.model.channel_index(Stream.LATENT)
    for layer, row in enumerate(scene.model.layers, start=1):
        part = keep_layers(scene, layer)
        classes = joined_classes(part)
        values = values_by_stream(part, classes)
        received = max(row.stages) > 0 or (latent is not None and any(steps[latent] for steps in row.steps))
        if scene.decoder is not None and received:
            outputs = network_outputs(part, values, classes)
        else:
            outputs = np.zeros((len(classes), 0 if scene.decoder is None else scene.decoder.outputs), np.float32)
        yield State(layer, every < row.class_count, values, outputs)


def gaussian_errors(scene: QuantisedScene, drawn: GaussianScene, pixel: F64) -> list[LayerErrors]:
    """Errors after no layer, after layer 1, and so on to the last but one; after the last there is none.

    Args:
        scene: explicit.
        drawn: its Gaussians, in file order.
        pixel: (N,) width of a pixel at each, world units.
    """
    count = len(drawn)
    ones, none = np.ones(count, np.float32), np.zeros(count, np.float32)
    single = {"all": KindWeights(ones, ones)}
    weights = Weights(single, {"all": 1.0}, KindWeights(none, none), pixel.astype(np.float32), ones)
    channels = dict(measure(from_scene(drawn), weights).channels)
    cell = np.repeat([float(1 << tile.shift) for tile in scene.tiles], [len(each) for each in scene.contents])
    channels[Stream.POSITION_RESIDUAL] = (
        channels[Stream.POSITION_RESIDUAL] * ((cell * scene.fields.voxel) ** 2)[:, None]
    )
    *before, last = states(scene)
    return [LayerErrors(np.full(count, ABSENCE), np.zeros(count)), *(_left(state, last, channels) for state in before)]


def _left(state: State, last: State, sensitivity: Mapping[Stream, F64]) -> LayerErrors:
    there = state.there
    shape, colour = np.full(len(there), ABSENCE), np.zeros(len(there))
    total = np.zeros(int(there.sum()))
    for stream, final in last.values.items():
        if stream == Stream.LATENT:
            continue
        squared = (state.values[stream].astype(np.float64) - final[there]) ** 2
        if stream == Stream.COLOUR:
            colour[there] += SH_C0**2 * (squared @ _DC)
        else:
            total += (squared * sensitivity[stream][there]).sum(axis=1)
    shape[there] = np.minimum(total, ABSENCE)
    colour[there] += SH_C0**2 * ((state.outputs.astype(np.float64) - last.outputs[there]) ** 2).sum(axis=1)
    return LayerErrors(shape, colour)
