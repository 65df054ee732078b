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
RING = "survey"
KINDS = ("orbit", "near", "inside")
EVERYWHERE = "all"
LISTED = "cameras"
SEED = 1_000_003
"""Of the views of `KINDS`: the encoder looks from those of other seeds."""
FRAME_HELP = (
    "Up axis (x, -x, y, -y, z or -z), optionally with the arc of viewing directions in degrees: UP[:CENTRE:SPAN], "
    "e.g. -y:125:70."
)
SIZE_HELP = "Pixels of each picture [default: 640x480, or the cameras' own]."
CAMERAS_HELP = (
    "a JSON list of ours, INRIA's cameras.json, a transforms.json (Nerfstudio, Blender), or a folder of COLMAP"
)
FROM_HELP = (
    "Where eyes are: orbit (all round, at many distances), near, inside (looking outwards), all of these, or survey (a"
    " level ring)"
)


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


def parse_frame(_ctx: click.Context, _parameter: click.Parameter, value: str) -> str:
    """The text as it is: what cannot be read is told before any scene is.

    Raises:
        InvalidInput: ``input-frame``.
    """
    from scarfmt.render.camera import Arc

    Arc.parse(value)
    return value


@dataclass(frozen=True)
class ViewOptions:
    """What the user said about the views; None where nothing.

    Attributes:
        views: number of views, of each kind.
        frame: ``"UP"`` or ``"UP:CENTRE_DEG:SPAN_DEG"``.
        cameras: path of cameras to look from instead.
        size: (width, height) of the pictures, pixels.
        kind: one of `KINDS`, `RING` or `EVERYWHERE`.
    """

    views: int | None
    frame: str
    cameras: str | None
    size: tuple[int, int] | None
    kind: str | None = None


def view_options(default_kind: str) -> Callable[[Command], Command]:
    """A decorator that adds --views, --frame, --from, --cameras and --size to a command."""
    kinds = click.Choice((RING, *KINDS, EVERYWHERE))
    number = f"Number of views, of each kind [default: {DEFAULT_VIEWS}, or all cameras]."
    options = (
        click.option("--size", metavar="WxH", callback=parse_size, help=SIZE_HELP),
        click.option("--cameras", type=click.Path(exists=True), help=f"Look from these cameras: {CAMERAS_HELP}."),
        click.option("--from", "kind", type=kinds, help=f"{FROM_HELP} [default: {default_kind}]."),
        click.option("--frame", default="-y", show_default=True, callback=parse_frame, help=FRAME_HELP),
        click.option("--views", type=click.IntRange(1, 10000), help=number),
    )

    def decorate(command: Command) -> Command:
        for option in options:
            command = option(command)
        return command

    return decorate


def listed_cameras(options: ViewOptions) -> list[Camera] | None:
    """The cameras of --cameras, those held out for tests if it marks any; None without the option.

    To be called before any scene is read: reading cameras takes no time.

    Raises:
        click.UsageError: cameras and a kind of views.
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
        cameras = [camera.scaled(options.size[0] / camera.width) for camera in cameras]
    return cameras


def views_of(scene: GaussianScene, options: ViewOptions, default_kind: str) -> dict[str, list[Camera]]:
    """From where to look at a scene, by kind: the same for the same positions and options.

    Args:
        scene: only its positions are used.
        options: what the user said.
        default_kind: for who said none.

    Raises:
        InvalidInput: ``input-empty``.
    """
    from scarfmt.render.camera import orbit_cameras
    from scarfmt.render.viewpoints import Surroundings, viewpoints

    width, height = options.size or DEFAULT_SIZE
    count, kind = options.views or DEFAULT_VIEWS, options.kind or default_kind
    if kind == RING:
        return {RING: orbit_cameras(scene, count, width, height, options.frame)}
    around = Surroundings.of(scene, options.frame)
    kinds = KINDS if kind == EVERYWHERE else (kind,)
    return {kind: [view.sized(width, height) for view in viewpoints(around, kind, count, SEED)] for kind in kinds}
