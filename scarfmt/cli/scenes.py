"""Scene files of any kind, made ready for drawing."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from scarfmt.cli.files import STANDARD, open_input, read_origin
from scarfmt.cli.progress import Tell
from scarfmt.container.header import is_scar
from scarfmt.container.registries import ColourSpace
from scarfmt.errors import InputWarning
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

if TYPE_CHECKING:
    from scarfmt.arrays import F32, F64
    from scarfmt.render.camera import Camera

    View = GaussianScene | Callable[[Camera], F32]

SceneOrigin = str | bytes


@dataclass(frozen=True)
class Subject:
    """A scene to look at.

    Attributes:
        view: explicit Gaussians, or a function from camera to picture.
        placed: Gaussians whose positions and description place the cameras; their other attributes are not used.
    """

    view: View
    placed: GaussianScene

    def picture(self, camera: Camera) -> F32:
        """The (height, width, 3) picture from `camera`."""
        from scarfmt.render.rasterise import render

        return render(self.view, camera) if isinstance(self.view, GaussianScene) else self.view(camera)

    def beside(self, other: Subject) -> Subject:
        """The subject in the coordinates of another, where their files say which origins were subtracted."""
        apart = np.subtract(self.placed.description.origin, other.placed.description.origin)
        if not apart.any() or not isinstance(self.view, GaussianScene):
            return self
        return _subject(replace(self.view, positions=self.view.positions + apart))

    def remembering(self) -> Subject:
        """A subject that draws each view only once."""
        seen: dict[bytes, F32] = {}

        def picture(camera: Camera) -> F32:
            key = camera.world_to_camera.tobytes() + repr((camera.width, camera.height, camera.fx)).encode()
            if key not in seen:
                seen[key] = self.picture(camera)
            return seen[key]

        return replace(self, view=picture)

    def reporting(self, report: Tell, count: int) -> Subject:
        """A subject that also reports to `report` which of `count` pictures it draws."""
        drawn = 0

        def picture(camera: Camera) -> F32:
            nonlocal drawn
            report("draw", drawn / count)
            drawn += 1
            return self.picture(camera)

        return replace(self, view=picture)


def scene_origin(name: str) -> SceneOrigin:
    """A path or URL as it is, or the bytes of a pipe, which can be read only once.

    Raises:
        click.UsageError: `-`.
        ScarError: a pipe that cannot be read.
    """
    if name == STANDARD:
        raise click.UsageError("this command reads its scenes from files, not from standard input")
    return read_origin(name)


def layer_table(origin: SceneOrigin) -> list[dict[str, Any]]:
    """The layers of a .scar file that have arrived whole, as :func:`scarfmt.tools.inspection.inspect` reports them.

    Each also has `bytes_per_source`: bytes up to and with that layer per Gaussian (or anchor) of the encoder's input.

    Raises:
        click.UsageError: another kind of file.
        ScarError: the file is refused.
    """
    from scarfmt.tools import inspection

    if not is_scar(origin):
        raise _no_layers(origin)
    with open_input(origin) as source:
        report = inspection.inspect(source)
    count = report["source_count"] or report["anchors"] or 1
    rows = report["layers"][: report["layers_available"]]
    return [{**row, "bytes_per_source": row["end_offset"] / count} for row in rows]


def _no_layers(origin: SceneOrigin) -> click.UsageError:
    return click.UsageError(f"{_describe_origin(origin)} is not a .scar file: it has no layers")


def _describe_origin(origin: SceneOrigin) -> str:
    return "a pipe" if isinstance(origin, bytes) else origin


def load_subject(origin: SceneOrigin, layers: int | None = None) -> Subject:
    """A scene file, ready to be drawn.

    Args:
        origin: of :func:`scene_origin`: any scene file, or the URL of a .scar file.
        layers: layers of a .scar file to use; None for all that have arrived.

    Raises:
        click.UsageError: `layers` for another kind of file.
        ScarError: the file is refused.

    Warns:
        InputWarning: its colours are linear light.
    """
    subject = _subject(_load(origin, layers))
    if subject.placed.description.colour_space == ColourSpace.LINEAR:
        message = f"{_describe_origin(origin)}: its colours are linear light, and drawn as if they were sRGB: too dark"
        warnings.warn(message, InputWarning, stacklevel=2)
    return subject


def _load(origin: SceneOrigin, layers: int | None) -> GaussianScene | AnchorModel:
    if is_scar(origin):
        return _decode(origin, layers)
    if layers is not None:
        raise _no_layers(origin)
    from scarfmt.formats import load
    from scarfmt.formats.clean import clean

    return clean(load(origin), drop_invalid=True)[0]


def _decode(origin: SceneOrigin, layers: int | None) -> GaussianScene | AnchorModel:
    from reference_decoder.decode import decode
    from scarfmt.blocks.metadata import describe
    from scarfmt.container.file import Container

    with open_input(origin) as source:
        file = Container(source, allow_truncated=True)
        whole, promised = file.available_layers, len(file.header.layers)
        if layers is None and 0 < whole < promised:
            message = f"{_describe_origin(origin)} is cut short: {whole} of its {promised} layers are used"
            warnings.warn(message, InputWarning, stacklevel=2)
        scene = decode(source, layers=layers, allow_truncated=True).scene
        return scene if isinstance(scene, AnchorModel) else replace(scene, description=describe(file))


def _subject(scene: GaussianScene | AnchorModel) -> Subject:
    if isinstance(scene, GaussianScene):
        return Subject(scene, scene)
    return Subject(_anchor_view(scene), _make_points(scene.anchors))


def _make_points(positions: F64) -> GaussianScene:
    count = len(positions)
    zeros = np.zeros((count, 4), np.float32)
    return GaussianScene(positions, zeros[:, :3], zeros, zeros[:, 0], np.zeros((count, 1, 3), np.float32))


def _anchor_view(model: AnchorModel) -> Callable[[Camera], F32]:
    from reference_decoder.anchors import gaussians
    from scarfmt.render.rasterise import render

    def picture(camera: Camera) -> F32:
        seen = gaussians(model, camera.centre)
        return render(seen.scene, camera, colours=seen.colours)

    return picture
