"""`scarfmt render`: pictures of a scene."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scarfmt.cli.failures import requires_extra, warnings_on_stderr
from scarfmt.cli.files import timeout_option
from scarfmt.cli.progress import Tell, progress
from scarfmt.cli.report import Report, reports
from scarfmt.cli.views import RING, ViewOptions, list_cameras, view_options, views_of
from scarfmt.errors import plural

if TYPE_CHECKING:
    from scarfmt.arrays import F32
    from scarfmt.cli.scenes import SceneOrigin, Subject
    from scarfmt.render.camera import Camera

    Pictures = dict[str, list[tuple[str, F32]]]

ALL = "all"
SHEET = "sheet.png"
OTHER_PICTURES = (".jpg", ".jpeg", ".webp", ".avif", ".gif", ".bmp", ".tif", ".tiff", ".exr")


def parse_layers(_ctx: click.Context, _parameter: click.Parameter, value: str | None) -> str | None:
    """`all`, or the digits of a number of layers.

    Raises:
        click.BadParameter: neither.
    """
    if value in (None, ALL) or (value.isdecimal() and int(value) >= 1):
        return value
    raise click.BadParameter(f"{value!r} is neither a number of layers nor {ALL!r}")


@click.command()
@click.argument("file")
@click.argument("output")
@view_options(RING)
@click.option("--like", metavar="FILE", help="Place the cameras by this scene, so that two files show the same views.")
@click.option("--layers", metavar="N|all", callback=parse_layers,
              help="Number of layers of a .scar file to draw. all: one picture for each number of layers.")  # fmt: skip
@click.option("--sheet", is_flag=True, help=f"Also write one sheet of all pictures, {SHEET}.")
@click.option("--force", is_flag=True, help="Overwrite pictures that exist.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@timeout_option
@reports
@requires_extra("render")
def render(
    file: str,
    output: str,
    layers: str | None,
    like: str | None,
    sheet: bool,
    force: bool,
    quiet: bool,
    **views: Any,
) -> Report:
    """Draw the scene FILE (.scar, PLY, SPZ, SOG, .splat or anchor model) into PNG pictures.

    OUTPUT is a folder or a name that ends in .png. A folder gets one picture for each view. A .png is one sheet of all
    pictures; with --layers all it has one row for each layer.

    \b
    Examples:
      scarfmt render scene.scar pictures/ --views 4
      scarfmt render scene.scar layers.png --views 3 --layers all --frame -y:125:70
      scarfmt render scene.ply view.png --views 1 --size 1280x720
      scarfmt render scene.scar pictures/ --like scene.ply --from inside
    """
    single, ending = output.lower().endswith(".png"), Path(output).suffix.lower()
    if ending in OTHER_PICTURES:
        raise click.UsageError(f"pictures are written as PNG: {output} must be a folder or end in .png, not {ending}")
    sheet_path = Path(output) if single else Path(output) / SHEET
    if single or sheet:
        _check_free(sheet_path, force)
    from scarfmt.cli.scenes import scene_origin

    options = ViewOptions(**views)
    with warnings_on_stderr(quiet), progress(quiet) as report:
        listed = list_cameras(options)
        origin = scene_origin(file)
        placing = None if like is None else scene_origin(like)
        pictures = _draw(origin, layers, lambda last: listed or _cameras(placing, last, options), report)
    written = [] if single else _write_each(pictures, Path(output), force)
    if single or sheet:
        written.append(_write_sheet(pictures, sheet_path))
    document = {"input": file, "pictures": [str(path) for path in written]}
    return Report(document, f"{plural(len(written), 'picture')} written to {output}")


def _cameras(placing: SceneOrigin | None, last: Subject, options: ViewOptions) -> list[Camera]:
    """Cameras placed by a file, or by the subject itself."""
    from scarfmt.cli.scenes import load_subject

    placed = last.placed if placing is None else load_subject(placing).placed
    return [camera for views in views_of(placed, options, RING).values() for camera in views]


def _draw(
    file: SceneOrigin, layers: str | None, cameras_for: Callable[[Subject], list[Camera]], report: Tell
) -> Pictures:
    """Pictures with their names, by layer. The key is '' if only one number of layers is drawn."""
    from scarfmt.cli.scenes import load_subject

    chosen = _layer_numbers(file, layers)
    pictures: Pictures = {}
    # The last layer places the cameras, so that all layers are seen alike.
    last = load_subject(file, chosen[-1])
    cameras = cameras_for(last)
    for layer in chosen:
        subject = last if layer == chosen[-1] else load_subject(file, layer)
        rows = pictures.setdefault(f"layer {layer}" if layers == ALL else "", [])
        for number, camera in enumerate(cameras):
            report(f"layer {layer}" if layer else "draw", number / len(cameras))
            rows.append((_picture_name(number, camera), subject.picture(camera)))
    return pictures


def _layer_numbers(file: SceneOrigin, layers: str | None) -> list[int | None]:
    from scarfmt.cli.scenes import layer_table

    if layers == ALL:
        return [row["layer"] for row in layer_table(file)]
    return [None if layers is None else int(layers)]


def _picture_name(number: int, camera: Camera) -> str:
    stem = Path(camera.name).stem if camera.name else ""
    label = "".join(c if c.isalnum() or c in "-_." else "-" for c in stem)
    return f"{number:03d}-{label}" if label else f"{number:03d}"


def _write_each(pictures: Pictures, folder: Path, force: bool) -> list[Path]:
    from scarfmt.render.images import write_png

    targets = [
        (folder / (f"{layer.replace(' ', '-')}-{name}.png" if layer else f"{name}.png"), image)
        for layer, row in pictures.items()
        for name, image in row
    ]
    for path, _ in targets:
        _check_free(path, force)
    folder.mkdir(parents=True, exist_ok=True)
    for path, image in targets:
        write_png(path, image)
    return [path for path, _ in targets]


def _write_sheet(pictures: Pictures, path: Path) -> Path:
    from scarfmt.render.images import contact_sheet, write_png

    rows = [(f"{layer} {name}".strip(), image) for layer, row in pictures.items() for name, image in row]
    columns = len(next(iter(pictures.values()))) if len(pictures) > 1 else 4
    if len(rows) == 1:
        write_png(path, rows[0][1])
    else:
        write_png(path, contact_sheet([image for _, image in rows], [name for name, _ in rows], columns))
    return path


def _check_free(path: Path, force: bool) -> None:
    from scarfmt.errors import InvalidInput

    if path.exists() and not force:
        raise InvalidInput("output-exists", f"{path} exists")
