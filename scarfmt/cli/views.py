"""Options of commands that draw: the places from which a scene is seen."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from scarfmt.cli.options import Decorator, with_options

if TYPE_CHECKING:
    from scarfmt.render.camera import Camera
    from scarfmt.scene.gaussians import GaussianScene

DEFAULT_VIEWS = 8
DEFAULT_SIZE = (640, 480)
RING = "survey"
KINDS = ("orbit", "near", "inside")
EVERYWHERE = "all"
LISTED = "cameras"
SEED = 1_000_003
"""Seed of the views of `KINDS`. The encoder uses views of other seeds."""
FRAME_HELP = (
    "Up axis (x, -x, y, -y, z or -z), optionally with the arc of viewing directions in degrees: UP[:CENTRE:SPAN], "
    "e.g. -y:125:70."
)
SIZE_HELP = "Size of each picture in pixels [default: 640x480, or the cameras' own]."
CAMERAS_HELP = "a cameras.json of this project or INRIA's, a transforms.json (Nerfstudio, Blender), or a COLMAP folder"
FROM_HELP = (
    "Where the views are: orbit (all round, at many distances), near, inside (looking outwards), all of these three,"
    " or survey (a level ring)"
)


def parse_size(value: str) -> tuple[int, int]:
    """(width, height) of `WIDTHxHEIGHT`, pixels.

    Raises:
        click.BadParameter: the text has another shape.
    """
    match = re.fullmatch(r"([1-9]\d{0,3})[xX×]([1-9]\d{0,3})", value)
    if match is None:
        raise click.BadParameter(f"{value!r} is not WIDTHxHEIGHT in pixels, up to 9999 each, e.g. 640x480")
    return int(match[1]), int(match[2])


def parse_frame(_ctx: click.Context, _parameter: click.Parameter, value: str | None) -> str | None:
    """The text as it is. A frame that cannot be read is refused before any scene is read.

    Raises:
        InvalidInput: ``input-frame``.
    """
    from scarfmt.render.camera import Arc

    if value is not None:
        Arc.parse(value)
    return value


@dataclass(frozen=True)
class ViewOptions:
    """The user's choice of views; None for each option that was not given.

    Attributes:
        views: number of views, of each kind.
        frame: ``"UP"`` or ``"UP:CENTRE_DEG:SPAN_DEG"``.
        cameras: path of cameras to look from instead.
        size: (width, height) of the pictures, pixels.
        kind: one of `KINDS`, `RING` or `EVERYWHERE`.
    """

    views: int | None
    frame: str | None
    cameras: str | None
    size: tuple[int, int] | None
    kind: str | None = None


def view_options(default_kind: str) -> Decorator[Any]:
    """A decorator that adds --views, --frame, --from, --cameras and --size to a command."""
    kinds = click.Choice((RING, *KINDS, EVERYWHERE))
    number = f"Number of views of each kind [default: {DEFAULT_VIEWS}, or all cameras]."
    return with_options(
        click.option("--views", type=click.IntRange(1, 10000), help=number),
        click.option("--frame", callback=parse_frame, help=f"{FRAME_HELP} [default: what the file says, or -y]"),
        click.option("--from", "kind", type=kinds, help=f"{FROM_HELP} [default: {default_kind}]."),
        click.option("--cameras", type=click.Path(exists=True), help=f"Look from these cameras: {CAMERAS_HELP}."),
        click.option("--size", metavar="WxH", type=parse_size, help=SIZE_HELP),
    )


def list_cameras(options: ViewOptions) -> list[Camera] | None:
    """The cameras of --cameras; None without the option. If some are marked as held out for tests, only those.

    Call this before any scene is read: it is quick, and refuses bad cameras early.

    Raises:
        click.UsageError: both --cameras and --from are given.
        InvalidInput: ``input-cameras``.
    """
    if options.cameras is None:
        return None
    if options.kind is not None:
        raise click.UsageError("--cameras and --from exclude each other")
    from scarfmt.render.capture import held_out, load_cameras

    cameras = held_out(load_cameras(options.cameras))
    if options.views is not None and options.views < len(cameras):
        cameras = [cameras[i * len(cameras) // options.views] for i in range(options.views)]
    if options.size is not None:
        cameras = [camera.scale(options.size[0] / camera.width) for camera in cameras]
    return cameras


def views_of(scene: GaussianScene, options: ViewOptions, default_kind: str) -> dict[str, list[Camera]]:
    """The cameras that look at a scene, by kind. Equal positions and options give equal cameras.

    Args:
        scene: only its positions and description are used.
        default_kind: kind of views if the user chose none.

    Raises:
        InvalidInput: ``input-empty``.
    """
    from scarfmt.render.camera import orbit_cameras
    from scarfmt.render.viewpoints import Surroundings, viewpoints

    width, height = options.size or DEFAULT_SIZE
    count, kind = options.views or DEFAULT_VIEWS, options.kind or default_kind
    frame = options.frame or scene.description.up_axis or "-y"
    if kind == RING:
        return {RING: orbit_cameras(scene, count, width, height, frame)}
    around = Surroundings.of(scene, frame)
    kinds = KINDS if kind == EVERYWHERE else (kind,)
    return {kind: [view.resize(width, height) for view in viewpoints(around, kind, count, SEED)] for kind in kinds}
