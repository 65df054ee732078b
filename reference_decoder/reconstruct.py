"""From integers to the values of anchors, and to Gaussians or to an anchor model (SPEC §9). The encoder shares it.

Values and positions are exact: binary64 without fused operations, rounded once (SPEC §9.1, §9.2). Activated values
are within a tolerance of those in float64 (SPEC §9.3-9.5); they are made in chunks, so that scratch memory does not
grow with the scene.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, I64, U64, Bools, Floats, Ints
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.codecs.channels import cell_widths, channel_values, in_binary32
from scarfmt.coding.tile import TileContent
from scarfmt.container.directory import Tile, corners
from scarfmt.container.morton import deinterleave
from scarfmt.container.schema import Stream
from scarfmt.scene.activation import activate
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import AnchorModel, GaussianScene, Mlp
from scarfmt.scene.model import Codebooks, Lattice, SceneModel

Codewords = tuple[Codebooks | None, Ints, I64]
"""Codebooks, if there are any, (n, M) numbers of codewords, and the (n,) stages received."""
NETWORKS = ("opacity", "cov", "color")
_ACTIVATED = (Stream.ROTATION, Stream.OPACITY, Stream.COLOUR)
_ROWS = 4096
"""Anchors at a time: what is between the layers of the latent decoder stays in the cache."""


def channel_arrays(model: SceneModel, content: TileContent) -> dict[Stream, F32]:
    """The exact values of every channel after the last layer, (n, components) float32; of OFFSETS (n, K, 3).

    Those of POSITION_RESIDUAL are what :func:`positions` takes.
    """
    values = {}
    for index, channel in enumerate(model.channels):
        if channel.per_slot:
            values[channel.stream] = in_binary32(content.values[index], np.asarray(channel.first_width))
        else:
            steps = model.steps(len(model.layers), index, content.classes)
            values[channel.stream] = channel_values(content.values[index], channel.first_width, steps)
    return values


def positions(lattice: Lattice, tile: Tile, codes: U64, residuals: F64 | None) -> F64:
    """(n, 3) float64 world positions of a tile's anchors (SPEC §9.1).

    Args:
        codes: (n,) uint64 local Morton codes.
        residuals: (n, 3) float64 position residuals in cells of 2^shift voxels, None for none; their reach is checked.
    """
    cell = float(1 << tile.shift)
    local = deinterleave(codes).astype(np.float64)
    depth, prefix = np.array([tile.depth], np.uint8), np.array([tile.prefix], np.uint64)
    at = (corners(lattice.bits, depth, prefix) + local * cell) + cell / 2
    if residuals is not None:
        at += cell * residuals
    return np.asarray(lattice.origin, np.float64) + lattice.voxel * at


def residuals(model: SceneModel, content: TileContent) -> F64 | None:
    """(n, 3) float64 position residuals in cells; None where the file has none."""
    index = model.channel_index(Stream.POSITION_RESIDUAL)
    if index is None:
        return None
    steps = model.steps(len(model.layers), index, content.classes)
    return np.asarray(content.values[index] * cell_widths(model.channels[index].first_width, steps))


def latents(books: Codebooks | None, indices: Ints, stages: I64, refinements: F32 | None, dimension: int) -> F32:
    """(n, d) float32 latents: binary32(sum of codewords) + value of the latent channel, in binary32 (SPEC §9.2).

    Args:
        books: coarse and residual codewords; None where no layer so far has stages.
        indices: (n, M) codeword numbers.
        stages: (n,) stages received, 0..M.
        refinements: (n, d) values of the latent channel, None where there is none.
        dimension: d.
    """
    # Sums of codewords are integers below 2^24: exact in binary32, in any order.
    z = np.zeros((len(indices), dimension), np.float32)
    if books is not None:
        # A row of zeros after the last codeword stands for a stage that was not received.
        nothing = np.zeros((1, dimension), np.int64)
        padded = [np.vstack([book, nothing]).astype(np.float32) for book in (books.coarse, books.residual)]
        for stage in range(indices.shape[1]):
            book = padded[min(stage, 1)]
            z += book[np.where(stages > stage, indices[:, stage], len(book) - 1)]
    if refinements is not None:
        z += refinements
    return z


def explicit_scene(
    at: F64,
    values: Mapping[Stream, F32],
    sh_degree: int,
    decoder: QuantisedMlp | None,
    codewords: Codewords,
    description: Description,
    dtype: type = np.float32,
) -> GaussianScene:
    """The Gaussians of n anchors of the explicit profile.

    Args:
        at: (n, 3) float64 positions, used as they are.
        values: exact channel values, (n, components) float32; SCALE is needed, the others count as 0.
        sh_degree: of the file, 0..3.
        decoder: of latents to the highest coefficients, None for none.
        codewords: parts of the latents beside the LATENT channel.
        dtype: float32, or float64 for the reference the tolerances are relative to (SPEC §9.5).
    """
    count, coefficients = len(at), (sh_degree + 1) ** 2
    rotations: NDArray[Any] = np.empty((count, 4), dtype)
    logits: NDArray[Any] = np.empty(count, dtype)
    sh: NDArray[Any] = np.zeros((count, coefficients, 3), dtype)
    for first in range(0, count, _ROWS):
        rows = slice(first, first + _ROWS)
        part = {stream: values[stream][rows] for stream in _ACTIVATED if stream in values}
        rotations[rows], logits[rows], sh[rows, 0] = activate(part, len(logits[rows]), dtype)
    if decoder is not None:
        rest = network_outputs(decoder, values.get(Stream.LATENT), codewords, count, dtype)
        given = rest.shape[1] // 3
        sh[:, coefficients - given :] = rest.reshape(count, given, 3)
    scales: F32 = values[Stream.SCALE].astype(dtype, copy=False)
    return GaussianScene(at, scales, rotations, logits, sh, description=description)


def anchor_model(
    at: F64,
    values: Mapping[Stream, F32],
    slots: Bools,
    decoder: QuantisedMlp,
    scene_mlps: tuple[QuantisedMlp, ...],
    codewords: Codewords,
    dtype: type = np.float32,
) -> AnchorModel:
    """The model of n anchors of the anchor profile.

    Args:
        at: (n, 3) float64 positions.
        values: SCALE (n, 6) and OFFSETS (n, K, 3) float32, and LATENT.
        slots: (n, K) bool, slots that are on.
        decoder: of latents to features.
        scene_mlps: the three networks, in the order of `NETWORKS`.
        codewords: parts of the latents beside the LATENT channel.
        dtype: of the features: float32, or float64 for the reference.
    """
    features = network_outputs(decoder, values.get(Stream.LATENT), codewords, len(at), dtype)
    mlps = {name: _perceptron(network, dtype) for name, network in zip(NETWORKS, scene_mlps, strict=True)}
    return AnchorModel(at, features, values[Stream.OFFSETS], values[Stream.SCALE], mlps, slots)


def network_outputs(
    decoder: QuantisedMlp, refinements: F32 | None, codewords: Codewords, count: int, dtype: type
) -> Floats:
    """(n, outputs) of the latent decoder, computed in `dtype`; the latents themselves are exact."""
    books, indices, stages = codewords
    out: NDArray[Any] = np.empty((count, decoder.outputs), dtype)
    for first in range(0, count, _ROWS):
        rows = slice(first, first + _ROWS)
        refined = None if refinements is None else refinements[rows]
        z = latents(books, indices[rows], stages[rows], refined, decoder.inputs)
        with np.errstate(over="ignore", invalid="ignore"):  # weights may be any finite number: not a reason to warn
            out[rows] = decoder.apply(z, dtype)
    return out


def _perceptron(network: QuantisedMlp, dtype: type) -> Mlp:
    first, second = network.layers
    with np.errstate(over="ignore"):  # a weight may be any product of two finite numbers
        matrices: tuple[Floats, Floats] = first.matrix.astype(dtype), second.matrix.astype(dtype)
    return Mlp(matrices, (first.biases.astype(dtype), second.biases.astype(dtype)))
