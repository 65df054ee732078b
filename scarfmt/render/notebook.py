"""The picture of a scene that a notebook shows."""

from __future__ import annotations

import io

from PIL import Image

from scarfmt.render.camera import orbit_cameras
from scarfmt.render.images import to_bytes
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene

_SIZE = (480, 360)


def picture(scene: GaussianScene) -> bytes | None:
    """A PNG of the scene from outside; None of an empty one."""
    if not len(scene):
        return None
    (camera,) = orbit_cameras(scene, 1, *_SIZE)
    stream = io.BytesIO()
    Image.fromarray(to_bytes(render(scene, camera))).save(stream, format="PNG")
    return stream.getvalue()
