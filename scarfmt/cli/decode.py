"""`scarfmt decode`: from a .scar file to what viewers and other programs open."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any, BinaryIO

import click

from scarfmt.cli.decode_scene import VIEW_OPTIONS, write_part
from scarfmt.cli.eye import eye_options
from scarfmt.cli.failures import requires_extra, warnings_on_stderr
from scarfmt.cli.files import STANDARD, open_input, opens_index, print_json, timeout_option
from scarfmt.cli.outputs import SUFFIXES, open_scene_output, output_format, output_options, report_written, spz_options
from scarfmt.cli.progress import progress
from scarfmt.cli.stats import decode_stats, format_stats, whole_file
from scarfmt.cli.views import CAMERAS_HELP
from scarfmt.scene.streams import ATTRIBUTES

if TYPE_CHECKING:
    from reference_decoder.decoded import Decoded
    from reference_decoder.request import DecodeRequest
    from reference_decoder.stream_ply import Baking
    from scarfmt.cli.outputs import SceneOutput
    from scarfmt.container.source import ByteSource
    from scarfmt.counters import Counters

FORMATS = (*SUFFIXES, "npz")
ATTRIBUTES_HELP = f"Decode only some attributes, into an .npz: {', '.join(ATTRIBUTES)}."


def parse_box(
    _ctx: click.Context, _parameter: click.Parameter, value: str | None
) -> tuple[list[float], list[float]] | None:
    """Lowest and highest corner of `X0,Y0,Z0,X1,Y1,Z1`.

    Raises:
        click.BadParameter: not six finite numbers.
    """
    if value is None:
        return None
    try:
        numbers = [float(part) for part in value.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 6 or not all(map(math.isfinite, numbers)):
        raise click.BadParameter(f"{value!r} is not six numbers X0,Y0,Z0,X1,Y1,Z1")
    return numbers[:3], numbers[3:]


def parse_tiles(_ctx: click.Context, _parameter: click.Parameter, value: str | None) -> list[int] | None:
    """Tile indices of `I,J,...`.

    Raises:
        click.BadParameter: not natural numbers.
    """
    if value is None:
        return None
    parts = value.split(",")
    if not all(part.isdecimal() for part in parts):
        raise click.BadParameter(f"{value!r} is not tile numbers separated by commas")
    return [int(part) for part in parts]


def parse_attributes(_ctx: click.Context, _parameter: click.Parameter, value: str | None) -> list[str] | None:
    """Names of `NAME,...`.

    Raises:
        click.BadParameter: a name that no attribute has.
    """
    if value is None:
        return None
    names = value.split(",")
    if not set(names) <= set(ATTRIBUTES):
        raise click.BadParameter(f"{value!r}: choose from {', '.join(ATTRIBUTES)}")
    return names


@click.command(short_help="Decode a file into a PLY, SPZ or glTF that viewers open.")
@click.argument("input_", metavar="INPUT")
@click.argument("output")
@click.option("--format", "format_id", type=click.Choice(FORMATS), help="Format of OUTPUT [default: its name].")
@click.option("--layers", type=click.IntRange(min=1), help="Layers to decode, from the first [default: all].")
@click.option("--box", metavar="X0,Y0,Z0,X1,Y1,Z1", callback=parse_box, help="Decode only what lies in this box.")
@click.option("--tiles", metavar="I,J,...", callback=parse_tiles, help="Decode only these tiles.")
@eye_options
@click.option("--budget", type=click.IntRange(min=1), metavar="N", help="Maximum number of Gaussians for the view.")
@click.option("--outside", is_flag=True, help="Also decode the first layer of tiles outside the picture.")
@click.option("--attributes", metavar="NAME,...", callback=parse_attributes, help=ATTRIBUTES_HELP)
@click.option("--bake", is_flag=True, help="Convert an anchor model to fixed Gaussians. This loses quality.")
@click.option("--cameras", type=click.Path(exists=True), help=f"Cameras to --bake for: {CAMERAS_HELP}.")
@click.option("--bake-steps", type=click.IntRange(min=0), help="Number of pictures that refine --bake [default: 256].")
@click.option("--allow-truncated", is_flag=True,
              help="Decode the complete layers of a truncated file instead of refusing it.")  # fmt: skip
@click.option("--threads", type=click.IntRange(1, 256), help="Number of threads [default: one for each processor].")
@click.option(
    "--backend",
    type=click.Choice(["auto", "kernel", "numpy", "torch", "cuda"]),
    default="auto",
    show_default=True,
    help="Engine that computes. Exact values do not depend on it.",
)
@spz_options
@click.option("--stats", is_flag=True, help="Report bytes read, work done and time on stderr.")
@click.option("--json", "as_json", is_flag=True, help="Print the report of --stats as a JSON object on stdout.")
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@timeout_option
@requires_extra("render")
def decode(
    input_: str,
    output: str,
    format_id: str | None,
    bake: bool,
    cameras: str | None,
    bake_steps: int | None,
    stats: bool,
    as_json: bool,
    force: bool,
    quiet: bool,
    **wanted: Any,
) -> None:
    """Decode INPUT (a path, a URL or - for stdin) into OUTPUT (a path, or - for stdout).

    INPUT may be a scene index. Its files are then decoded one after the other, each at its place in the scene.

    The name of OUTPUT says its format; standard output gets a PLY unless --format says otherwise. A .ply holds
    Gaussians as INRIA's trainer writes them. A .glb or .gltf (with its .bin) holds floats with
    KHR_gaussian_splatting. A .spz or .compressed.ply is quantised; the command reports what the format cannot hold. An
    .npz holds the arrays of the scene. The .npz of an anchor model can be read by 'encode' and 'compare'. From a URL,
    the command transfers the first 64 KiB, and then only the ranges it needs.

    With --budget or a view (--camera, --target, --up, --fov), the view decides how many layers of each tile are
    decoded: many of near tiles, few of far tiles, none of tiles outside the picture. Options of the view that are left
    out are taken from the file. A file without a view is seen whole, from outside.

    \b
    Examples:
      scarfmt decode scene.scar scene.ply
      scarfmt decode https://example.org/scene.scar preview.ply --layers 1 --stats
      scarfmt decode scene.scar scene.glb
      scarfmt decode scene.scar scene.spz --spz-version 3
      scarfmt decode scene.scar corner.ply --box -1,-1,-1,1,1,1
      scarfmt decode scene.scar points.npz --attributes positions,opacity
      scarfmt decode city.scar.json seen.ply --camera 0,-2,-8 --target 0,0,0 --budget 2000000
    """
    format_id = output_format(output, format_id, others=(".npz",))
    options = output_options(format_id, wanted)
    view = {name: wanted.pop(name) for name in VIEW_OPTIONS}
    if not bake and (cameras is not None or bake_steps is not None):
        raise click.UsageError("--cameras and --bake-steps are for --bake")
    _check_output(output, format_id, wanted["attributes"] is not None, as_json)
    from reference_decoder.request import DecodeRequest
    from scarfmt.counters import Counters

    request = DecodeRequest(**wanted)
    counters = Counters()
    start = time.perf_counter()
    with warnings_on_stderr(quiet):
        baking = _baking(cameras, bake_steps) if bake else None
    with open_scene_output(output, format_id, options, force) as out, open_input(input_) as source:
        done, whole = _write(input_, source, out, baking, request, view, counters, quiet)
    if not quiet:
        click.echo(done, err=True)
    if stats or as_json:
        _report(decode_stats(counters, time.perf_counter() - start, _engine(request), whole), stats, as_json)


def _check_output(output: str, format_id: str, attributes: bool, as_json: bool) -> None:
    if attributes and format_id != "npz":
        raise click.UsageError("--attributes needs an .npz output: other formats hold all attributes")
    if as_json and output == STANDARD:
        raise click.UsageError("--json prints on standard output: give OUTPUT a file name")


def _engine(request: DecodeRequest) -> str:
    from reference_decoder.backends import described

    return described(request.backend)


def _report(found: dict[str, Any], stats: bool, as_json: bool) -> None:
    if stats:
        click.echo(format_stats(found), err=True, nl=False)
    if as_json:
        print_json(found)


def _write(
    name: str,
    source: ByteSource,
    out: SceneOutput,
    baking: Baking | None,
    request: DecodeRequest,
    view: dict[str, Any],
    counters: Counters,
    quiet: bool,
) -> tuple[str, dict[str, int]]:
    """Write a scene, a file or a part of it.

    Returns:
        A sentence about what was written, and the totals of the whole scene.
    """
    opened = source.bytes_read, source.reads
    scene = opens_index(source) or any(view.values())
    looked = source.bytes_read - opened[0], source.reads - opened[1]
    if scene:
        return write_part(name, source, out, request, view, baking, counters, quiet)
    done = _write_file(source, out, baking, request, counters, quiet)
    # Reads that only found out whether this is a file or an index are not counted as decoding.
    counters.bytes_read, counters.reads = source.bytes_read - looked[0], source.reads - looked[1]
    return done, whole_file(source)


def _write_file(
    source: ByteSource,
    out: SceneOutput,
    baking: Baking | None,
    request: DecodeRequest,
    counters: Counters,
    quiet: bool,
) -> str:
    """Write the contents of a file; returns a sentence about what was written."""
    if out.format_id == "npz":
        return _write_npz(source, out.target, request, counters)
    _check_gaussians(source, baking)
    from reference_decoder.stream_gaussians import stream_gaussians
    from reference_decoder.stream_ply import export_ply
    from scarfmt.formats.output import Written

    with progress(quiet) as report:
        how: Any = {"baking": baking, "counters": counters, "report": report}
        if out.format_id == "ply":
            written = Written(export_ply(source, out.target, request, **how), ())
        else:
            written = out.write(*stream_gaussians(source, request, **how))
    return report_written(written, quiet)


def _check_gaussians(source: ByteSource, baking: Baking | None) -> None:
    """Refuse an anchor model when --bake is not given."""
    from scarfmt.container.file import read_header
    from scarfmt.container.schema import Profile

    header = read_header(source, allow_truncated=True)
    if header.fields.profile == Profile.ANCHOR and baking is None:
        raise click.UsageError("an anchor model has no fixed Gaussians: decode to .npz, or give --bake")


def _baking(cameras: str | None, steps: int | None) -> Baking:
    """Settings of --bake. Cameras that the list holds out for tests are not used, unless it has no others."""
    from reference_decoder.stream_ply import BAKE_STEPS, Baking
    from scarfmt.render.capture import load_cameras

    listed = [] if cameras is None else load_cameras(cameras)
    views = [camera for camera in listed if camera.split != "test"] or listed
    return Baking(views, BAKE_STEPS if steps is None else steps)


def _write_npz(source: ByteSource, target: BinaryIO, request: DecodeRequest, counters: Counters) -> str:
    """Write the arrays of a scene, or of some attributes; returns a sentence about what was written."""
    import numpy as np

    from reference_decoder.decode import decode, decode_scene
    from scarfmt.formats import save_anchor_npz
    from scarfmt.scene.gaussians import AnchorModel

    if request.names() != frozenset(ATTRIBUTES):
        decoded = decode(source, request, counters=counters)
        np.savez(target, **_attribute_arrays(decoded))
        return f"{len(decoded):,} anchors of {decoded.layers} layers"
    scene = decode_scene(source, request, counters=counters)
    if isinstance(scene, AnchorModel):
        save_anchor_npz(scene, target)
        return f"{len(scene):,} anchors"
    np.savez(target, **vars(scene))
    return f"{len(scene):,} Gaussians"


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
