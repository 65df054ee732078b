"""Activated values by name, as a decoder hands them out: the stage ``activated`` of conformance/PROTOCOL.md."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_decoder.anchors import log_sigmoid, outlook, run, sigmoid, slot_centres, unit_quaternions
from reference_decoder.decoded import Decoded
from scarfmt.arrays import F64
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

Arrays = dict[str, NDArray[Any]]


def activated_arrays(decoded: Decoded, dtype: type, camera: Sequence[float] | None = None) -> Arrays:
    """The values of SPEC §9.3 to §9.6.

    Args:
        decoded: with all attributes.
        dtype: float32, what a decode gives; float64, the reference of the tolerances, and free of overflow
            where only float32 is too narrow.
        camera: centre of the camera, world units, for Gaussians of the anchor profile; None: `origin` of the header.
    """
    scene = decoded.activated(dtype)
    if isinstance(scene, GaussianScene):
        return _gaussians(scene)
    return {"feature": scene.features, **_slots(scene, np.array(camera or decoded.fields.origin), dtype)}


def _gaussians(scene: GaussianScene) -> Arrays:
    logits = scene.opacity_logits
    return {"rotation": scene.rotations, "logit": logits, "opacity": sigmoid(logits), "sh": scene.sh}


def _slots(model: AnchorModel, camera_centre: F64, dtype: type) -> Arrays:
    """Every slot of every anchor, on or off, for a camera (SPEC §9.6)."""
    count, slots = len(model), model.slots
    anchors, numbers = np.divmod(np.arange(count * slots), slots)
    with np.errstate(all="ignore"):  # what overflows is an infinity, or not a number: not a reason to warn
        inputs = outlook(model, np.arange(count), camera_centre, dtype)
        covariance = run(model.mlps["cov"], inputs).reshape(count, slots, 7)
        log_scales = model.log_scaling[:, None, 3:6].astype(dtype) + log_sigmoid(covariance[:, :, :3])
        return {
            "gaussian.opacity": np.tanh(run(model.mlps["opacity"], inputs)),
            "gaussian.scale": np.exp(log_scales),
            "gaussian.rotation": unit_quaternions(covariance[:, :, 3:].reshape(-1, 4)).reshape(count, slots, 4),
            "gaussian.colour": sigmoid(run(model.mlps["color"], inputs)).reshape(count, slots, 3),
            "gaussian.centre": slot_centres(model, anchors, numbers).reshape(count, slots, 3),
        }
