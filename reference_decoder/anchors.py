"""Anchor profile: anchors, and the Gaussians their networks make for a camera (SPEC §9.6; Scaffold-GS section 3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_decoder.reconstruct import NETWORKS
from scarfmt.arrays import F64, I64, Floats
from scarfmt.errors import InvalidInput
from scarfmt.scene.activation import opacity_logits
from scarfmt.scene.gaussians import AnchorModel, GaussianScene, Mlp

CHUNK = 1 << 14
"""Anchors at a time; the networks' hidden layers of so many rows fit in the caches."""
SH_C0 = 0.28209479177387814
"""Degree-0 spherical harmonic: colour = 0.5 + SH_C0 * coefficient."""


@dataclass(frozen=True)
class CameraGaussians:
    """M Gaussians as one camera sees them.

    Attributes:
        scene: the Gaussians; its degree-0 spherical harmonics are the colours.
        colours: (M, 3) R, G, B, 0..1, for :func:`scarfmt.render.rasterise.render`.
        anchors: (M,) int64 row of the anchor each belongs to, ascending.
        slots: (M,) int64 its slot.
    """

    scene: GaussianScene
    colours: Floats
    anchors: I64
    slots: I64


def gaussians(model: AnchorModel, camera_centre: Floats) -> CameraGaussians:
    """The Gaussians a camera at `camera_centre` sees, in anchor then slot order.

    Only slots of positive opacity are made; the covariance and colour networks run only for anchors that have one.

    Args:
        model: a decoded or an imported model, with all three networks.
        camera_centre: (3,) world units.

    Raises:
        InvalidInput: ``input-mlp`` when a network is missing.
    """
    if not set(NETWORKS) <= set(model.mlps):
        raise InvalidInput("input-mlp", f"an anchor model needs the networks {', '.join(NETWORKS)}", field="mlps")
    may_show = np.arange(len(model)) if model.slot_mask is None else np.flatnonzero(model.slot_mask.any(axis=1))
    parts = [
        _chunk(model, may_show[first : first + CHUNK], np.asarray(camera_centre, np.float64))
        for first in range(0, max(len(may_show), 1), CHUNK)
    ]
    positions, scales, rotations, logits, colours, anchors, slots = map(np.concatenate, zip(*parts, strict=True))
    sh: NDArray[Any] = ((colours - 0.5) / SH_C0).astype(np.float32)[:, None, :]
    return CameraGaussians(GaussianScene(positions, scales, rotations, logits, sh), colours, anchors, slots)


def outlook(model: AnchorModel, rows: I64, camera_centre: F64, dtype: type) -> Floats:
    """(n, D + 3 or D + 4) network inputs of anchors `rows`: feature, unit view direction, and distance if taken.

    An eye exactly at an anchor sees it in no direction.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # a position may be any finite number: not a reason to warn
        direction, length, exponent = unit_vectors(model.anchors[rows] - camera_centre)
        distance = np.ldexp(length, exponent)
        inputs: list[Floats] = [model.features[rows].astype(dtype), direction.astype(dtype), distance.astype(dtype)]
    takes_distance = model.mlps["opacity"].weights[0].shape[1] - model.features.shape[1] == 4
    return np.concatenate(inputs if takes_distance else inputs[:2], axis=1)


def run(mlp: Mlp, inputs: Floats) -> Floats:
    """(n, out) of (n, in), in the type of the inputs."""
    dtype = inputs.dtype
    with np.errstate(over="ignore", invalid="ignore"):
        hidden = np.maximum(inputs @ mlp.weights[0].astype(dtype).T + mlp.biases[0].astype(dtype), 0)
        return np.asarray(hidden @ mlp.weights[1].astype(dtype).T + mlp.biases[1].astype(dtype))


def sigmoid(x: Floats) -> Floats:
    """1 / (1 + e^-x), without overflow."""
    return np.asarray(0.5 * (1 + np.tanh(0.5 * x)))


def log_sigmoid(x: Floats) -> Floats:
    """ln(sigmoid(x)), exact also where the sigmoid itself underflows."""
    return np.asarray(-np.logaddexp(0, -x))


def unit_vectors(vectors: Floats) -> tuple[Floats, Floats, NDArray[np.int32]]:
    """Vectors as direction and length, in their own type, no square of which over- or underflows.

    Args:
        vectors: (n, k).

    Returns:
        (n, k) of length 1, or 0 where all numbers are; (n, 1) length l and (n, 1) e: the length is l * 2^e.
    """
    exponents = np.frexp(np.abs(vectors).max(axis=1, keepdims=True, initial=0))[1]
    scaled = np.ldexp(vectors, -exponents)
    lengths = np.linalg.norm(scaled, axis=1, keepdims=True)
    return scaled / np.where(lengths > 0, lengths, lengths.dtype.type(1)), lengths, exponents


def unit_quaternions(q: Floats) -> Floats:
    """(n, 4) of length 1; a zero quaternion becomes the identity."""
    with np.errstate(invalid="ignore"):  # what has overflowed has no length: not a reason to warn
        unit, length, _ = unit_vectors(q)
    return np.asarray(np.where(length > 0, unit, np.array([1, 0, 0, 0], q.dtype)))


def slot_centres(model: AnchorModel, anchors: I64, slots: I64) -> F64:
    """(n, 3) float64 centres: anchor + offset * exp(scaling[:3])."""
    reach = np.exp(model.log_scaling[anchors, :3].astype(np.float64))
    return np.asarray(model.anchors[anchors] + model.offsets[anchors, slots] * reach)


def _chunk(model: AnchorModel, rows: I64, eye: F64) -> tuple[NDArray[np.generic], ...]:
    inputs = outlook(model, rows, eye, np.float32)
    opacity = np.tanh(run(model.mlps["opacity"], inputs))
    shown = opacity > 0
    if model.slot_mask is not None:
        shown &= model.slot_mask[rows]
    some = np.flatnonzero(shown.any(axis=1))
    anchor, slot = np.nonzero(shown[some])
    inputs = inputs[some]
    covariance = run(model.mlps["cov"], inputs).reshape(len(some), model.slots, 7)[anchor, slot]
    colour = sigmoid(run(model.mlps["color"], inputs).reshape(len(some), model.slots, 3)[anchor, slot])
    rows = rows[some][anchor]
    scales = model.log_scaling[rows, 3:6].astype(np.float32) + log_sigmoid(covariance[:, :3])
    logits: NDArray[Any] = opacity_logits(np.log(opacity[some][anchor, slot].astype(np.float64))).astype(np.float32)
    centres = slot_centres(model, rows, slot)
    return centres, scales, unit_quaternions(covariance[:, 3:]), logits, colour, rows, slot
