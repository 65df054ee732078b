"""The scene that the last layer of a file holds, from its integers (encoder side of SPEC §9).

What is coded is coded without loss: what this gives is what a decoder gives, but for the rounding of binary32
(tests/reference_encoder/judge/test_finished.py holds it to that).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from reference_encoder.decide.targets import joined_classes
from reference_encoder.judge.values import applied, codeword_sums
from scarfmt.arrays import F32, F64, I64
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import tile_frame
from scarfmt.container.morton import deinterleave
from scarfmt.container.schema import Stream
from scarfmt.engines import best_engine
from scarfmt.scene.activation import activated
from scarfmt.scene.gaussians import AnchorModel, GaussianScene, Mlp

_NETWORKS = ("opacity", "cov", "color")


def finished_gaussians(scene: QuantisedScene) -> GaussianScene:
    """The Gaussians of an explicit file, in file order."""
    classes = joined_classes(scene)
    values, count = values_by_stream(scene, classes), len(classes)
    rotations, logits, colours = activated(values, count, np.float32)
    sh = np.zeros((count, (scene.fields.sh_degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = colours
    if scene.decoder is not None:
        rest = network_outputs(scene, values, classes)
        given = rest.shape[1] // 3
        sh[:, sh.shape[1] - given :] = rest.reshape(count, given, 3)
    return GaussianScene(
        anchor_positions(scene, values.get(Stream.POSITION_RESIDUAL)),
        values[Stream.SCALE],
        rotations.astype(np.float32),
        logits.astype(np.float32),
        sh,
    )


def finished_anchors(scene: QuantisedScene) -> AnchorModel:
    """The model of an anchor file, in file order."""
    classes = joined_classes(scene)
    values = values_by_stream(scene, classes)
    return AnchorModel(
        anchor_positions(scene, values.get(Stream.POSITION_RESIDUAL)),
        network_outputs(scene, values, classes),
        values[Stream.OFFSETS],
        values[Stream.SCALE],
        {name: _perceptron(mlp) for name, mlp in zip(_NETWORKS, scene.scene_mlps, strict=True)},
        np.concatenate([content.slot_layers > 0 for content in scene.contents]),
    )


def values_by_stream(scene: QuantisedScene, classes: I64) -> Mapping[Stream, F32]:
    """(N, components) of every channel; of OFFSETS (N, K, 3)."""
    model, found = scene.model, {}
    for index, channel in enumerate(model.channels):
        integers = np.concatenate([content.values[index] for content in scene.contents])
        if channel.per_slot:
            found[channel.stream] = (integers * np.array(channel.first_width)).astype(np.float32)
        else:
            steps = model.steps(len(model.layers), index, classes)
            found[channel.stream] = best_engine().channel_values(integers, channel.first_width, steps)
    return found


def anchor_positions(scene: QuantisedScene, residuals: F32 | None) -> F64:
    """(N, 3) float64, world units (SPEC §9.1)."""
    places, cells = [], []
    for tile, content in zip(scene.tiles, scene.contents, strict=True):
        frame, cell = tile_frame(scene.fields, tile), float(1 << tile.shift)
        places.append(np.array(frame.corner) + (deinterleave(content.codes).astype(np.float64) + 0.5) * cell)
        cells.append(np.full(len(content), cell))
    at = np.concatenate(places)
    if residuals is not None:
        at += np.concatenate(cells)[:, None] * residuals
    return np.asarray(np.array(scene.fields.origin) + scene.fields.voxel * at)


def network_outputs(scene: QuantisedScene, values: Mapping[Stream, F32], classes: I64) -> F32:
    """(N, outputs) of the latent decoder."""
    assert scene.decoder is not None
    z = np.zeros((len(classes), scene.decoder.inputs), np.float32)
    if scene.codebooks is not None:
        received = scene.model.stages(len(scene.model.layers), classes)
        indices = np.concatenate([content.indices for content in scene.contents])
        z = codeword_sums(scene.codebooks, indices, received)
    if Stream.LATENT in values:
        z += values[Stream.LATENT]
    out = np.empty((len(z), scene.decoder.outputs), np.float32)
    applied(scene.decoder, z, out)
    return out


def _perceptron(network: QuantisedMlp) -> Mlp:
    first, second = network.layers
    matrices = first.matrix.astype(np.float32), second.matrix.astype(np.float32)
    return Mlp(matrices, (first.biases.astype(np.float32), second.biases.astype(np.float32)))
