"""`scarfmt decode`: from a .scar file to what viewers and other programs open."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any, BinaryIO

import click

from scarfmt.cli.camera_options import camera_of, camera_options
from scarfmt.cli.failures import warnings_on_stderr
from scarfmt.cli.files import open_input, open_output, timeout_option
from scarfmt.cli.outputs import SUFFIXES, output_format, output_options, report_written, spz_options
from scarfmt.cli.progress import progress
from scarfmt.cli.report import Report, reports
from scarfmt.cli.views import CAMERAS_HELP
from scarfmt.errors import InputWarning
from scarfmt.scene.streams import ATTRIBUTES

if TYPE_CHECKING:
    from reference_decoder.bake import Baking
    from reference_decoder.decode import DecodeRequest
    from reference_decoder.decoded import Decoded
    from reference_decoder.lod_selection import LevelOfDetail
    from scarfmt.container.source import ByteSource
    from scarfmt.counters import Counters
    from scarfmt.formats.output import Described, Written
    from scarfmt.scene.gaussians import GaussianScene

FORMATS = (*SUFFIXES, "npz")
VIEW_OPTIONS = ("camera", "target", "up", "fov", "size", "budget", "outside")
"""Options that select a view. If any of them is given, only what the view needs is decoded."""
ATTRIBUTES_HELP = f"Decode only some attributes, into an .npz: {', '.join(ATTRIBUTES)}."


def parse_box(value: str) -> tuple[list[float], list[float]]:
    """Lowest and highest corner of `X0,Y0,Z0,X1,Y1,Z1`.

    Raises:
        click.BadParameter: not six finite numbers.
    """
    try:
        numbers = [float(part) for part in value.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 6 or not all(map(math.isfinite, numbers)):
        raise click.BadParameter(f"{value!r} is not six numbers X0,Y0,Z0,X1,Y1,Z1")
    return numbers[:3], numbers[3:]


def parse_tiles(value: str) -> list[int]:
    """Tile indices of `I,J,...`.

    Raises:
        click.BadParameter: not natural numbers, or one of them twice, which would double what the tile shows.
    """
    parts = value.split(",")
    tiles = [int(part) for part in parts if part.isdecimal()]
    if len(set(tiles)) < len(parts):
        raise click.BadParameter(f"{value!r} is not tile numbers separated by commas, each once")
    return tiles


def parse_attributes(value: str) -> list[str]:
    """Names of `NAME,...`.

    Raises:
        click.BadParameter: a name that no attribute has.
    """
    names = value.split(",")
    if not set(names) <= set(ATTRIBUTES):
        raise click.BadParameter(f"{value!r}: choose from {', '.join(ATTRIBUTES)}")
    return names


@click.command()
@click.argument("input_", metavar="INPUT")
@click.argument("output")
@click.option("--format", "format_id", type=click.Choice(FORMATS), help="Format of OUTPUT [default: its name].")
@click.option("--layers", type=click.IntRange(min=1), help="Layers to decode, from the first [default: all].")
@click.option("--box", metavar="X0,Y0,Z0,X1,Y1,Z1", type=parse_box, help="Decode only what lies in this box.")
@click.option("--tiles", metavar="I,J,...", type=parse_tiles, help="Decode only these tiles.")
@camera_options
@click.option("--budget", type=click.IntRange(min=1), metavar="N", help="Maximum number of Gaussians for the view.")
@click.option("--outside", is_flag=True, help="Also decode the first layer of tiles outside the picture.")
@click.option("--attributes", metavar="NAME,...", type=parse_attributes, help=ATTRIBUTES_HELP)
@click.option("--bake", is_flag=True, help="Convert an anchor model to fixed Gaussians. This loses quality.")
@click.option("--cameras", type=click.Path(exists=True), help=f"Cameras to --bake for: {CAMERAS_HELP}.")
@click.option("--bake-steps", type=click.IntRange(min=0), help="Number of pictures that refine --bake [default: 256].")
@click.option("--allow-truncated", is_flag=True,
              help="Decode the complete layers of a truncated file instead of refusing it.")  # fmt: skip
@click.option("--threads", type=click.IntRange(1, 256), help="Number of threads [default: one for each processor].")
@spz_options
@click.option("--stats", is_flag=True, help="Report bytes read, work done and time on stderr.")
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@timeout_option
@reports
def decode(
    input_: str,
    output: str,
    format_id: str | None,
    bake: bool,
    cameras: str | None,
    bake_steps: int | None,
    stats: bool,
    force: bool,
    quiet: bool,
    **wanted: Any,
) -> Report:
    """Decode INPUT (a path, a URL or - for stdin) into OUTPUT (a path, or - for stdout).

    The name of OUTPUT says its format; standard output gets a PLY unless --format says otherwise. The command reports
    what the format cannot hold. An .npz holds the arrays of the scene; that of an anchor model can be encoded again.
    From a URL, only the ranges that are needed are transferred.

    With --budget or a view (--camera, --target, --up, --fov), the view decides how many layers of each tile are
    decoded: many of near tiles, few of far tiles, none of tiles outside the picture. Options of the view that are left
    out are taken from the file. A file without a view is seen whole, from outside.

    \b
    Examples:
      scarfmt decode scene.scar scene.ply
      scarfmt decode https://example.org/scene.scar preview.ply --layers 1 --stats
      scarfmt decode scene.scar scene.spz --spz-version 3
      scarfmt decode scene.scar corner.ply --box -1,-1,-1,1,1,1
      scarfmt decode scene.scar seen.ply --camera 0,-2,-8 --target 0,0,0 --budget 2000000
    """
    format_id = output_format(output, format_id, others=(".npz",))
    options = output_options(format_id, wanted)
    view = {name: wanted.pop(name) for name in VIEW_OPTIONS}
    if not bake and (cameras is not None or bake_steps is not None):
        raise click.UsageError("--cameras and --bake-steps are for --bake")
    if any(view.values()) and (bake or wanted["attributes"] is not None):
        raise click.UsageError("--bake and --attributes are for a whole file, not for what a view needs")
    if wanted["attributes"] is not None and format_id != "npz":
        raise click.UsageError("--attributes needs an .npz output: other formats hold all attributes")
    from reference_decoder.decode import DecodeRequest
    from scarfmt.counters import Counters
    from scarfmt.formats.outputs import open_targets, write_parts

    request = DecodeRequest(**wanted)
    start, counters = time.perf_counter(), Counters()
    with warnings_on_stderr(quiet), open_input(input_) as source:
        baking = _baking(cameras, bake_steps) if bake else None
        with open_targets(output, format_id, options, partial(open_output, force=force)) as (target, options):
            detail = _level_of_detail(source, request, view) if any(view.values()) else None
            if format_id == "npz":
                written = _write_npz(source, target, request, detail, counters)
            else:
                described, parts = _parts(source, request, detail, baking, counters, quiet)
                written = write_parts(format_id, parts, described, target, options)
            if not written.count and request.box is not None:
                _warn_outside(source, request)
        counters.bytes_read, counters.reads = source.bytes_read, source.reads
        found = _stats(source, counters, time.perf_counter() - start)
        lines = [_format_stats(found)] if stats else []
        return report_written((input_, output), written, {"format": format_id, **found}, *lines)


def _warn_outside(source: ByteSource, request: DecodeRequest) -> None:
    """Warn that a box is empty, and tell where the scene is."""
    from reference_decoder.region import tile_boxes
    from scarfmt.coding.reader import SceneReader

    reader = SceneReader(source, limits=request.limits, allow_truncated=request.allow_truncated)
    low, high = tile_boxes(reader.lattice, reader.container.tile_table)
    corners = ",".join(f"{value:g}" for value in (*low.min(axis=0), *high.max(axis=0))) if len(low) else "nowhere"
    warnings.warn(f"nothing lies in the box; the scene lies in {corners}", InputWarning, stacklevel=2)


def _level_of_detail(source: ByteSource, request: DecodeRequest, values: dict[str, Any]) -> LevelOfDetail:
    """The view that `values` of `VIEW_OPTIONS` name; what they leave out is the file's view."""
    from reference_decoder.lod_selection import LevelOfDetail
    from reference_decoder.region import tile_boxes
    from scarfmt.blocks.streaming import read_streaming
    from scarfmt.coding.reader import SceneReader

    reader = SceneReader(source, limits=request.limits, allow_truncated=request.allow_truncated)
    streaming = read_streaming(reader.container)
    boxes = tile_boxes(reader.lattice, reader.container.tile_table)
    camera = camera_of(values, boxes, None if streaming is None else streaming.view)
    return LevelOfDetail(camera, values["budget"], values["outside"])


