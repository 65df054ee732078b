"""Changing the handedness and direction of coordinate axes of a whole scene.

A frame is named by where x, y and z point: RDF is right, down, forward (COLMAP, INRIA's PLY), RUB is right,
up, back (OpenGL, SPZ), LUF is left, up, forward (glTF).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scarfmt.arrays import F32
from scarfmt.container.registries import CoordinateFrame
from scarfmt.scene.gaussians import GaussianScene

Signs = tuple[int, int, int]

RUB_TO_RDF: Signs = (1, -1, -1)
LUF_TO_RDF: Signs = (-1, -1, 1)

# Which of x, y, z each basis function of degree 1, 2, 3 is odd in (INRIA's order): e.g. y(3x^2-y^2) is odd in y.
_ODD_IN = ("y", "z", "x", "xy", "yz", "", "xz", "", "y", "xyz", "y", "z", "x", "z", "x")


def signs_to(target: Signs, frame: CoordinateFrame) -> Signs:
    """Signs that take a scene of `frame`, unspecified being RDF, to the axes that `target` takes to RDF."""
    x, y, z = RUB_TO_RDF if frame == CoordinateFrame.RUB else (1, 1, 1)
    return x * target[0], y * target[1], z * target[2]


def flip_axes(scene: GaussianScene, signs: Signs) -> GaussianScene:
    """The scene as seen in axes of which some point the other way; exact, every flip is its own inverse.

    Args:
        signs: 1 to keep an axis, -1 to flip it.
    """
    x, y, z = signs
    # A covariance turns into F R S S' R' F; F R F is a rotation again, about the flipped axis.
    quaternion_signs = np.array([1, y * z, x * z, x * y], np.float32)
    return replace(
        scene,
        positions=scene.positions * np.array(signs, np.float64),
        rotations=scene.rotations * quaternion_signs,
        sh=scene.sh * _sh_signs(signs)[: scene.sh.shape[1], None],
        description=replace(scene.description, up_axis=flip_up(scene.description.up_axis, signs)),
    )


def flip_up(up_axis: str | None, signs: Signs) -> str | None:
    """An up axis, as :class:`~scarfmt.scene.description.Description` has it, where some axes point the other way."""
    if up_axis is None or signs["xyz".index(up_axis[-1])] > 0:
        return up_axis
    return up_axis[1:] if up_axis.startswith("-") else f"-{up_axis}"


def _sh_signs(signs: Signs) -> F32:
    by_axis = dict(zip("xyz", signs, strict=True))
    products = [np.prod([by_axis[axis] for axis in odd]) for odd in ("", *_ODD_IN)]
    return np.array(products, np.float32)
