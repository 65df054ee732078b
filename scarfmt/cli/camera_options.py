"""Options that give one camera: --camera, --target, --up, --fov and --size."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from scarfmt.cli.options import with_options
from scarfmt.cli.views import DEFAULT_SIZE, parse_size

if TYPE_CHECKING:
    from scarfmt.arrays import F64
    from scarfmt.blocks.streaming import View
    from scarfmt.view_planning import Camera

_FIELD_DEG = 60.0
_AWAY = 1.2
"""Distance of the eye from a scene whose file names no first view, in diagonals of its boxes."""


def parse_point(value: str) -> tuple[float, ...]:
    """Three numbers with commas between them.

    Raises:
        click.BadParameter: the text has another shape.
    """
    try:
        x, y, z = map(float, value.split(","))
    except ValueError as error:
        raise click.BadParameter(f"{value!r} is not X,Y,Z") from error
    return x, y, z


camera_options = with_options(
    click.option("--camera", type=parse_point, metavar="X,Y,Z", help="Point to look from [default: the file's view]."),
    click.option("--target", type=parse_point, metavar="X,Y,Z", help="Point to look at [default: the file's view]."),
    click.option("--up", type=parse_point, metavar="X,Y,Z", help="Direction that is up [default: the file's]."),
    click.option(
        "--fov", type=click.FloatRange(1, 170), metavar="DEGREES", help="Vertical field of view [default: file's]."
    ),
    click.option("--size", type=parse_size, metavar="WxH", help="Pixels of a picture [default: 640x480]."),
)


def camera_of(values: Mapping[str, Any], boxes: tuple[F64, F64], view: View | None) -> Camera:
    """The requested camera. What the user leaves out comes from the file's view, else from a view of the whole scene.

    Args:
        values: those of `camera_options`.
        boxes: lowest and highest corners (n, 3) of what there is.
        view: the first view that the file names, or None.

    Raises:
        click.UsageError: the direction of the view is zero, or parallel to up.
    """
    import numpy as np

    from scarfmt.view_planning import Camera

    low, high = boxes[0].min(axis=0, initial=np.inf), boxes[1].max(axis=0, initial=-np.inf)
    middle = (low + high) / 2 if len(boxes[0]) else np.zeros(3)
    away = _AWAY * float(np.linalg.norm(high - low)) if len(boxes[0]) else 1.0
    up = np.array(values["up"] or (view.up if view else (0.0, -1.0, 0.0)))
    target = np.array(values["target"] or (view.target if view else middle))
    position = np.array(values["camera"] or (view.position if view else middle - away * np.array([0.0, 0.0, 1.0])))
    field = math.radians(values["fov"]) if values["fov"] else view.fov if view else math.radians(_FIELD_DEG)
    if not np.linalg.norm(np.cross(target - position, up)) > 0:
        raise click.UsageError("--camera, --target and --up give no view: its direction is zero, or parallel to --up")
    width, height = values["size"] or DEFAULT_SIZE
    return Camera(position, target - position, up, field, width, height)
