"""The up direction of a scene that does not state it, found from its Gaussians.

Most scenes are upright along -y, as capture software leaves them, so another axis needs strong evidence: floors, tables
and paving are large flat Gaussians that all face up, the core is wide and low, and what is flat lies below its middle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import F64
from scarfmt.render.camera import AUTO
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.rotation import matrix_from_quaternion

USUAL = "-y"
_SAMPLE = 50_000
_Y = 1
_FLAT = 0.3
"""Maximum of the shortest axis, as a share of the middle axis, of a Gaussian that has a face."""
_FACING = 0.9
"""Cosine between the normal of a face and the axis it counts for."""
_CLEARLY, _HARDLY = 6.0, 1.5
"""How many times more faces a level axis has than either other axis."""
_LOW, _LOWER = 0.8, 0.35
"""Height of a core that lies level, of its lesser width."""
_UPSIDE_DOWN, _DOUBTFUL = 0.5, 0.25
"""How far below the middle what shows and what lies level are, together, in heights of the core."""


@dataclass(frozen=True)
class Upright:
    """The up direction of a scene.

    Attributes:
        up: a frame (:class:`Arc`).
        other: the next best guess where it is doubtful, else None.
        given: whether somebody said so.
    """

    up: str
    other: str | None = None
    given: bool = False


def resolved(scene: GaussianScene, frame: str) -> Upright:
    """The up direction that `frame` names; for :data:`AUTO`, the one found in the scene."""
    return upright(scene) if frame == AUTO else Upright(frame, given=True)


def upright(scene: GaussianScene) -> Upright:
    """The probable up direction of a scene."""
    faces = _Faces.of(scene)
    if faces is None:
        return Upright(USUAL)
    level = int(faces.share.argmax())
    if level != _Y:
        found = ("" if faces.weight[level] < 0 else "-") + "xyz"[level]
        more = faces.share[level] / max(np.delete(faces.share, level).max(), 1e-300)
        low = faces.extent[level] / max(np.delete(faces.extent, level).min(), 1e-300)
        if more > _CLEARLY and low < _LOW:
            return Upright(found)
        if more > _HARDLY and low < _LOWER:
            return Upright(found, USUAL)
    # Along +y lies what is below, if -y is up.
    if -faces.weight[_Y] > _UPSIDE_DOWN:
        return Upright("y", USUAL)
    return Upright(USUAL, "y" if -faces.weight[_Y] > _DOUBTFUL else None)


@dataclass(frozen=True)
class _Faces:
    """The evidence for an axis; each array is (3,) float64.

    Attributes:
        share: of the area that shows, what faces along it.
        extent: of the core.
        weight: how far from the middle of the core, towards its positive end, what faces along it and all that shows
            are, together; in extents.
    """

    share: F64
    extent: F64
    weight: F64

    @staticmethod
    def of(scene: GaussianScene) -> _Faces | None:
        """The evidence of a sample of the Gaussians around the core; None if none of them is visible."""
        part = scene.take(np.arange(0, len(scene), max(1, -(-len(scene) // _SAMPLE))))
        part = part.take(np.flatnonzero(np.isfinite(part.positions).all(axis=1)))
        if not len(part):
            return None
        low, middle, high = np.percentile(part.positions, [10, 50, 90], axis=0)
        extent = np.maximum(high - low, 1e-300)
        part = part.take(np.flatnonzero((np.abs(part.positions - middle) <= extent + (high - low) / 2).all(axis=1)))
        scales = np.sort(part.log_scales.astype(np.float64), axis=1)
        area = np.exp(scales[:, 1] + scales[:, 2]) / (1 + np.exp(-part.opacity_logits.astype(np.float64)))
        area = np.minimum(area, np.percentile(area, 99)) if len(area) else area
        if not area.sum() > 0:
            return None
        shortest = part.log_scales.argmin(axis=1)
        normals = matrix_from_quaternion(part.rotations)[np.arange(len(part)), :, shortest]
        flat = scales[:, 0] - scales[:, 1] < np.log(_FLAT)
        faces = (area * flat)[:, None] * (np.abs(normals) > _FACING)
        place = (part.positions - middle) / extent
        share = faces.sum(axis=0)
        level = (faces * place).sum(axis=0) / np.maximum(share, 1e-300)
        centre = (low + high) / 2
        shown = area @ ((part.positions - centre) / extent) / area.sum()
        return _Faces(share / area.sum(), extent, level + shown)
