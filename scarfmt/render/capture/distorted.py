"""A photo of a lens that is no pinhole, as undistortion needs it."""

from __future__ import annotations

from dataclasses import dataclass

from scarfmt.arrays import F64


@dataclass(frozen=True)
class Distorted:
    """A view through a lens of COLMAP's models.

    Attributes:
        model: its name, e.g. ``"OPENCV"``.
        parameters: in COLMAP's order.
        width, height: of the photo, pixels.
        world_to_camera: (4, 4) float64, OpenCV axes.
        name: of the photo.
        split: ``"train"``, ``"test"`` or empty.
    """

    model: str
    parameters: tuple[float, ...]
    width: int
    height: int
    world_to_camera: F64
    name: str
    split: str = ""
