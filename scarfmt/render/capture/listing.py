"""Camera lists in JSON: this project's, and INRIA's `cameras.json`.

This project's is ``{"images": [{name, W, H, fx, fy, cx, cy, world_to_camera, split}]}`` with OpenCV axes; `name` and
`split` are optional. INRIA's trainer writes, beside a scene, ``[{id, img_name, width, height, position, rotation, fx,
fy}]``: where the eye is, and the rows of the rotation from camera to world. It names no principal point, which is the
middle, and does not tell test from training cameras.
"""

from __future__ import annotations

import numpy as np

from scarfmt.render.camera import Camera
from scarfmt.render.capture.record import Record, inverted


def own_camera(record: Record) -> Camera:
    """A camera of this project's list.

    Raises:
        InvalidInput: ``input-cameras``.
    """
    split = record.text("split")
    if split not in ("", "train", "test"):
        raise record.fault("split", f'split is {split[:40]!r}: "train", "test" and "" are known')
    size = record.pixels("W"), record.pixels("H")
    focal = record.positive("fx"), record.positive("fy")
    centre = record.number("cx"), record.number("cy")
    pose = record.affine("world_to_camera")
    return record.camera("world_to_camera", pose, size, focal, centre, record.text("name"), split)


def inria_camera(record: Record) -> Camera:
    """A camera of INRIA's list.

    Raises:
        InvalidInput: ``input-cameras``.
    """
    width, height = record.pixels("width"), record.pixels("height")
    focal = record.positive("fx"), record.positive("fy")
    camera_to_world = np.eye(4)
    camera_to_world[:3, :3] = record.numbers("rotation", 3, 3)
    camera_to_world[:3, 3] = record.numbers("position", 3)
    centre = width / 2, height / 2
    pose = inverted(camera_to_world)
    return record.camera("rotation", pose, (width, height), focal, centre, record.text("img_name"))