def _parts(
    source: ByteSource,
    request: DecodeRequest,
    view: LevelOfDetail | None,
    baking: Baking | None,
    counters: Counters,
    quiet: bool,
) -> tuple[Described, Iterable[GaussianScene]]:
    """The Gaussians of a file, or what a view needs of them, and their properties."""
    if view is not None:
        from reference_decoder.lod_selection import iter_view
        from reference_decoder.stream_gaussians import describe_output
        from scarfmt.coding.reader import SceneReader

        reader = SceneReader(source, limits=request.limits, allow_truncated=True)
        return describe_output(reader), iter_view(source, request, view, counters)
    from reference_decoder.stream_gaussians import stream_gaussians

    if baking is None:
        return stream_gaussians(source, request, counters=counters)
    with progress(quiet) as tell:
        return stream_gaussians(source, request, baking=baking, counters=counters, report=tell)


def _baking(cameras: str | None, steps: int | None) -> Baking:
    """Settings of --bake. Cameras that the list holds out for tests are not used, unless it has no others."""
    from reference_decoder.bake import BAKE_STEPS, Baking
    from scarfmt.render.capture import load_cameras

    listed = [] if cameras is None else load_cameras(cameras)
    views = [camera for camera in listed if camera.split != "test"] or listed
    return Baking(views, BAKE_STEPS if steps is None else steps)


