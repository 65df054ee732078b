"""Baking: view-independent Gaussians fitted to an anchor model, for viewers that know only PLY. Lossy.

Over a set of eyes, the networks give every slot an opacity o_e (none where it is not drawn), a covariance and a
colour. What is kept per slot, with weights w_e = o_e / distance^2 (how much of the picture from e it may cover):

- opacity: the mean of the o_e, eyes that do not draw it counting as 0, weighted by 1 / distance^2;
- covariance: the mean weighted by w_e, split into axes and lengths;
- colour: spherical harmonics by least squares weighted by w_e, in the direction from the eye to the slot's
  centre. A ridge draws the bands above 0 towards none, since eyes seldom surround an anchor.

Slots whose opacity never reaches 1/255 are left out. Work goes in chunks of anchors. Each slot is fitted by itself, and
what is lost is nearly all lost by its opacity, which depends on the view: :mod:`reference_decoder.refine` fits all of
them together to pictures.

Networks know the views they were trained on, and elsewhere say anything. People photograph a subject from all round, a
little from below and more from above, and fill it with anchors more densely than what lies behind it. So without
cameras, the eyes are 1 to 3 median distances of the anchors from their median, and look about there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_decoder.anchors import gaussians, log_sigmoid, outlook, run, sigmoid, slot_centres, unit_quaternions
from reference_decoder.reconstruct import NETWORKS
from scarfmt.arrays import F64, I64
from scarfmt.coding.writer import Report, silent
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import NEAR, Camera, look_at, upward_axes
from scarfmt.render.viewpoints import even_numbers, upright
from scarfmt.scene.activation import opacity_logits
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.scene.placement import sh_basis
from scarfmt.scene.rotation import matrix_from_quaternion, quaternion_from_matrix

BAKE_CHUNK = 1 << 10
MIN_OPACITY = 1 / 255
"""Less is never drawn (3DGS, appendix C)."""
RIDGE = 0.001
"""Added to the normal matrix for the bands above 0, as a part of the sum of the weights."""


BAKE_STEPS = 256
DEFAULT_VIEWS = 64
_NEAREST, _FURTHEST = 1.0, 3.0
_LOWEST = -0.3
"""Sine of the elevation of the lowest eye."""
_AIM = 0.5
"""How far from the middle a view looks at most, median distances."""
_WIDTH, _HEIGHT, _FOV_DEG = 640, 480, 60.0
_NEAR_PART = 0.05
_SEED = 7


@dataclass(frozen=True)
class Baking:
    """How an anchor model becomes plain Gaussians.

    Attributes:
        views: cameras to fit for, best those the scene was captured from; without any,
            :func:`default_views`.
        steps: of refining, one picture each (:mod:`reference_decoder.refine`); with 0,
            each Gaussian is fitted by itself.
        sh_degree: of the fitted spherical harmonics, 0..3.
    """

    views: Sequence[Camera] = ()
    steps: int = BAKE_STEPS
    sh_degree: int = 2


def bake_model(model: AnchorModel, baking: Baking, report: Report = silent) -> tuple[GaussianScene, tuple[str, ...]]:
    """The Gaussians that anchors, one at least, are baked into, and comments that say how.

    Args:
        model: with all three networks.
        baking: how.
        report: called with (stage, fraction done) while Gaussians are refined.

    Raises:
        InvalidInput: ``input-mlp`` when a network is missing.
    """
    views = baking.views or default_views(model)
    scene = bake(model, np.array([view.centre for view in views]), baking.sh_degree)
    if baking.steps:
        from reference_decoder.refine import refine

        scene = refine(model, scene, views, baking.steps, report)
    fitted = f"{len(views)} eyes in {baking.steps} steps, spherical harmonics of degree {baking.sh_degree}"
    return scene, ("baked from a .scar anchor model; lossy, view dependence fitted", f"fitted over {fitted}")


def default_views(model: AnchorModel, count: int = DEFAULT_VIEWS) -> list[Camera]:
    """Cameras round a model, the same for the same model.

    Args:
        model: at least one anchor, and all three networks.
        count: of views of 640x480 pixels.

    Raises:
        InvalidInput: ``input-mlp`` when a network is missing.
    """
    middle = np.median(model.anchors, axis=0)
    radius = float(np.median(np.linalg.norm(model.anchors - middle, axis=1))) or 1.0
    axes = upward_axes(upright(gaussians(model, middle).scene).up)
    views = []
    for number, u in enumerate(even_numbers(count, 6, _SEED), 1):
        distance = radius * _NEAREST * (_FURTHEST / _NEAREST) ** float(u[0])
        height = _LOWEST + (1 - _LOWEST) * float(u[1])
        azimuth, level = 2 * math.pi * float(u[2]), math.sqrt(1 - height * height)
        towards = np.array([level * math.cos(azimuth), level * math.sin(azimuth), height]) @ axes
        target = middle + _AIM * radius * (2 * u[3:6] - 1)
        near = min(NEAR, _NEAR_PART * radius)
        eye = middle + distance * towards
        views.append(look_at(eye, target, axes[2], _WIDTH, _HEIGHT, _FOV_DEG, f"baking {number}", near))
    return views


def bake(model: AnchorModel, eyes: F64, sh_degree: int = 2) -> GaussianScene:
    """Fit view-independent Gaussians to an anchor model.

    Args:
        model: a decoded or imported model with all three networks.
        eyes: (E, 3) float64 camera centres, at least one; those the scene was captured from fit best.
        sh_degree: of the fitted spherical harmonics, 0..3.

    Returns:
        Slots ever drawn from an eye, in anchor then slot order.

    Raises:
        InvalidInput: ``input-mlp`` when a network is missing, ``input-eyes`` without eyes.
    """
    eyes = np.asarray(eyes, np.float64)
    if eyes.ndim != 2 or eyes.shape[1] != 3 or not len(eyes):
        raise InvalidInput("input-eyes", f"baking needs eyes of shape (E, 3), got {eyes.shape}", field="eyes")
    if not set(NETWORKS) <= set(model.mlps):
        raise InvalidInput("input-mlp", f"an anchor model needs the networks {', '.join(NETWORKS)}", field="mlps")
    parts = [
        _bake_chunk(model, np.arange(first, min(first + BAKE_CHUNK, len(model))), eyes, sh_degree)
        for first in range(0, max(len(model), 1), BAKE_CHUNK)
    ]
    fields = ("positions", "log_scales", "rotations", "opacity_logits", "sh")
    return GaussianScene(*(np.concatenate([getattr(part, name) for part in parts]) for name in fields))


def _bake_chunk(model: AnchorModel, rows: I64, eyes: F64, sh_degree: int) -> GaussianScene:
    inputs = [outlook(model, rows, eye, np.float32) for eye in eyes]
    opacity = np.stack([np.tanh(run(model.mlps["opacity"], x)) for x in inputs]).astype(np.float64)
    opacity = np.maximum(opacity, 0.0)
    if model.slot_mask is not None:
        opacity *= model.slot_mask[rows]
    anchor, slot = np.nonzero(opacity.max(axis=0) >= MIN_OPACITY)
    centres = slot_centres(model, rows[anchor], slot)
    covariances, colours = _seen(model, rows, inputs, anchor, slot)
    opacity = opacity[:, anchor, slot]
    towards = centres - eyes[:, None, :]
    square = np.maximum((towards * towards).sum(axis=2), 1e-300)
    near = square.min(axis=0, initial=np.inf) / square
    weights = opacity * near
    fitted = weights.sum(axis=0) / near.sum(axis=0)
    scales, rotations = _mean_shape(covariances, weights)
    sh = _fit_colour(towards / np.sqrt(square)[:, :, None], colours, weights, sh_degree)
    logits = opacity_logits(np.log(fitted))
    single = np.float32
    return GaussianScene(
        centres, scales.astype(single), rotations.astype(single), logits.astype(single), sh.astype(single)
    )


def _seen(model: AnchorModel, rows: I64, inputs: list[NDArray[np.floating]], anchor: I64, slot: I64) -> tuple[F64, F64]:
    """(E, m, 3, 3) covariances and (E, m, 3) colours of the slots of a chunk from all eyes."""
    covariances, colours = [], []
    for x in inputs:
        shape = run(model.mlps["cov"], x).reshape(len(rows), model.slots, 7)[anchor, slot].astype(np.float64)
        colours.append(sigmoid(run(model.mlps["color"], x).reshape(len(rows), model.slots, 3)[anchor, slot]))
        lengths = np.exp(model.log_scaling[rows[anchor], 3:6] + log_sigmoid(shape[:, :3]))
        axes = matrix_from_quaternion(unit_quaternions(shape[:, 3:])) * lengths[:, None, :]
        covariances.append(axes @ axes.transpose(0, 2, 1))
    return np.stack(covariances), np.stack(colours).astype(np.float64)


def _mean_shape(covariances: F64, weights: F64) -> tuple[F64, F64]:
    """(m, 3) log scales and (m, 4) quaternions of the weighted mean of (E, m, 3, 3) covariances."""
    mean = np.einsum("em,emij->mij", weights / weights.sum(axis=0), covariances)
    squares, axes = np.linalg.eigh(mean)
    # eigh may give a reflection; turning one axis round leaves the ellipsoid as it is.
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
    smallest = squares[:, 2:] * 1e-14 + 1e-300
    return 0.5 * np.log(np.maximum(squares, smallest)), quaternion_from_matrix(axes)


def _fit_colour(directions: F64, colours: F64, weights: F64, degree: int) -> F64:
    """(m, (degree + 1)^2, 3) coefficients of the weighted ridge fit to colours - 0.5, all (E, m, 3)."""
    basis = sh_basis(directions, degree)
    weighted = basis * (weights / weights.sum(axis=0))[:, :, None]
    normal = np.einsum("emb,emc->mbc", weighted, basis, optimize=True)
    bands = np.arange(1, basis.shape[2])
    normal[:, bands, bands] += RIDGE
    right = np.einsum("emb,emc->mbc", weighted, colours - 0.5, optimize=True)
    return np.linalg.solve(normal, right)
