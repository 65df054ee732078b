"""The options of commands that draw: from where a scene is looked at."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from scarfmt.render.camera import Camera
    from scarfmt.scene.gaussians import GaussianScene

Command = TypeVar("Command", bound=Callable[..., Any])

DEFAULT_VIEWS = 8
DEFAULT_SIZE = (640, 480)
FRAME_HELP = (
    "Up axis (x, -x, y, -y, z or -z), optionally with the arc of viewing directions in degrees: UP[:CENTRE:SPAN], "
    "e.g. -y:125:70."
)
SIZE_HELP = "Pixels of each picture [default: 640x480, or the cameras' own]."


def parse_size(_ctx: click.Context, _parameter: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """(width, height) of `WIDTHxHEIGHT`, pixels.

    Raises:
        click.BadParameter: the text has another shape.
    """
    if value is None:
        return None
    match = re.fullmatch(r"([1-9]\d{0,3})[xX×]([1-9]\d{0,3})", value)
    if match is None:
        raise click.BadParameter(f"{value!r} is not WIDTHxHEIGHT in pixels, up to 9999 each, e.g. 640x480")
    return int(match[1]), int(match[2])


@dataclass(frozen=True)
class ViewOptions:
    """What the user said about the views; None where nothing.

    Attributes:
        views: number of views.
        frame: ``"UP"`` or ``"UP:CENTRE_DEG:SPAN_DEG"`` of an orbit.
        cameras: path of a camera list that replaces the orbit.
        size: (width, height) of the pictures, pixels.
    """

    views: int | None
    frame: str
    cameras: str | None
    size: tuple[int, int] | None


def view_options(command: Command) -> Command:
    """Add --views, --frame, --cameras and --size to a command."""
    cameras = click.Path(exists=True, dir_okay=False)
    for option in (
        click.option("--size", metavar="WxH", callback=parse_size, help=SIZE_HELP),
        click.option("--cameras", type=cameras, help="JSON list of cameras to look from, instead of an orbit."),
        click.option("--frame", default="-y", show_default=True, help=FRAME_HELP),
        click.option("--views", type=click.IntRange(1, 10000), help="Number of views [default: 8, or all cameras]."),
    ):
        command = option(command)
    return command


def choose_cameras(scene: GaussianScene, options: ViewOptions) -> list[Camera]:
    """The cameras to look from: an orbit round the scene, or those of a list (its test cameras, if it marks any).

    Args:
        scene: only its positions are used.
        options: what the user said.

    Raises:
        InvalidInput: ``input-frame``, ``input-cameras`` or ``input-empty``.
    """
    from scarfmt.render.camera import orbit_cameras

    if options.cameras is not None:
        return _listed_cameras(options.cameras, options)
    width, height = options.size or DEFAULT_SIZE
    return orbit_cameras(scene, options.views or DEFAULT_VIEWS, width, height, options.frame)


def _listed_cameras(path: str, options: ViewOptions) -> list[Camera]:
    from scarfmt.errors import InvalidInput
    from scarfmt.render.capture import load_cameras

    cameras = load_cameras(path)
    cameras = [camera for camera in cameras if camera.split == "test"] or cameras
    if not cameras:
        raise InvalidInput("input-cameras", f"{path} lists no cameras", field="images")
    if options.views is not None and options.views < len(cameras):
        cameras = [cameras[i * len(cameras) // options.views] for i in range(options.views)]
    if options.size is not None:
        cameras = [camera.scaled(options.size[0] / camera.width) for camera in cameras]
    return cameras