def _write_npz(
    source: ByteSource, target: BinaryIO, request: DecodeRequest, view: LevelOfDetail | None, counters: Counters
) -> Written:
    """Write the arrays of a scene, or of some attributes."""
    import numpy as np

    from reference_decoder.decode import decode, decode_scene
    from scarfmt.api import decode_view
    from scarfmt.formats.anchor_npz import save_anchor_npz
    from scarfmt.formats.output import Written
    from scarfmt.scene.gaussians import AnchorModel

    if request.names() != frozenset(ATTRIBUTES):
        decoded = decode(source, request, counters=counters)
        np.savez(target, **_attribute_arrays(decoded))
        return Written(len(decoded), (), "anchor")
    scene = (
        decode_scene(source, request, counters=counters)
        if view is None
        else decode_view(source, view, request, counters=counters)
    )
    if isinstance(scene, AnchorModel):
        save_anchor_npz(scene, target)
        return Written(len(scene), (), "anchor")
    np.savez(target, **scene.arrays())
    return Written(len(scene), ())


def _attribute_arrays(decoded: Decoded) -> dict[str, Any]:
    """The arrays decoded, by name: channels as coded values, with tile and class of each anchor."""
    arrays = {"tiles": decoded.tiles, "classes": decoded.classes}
    for name, stream in ATTRIBUTES.items():
        if stream in decoded.values:
            arrays[name] = decoded.values[stream]
    if decoded.positions is not None:
        arrays["positions"] = decoded.positions
    if decoded.indices is not None:
        arrays["latents"] = decoded.latents
    return arrays


_TOTALS = (("bytes", "bytes_read"), ("blocks", "blocks"), ("tiles", "tiles"), ("anchors", "anchors"))


def _stats(source: ByteSource, counters: Counters, seconds: float) -> dict[str, Any]:
    """What a decode took, and in ``file`` the totals of the whole file, JSON-able."""
    from scarfmt.container.header import read_header
    from scarfmt.native.binding import describe

    header = read_header(source, allow_truncated=True)
    return {
        "seconds": seconds,
        "engine": describe(),
        "decoded": {**vars(counters), "blocks": counters.model_blocks + counters.tile_blocks},
        "file": {
            "bytes": header.file_length,
            "tiles": header.tile_count,
            "anchors": header.anchor_count,
            "layers": header.layer_count,
        },
    }


def _format_stats(stats: dict[str, Any]) -> str:
    """The report of :func:`_stats` for people, a line for each count."""
    decoded, whole = stats["decoded"], stats["file"]
    # The header does not give the number of blocks.
    rows = [(name, decoded[key], _share(decoded[key], whole.get(name))) for name, key in _TOTALS]
    rows[0] = (*rows[0][:2], f"{rows[0][2]}, in {decoded['reads']} reads")
    width = max(len(f"{count:,}") for _, count, _ in rows)
    lines = [f"{name:<17} {count:>{width},}  {note}".rstrip() for name, count, note in rows]
    lines.append(f"{'engine':<17} {stats['engine']:>{width}}")
    return "\n".join([*lines, f"{'seconds':<17} {stats['seconds']:>{width}.2f}"])


def _share(part: int, whole: int | None) -> str:
    if whole is None:
        return ""
    return f"of {whole:,} ({100 * part / whole:.1f} %)" if whole else f"of {whole:,}"
