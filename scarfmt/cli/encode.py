"""`scarfmt encode`: from a trained scene to a .scar file."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from reference_encoder.options import (
    DEFAULT_MBIT,
    EFFORTS,
    ESTIMATORS,
    LATENTS,
    MAX_CORRECTIONS,
    MAX_MBIT,
    MAX_QUALITY,
    MIN_MBIT,
    MIN_QUALITY,
    MIN_TILE_ANCHORS,
    EncodeOptions,
)
from scarfmt.cli.failures import requires_extra, warnings_on_stderr
from scarfmt.cli.files import open_output
from scarfmt.cli.inputs import FORMAT_IDS, read_scene
from scarfmt.cli.out_of_core import OutOfCore, Reading, advise, out_of_core_options
from scarfmt.cli.progress import Report, progress
from scarfmt.cli.views import CAMERAS_HELP, FRAME_HELP
from scarfmt.errors import InvalidInput
from scarfmt.limits import MAX_ANCHORS_PER_TILE, MAX_LAYERS, MAX_VIEWPOINTS

if TYPE_CHECKING:
    from reference_encoder.judge.quality import Quality
    from reference_encoder.pipeline import Encoded
    from scarfmt.scene.gaussians import AnchorModel, GaussianScene

DEFAULTS = EncodeOptions()


def parse_metadata(_ctx: click.Context, _parameter: click.Parameter, pairs: tuple[str, ...]) -> dict[str, Any]:
    """The JSON object of `KEY=VALUE` arguments. A value that is JSON is parsed; any other value is text.

    Raises:
        click.BadParameter: an argument without `=`, or a key given twice.
        InvalidInput: ``input-options``: a value is nested too deeply, or is a number beyond binary64.
    """
    values: dict[str, Any] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or not key or key in values:
            raise click.BadParameter(f"{pair!r}: give KEY=VALUE, each key once")
        try:
            values[key] = json.loads(text, parse_constant=_refuse_constant)
        except RecursionError as error:
            message = f"metadata: the value of {key!r} is nested too deeply"
            raise InvalidInput("input-options", message, field="metadata") from error
        except ValueError:
            values[key] = text
    EncodeOptions(metadata=values).check()
    return values


def _refuse_constant(name: str) -> Any:
    # NaN and Infinity are not JSON, though Python reads them: they stay text.
    raise ValueError(name)


def parse_frame(_ctx: click.Context, _parameter: click.Parameter, value: str | None) -> str | None:
    """The frame as typed; None if the encoder is to detect it.

    Raises:
        InvalidInput: ``input-frame``.
    """
    if value is None:
        return None
    from scarfmt.render.camera import AUTO, check_frame

    check_frame(value)
    return None if value == AUTO else value


@click.command(short_help="Compress a scene into a .scar file.")
@click.argument("input_", metavar="INPUT")
@click.argument("output")
@click.option(
    "--quality",
    type=click.FloatRange(MIN_QUALITY, MAX_QUALITY),
    help="Target PSNR of the complete file against the input, in dB. It is the mean over views from outside, near and"
    " inside. With --cameras, most of the views are close to the cameras. The encoder makes no decision from these"
    f" views [default: {DEFAULTS.quality:g}].",
)
@click.option(
    "--worst",
    type=click.FloatRange(MIN_QUALITY, MAX_QUALITY),
    metavar="DB",
    help="Target in place of --quality: the PSNR in dB that 19 of 20 views reach (the 5th percentile), over the views"
    " by which the encoder judges its result.",
)
@click.option(
    "--effort",
    type=click.IntRange(min(EFFORTS), max(EFFORTS)),
    help=f"Time spent on a smaller file. 1: fast, without networks. 3: slow [default: {DEFAULTS.effort}].",
)
@click.option(
    "--corrections",
    type=click.IntRange(0, MAX_CORRECTIONS),
    metavar="N",
    help="Maximum number of passes used to meet --quality. Each renders the result, measures its PSNR and quantises"
    " again. 0: no check; the result can miss by several dB [default: set by --effort].",
)
@click.option(
    "--layers",
    type=click.IntRange(1, MAX_LAYERS),
    help=f"Maximum number of layers [default: {DEFAULTS.layers}].",
)
@click.option(
    "--cameras",
    type=click.Path(exists=True),
    help=f"All cameras of the capture, close to which quality matters most: {CAMERAS_HELP}.",
)
@click.option("--only-cameras", is_flag=True, help="Quality matters at --cameras alone, not elsewhere.")
@click.option("--frame", callback=parse_frame, help=f"{FRAME_HELP} [default: {DEFAULTS.frame}]")
@click.option("--sh-degree", type=click.IntRange(0, 3), help="Drop spherical harmonics above this degree.")
@click.option("--drop-invalid", is_flag=True, help="Leave out Gaussians with NaN or infinite values.")
@click.option("--format", "format_id", type=click.Choice(FORMAT_IDS), help="Input format [default: from content].")
@click.option(
    "--latent",
    type=click.Choice(LATENTS),
    help="Basis of the latents: linear (Karhunen-Loève), or learned (an autoencoder with residual vector quantisation)."
    " Unlike that of the SCAR-GS paper, the autoencoder is trained by squared error, after the scene is finished"
    f" [default: {DEFAULTS.latent}].",
)
@click.option(
    "--estimator",
    type=click.Choice(ESTIMATORS),
    help=f"Gradient through the quantiser of --latent learned [default: {DEFAULTS.estimator}].",
)
@click.option(
    "--mbit",
    type=click.FloatRange(MIN_MBIT, MAX_MBIT),
    metavar="MBIT",
    help="Bandwidth for which the file is made, in megabits per second. The encoder uses a network where it shortens"
    f" transfer and decoding together. A lower bandwidth gives a smaller file that decodes slower [default:"
    f" {DEFAULT_MBIT:g}].",
)
@click.option("--archive", is_flag=True, help="Make the smallest file, however long it decodes. Excludes --mbit.")
@click.option(
    "--decode-budget",
    type=click.IntRange(min=0),
    metavar="N",
    help="Maximum multiply-adds of integer networks per Gaussian or anchor when decoding. It bounds what --mbit and"
    " --archive may use. 0: static tables only [default: no bound].",
)
@click.option(
    "--tile-size",
    "tile_anchors",
    type=click.IntRange(MIN_TILE_ANCHORS, MAX_ANCHORS_PER_TILE),
    metavar="N",
    help=f"Maximum anchors per tile, {MIN_TILE_ANCHORS} to {MAX_ANCHORS_PER_TILE}. Smaller tiles make regions cheaper"
    " to decode, and the whole file larger and slower [default: 32768; 16384 in scenes of more than 262,144"
    " Gaussians].",
)
@click.option(
    "--viewpoints",
    type=click.IntRange(0, MAX_VIEWPOINTS),
    metavar="N",
    help="Number of viewpoints for which the file holds the gain of each layer of each tile. Streaming clients then"
    " fetch what their view needs most. 0: no gains [default: 4 to 8, within 0.5 % of the file. A file of a single tile"
    " has none, but with --cameras it has a first view].",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Seed for all random choices. The same seed gives the same file with the same versions of packages on the same"
    f" kind of processor, with any number of threads [default: {DEFAULTS.seed}].",
)
@click.option(
    "--metadata", multiple=True, metavar="KEY=VALUE", callback=parse_metadata, help="Add an annotation; repeatable."
)
@out_of_core_options
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@requires_extra("encode")
def encode(
    input_: str, output: str, format_id: str | None, sh_degree: int | None, drop_invalid: bool, force: bool, **said: Any
) -> None:
    """Compress the scene INPUT into the .scar file OUTPUT. Either may be - (stdin, stdout).

    INPUT is a 3DGS or compressed PLY, SPZ, glTF (.glb, .gltf), SOG, .splat, or an anchor model (.npz, or a folder of
    Scaffold-GS). The encoder stores coarsely what is rarely seen. --cameras or --frame say from where the scene will be
    seen.

    \b
    Examples:
      scarfmt encode point_cloud.ply scene.scar
      scarfmt encode scene.spz scene.scar --cameras cameras.json --layers 4
      scarfmt encode - - --frame -y:125:70 --format ply < scene.ply > scene.scar
      scarfmt encode scene.ply small.scar --archive
      scarfmt encode scene.ply mobile.scar --mbit 2
      scarfmt encode scene.ply fast.scar --decode-budget 0
      scarfmt encode scene.ply scene.scar --metadata title="Old oak" --metadata year=2024
      scarfmt encode city.ply city.scar --work city.work --workers 4
      scarfmt encode city/lod-meta.json city.scar --work city.work --workers 4 --resume
    """
    quiet = said.pop("quiet")
    ranges = OutOfCore.of(said)
    if said["quality"] is not None and said["worst"] is not None:
        raise click.UsageError("--quality and --worst exclude each other")
    if said["archive"] and said["mbit"] is not None:
        raise click.UsageError("--archive and --mbit exclude each other")
    if said["only_cameras"] and said["cameras"] is None:
        raise click.UsageError("--only-cameras needs --cameras")
    if ranges is not None:
        options, reading = _options(said), Reading(format_id, sh_degree, drop_invalid)
        quality = ranges.encode(input_, output, reading, options, force, quiet)
        if not quiet:
            _print_quality(quality, options.asked_db)
        return
    with warnings_on_stderr(quiet), open_output(output, force) as target, progress(quiet) as report:
        report("read", 0.0)
        options = _options(said)
        scene = read_scene(input_, format_id, sh_degree, drop_invalid, quiet)
        advise(len(scene))
        data = _encode(scene, options, report)
        target.write(data)
    if not quiet:
        _print_summary(data)
        _print_quality(data.quality, options.asked_db)


def _options(said: dict[str, Any]) -> EncodeOptions:
    """The options, checked, and the cameras read, before anything slow is imported or read."""
    given = {name: value for name, value in said.items() if value is not None}
    if "cameras" in given:
        from scarfmt.render.capture import load_cameras

        given["cameras"] = load_cameras(given["cameras"])
    options = EncodeOptions(**given)
    options.check()
    return options


def _encode(scene: GaussianScene | AnchorModel, options: EncodeOptions, report: Report) -> Encoded:
    from reference_encoder.encode import encode

    return encode(scene, options, report)


def _print_summary(data: bytes) -> None:
    from scarfmt.container.source import BytesSource
    from scarfmt.tools import inspection

    report = inspection.inspect(BytesSource(data), metadata=True)
    unit = "anchor" if report["profile"] == "anchor" else "Gaussian"
    count, size = report["source_count"], report["file_bytes"]
    click.echo(f"{count:,} {unit}s in, {report['anchors']:,} kept", err=True)
    click.echo(f"{size:,} bytes, {size / count:.2f} per {unit} of the input", err=True)
    _print_account((report["metadata"] or {}).get("survey"))
    for layer in report["layers"]:
        line = f"layer {layer['layer']}: {layer['end_offset']:>12,} bytes  {layer['anchors']:>10,} {unit}s"
        click.echo(f"{line}  {layer['end_offset'] / count:6.2f} bytes per {unit} of the input", err=True)


def _print_quality(quality: Quality, asked_db: float) -> None:
    if not len(quality):
        click.echo("quality not judged: no view shows anything", err=True)
        return
    click.echo(f"quality from {len(quality)} views that played no part in encoding, dB:", err=True)
    for name, found in {"all": quality, **quality.by_kind()}.items():
        line = f"mean {found.mean_db:6.2f}  5th percentile {found.low_db:6.2f}  worst {found.worst_db:6.2f}"
        click.echo(f"  {name:<6}  {line}", err=True)
    for shortfall in quality.shortfalls(asked_db):
        click.echo(f"  {shortfall}", err=True)


def _print_account(found: Any) -> None:
    """Print the survey of METADATA: the views of the encoder, and what it left out. Other contents are ignored."""
    if not isinstance(found, dict) or not {"up", "radius", "left_out"} <= found.keys():
        return
    how = "detected; --frame to override" if found["up_detected"] else "as given"
    doubt = f", perhaps {found['up_or']}" if "up_or" in found else ""
    views = ", ".join(f"{count} {kind}" for kind, count in found["views"].items())
    click.echo(f"up: {found['up']}{doubt} ({how}); radius {found['radius']:g}; views: {views}", err=True)
    gone = found["left_out"]
    said = f"left out: {gone['invisible']:,} invisible from all views, {gone['faint']:,} too faint for this quality"
    if "without_view_dependence" in found:
        said += f"; without view-dependent colour: {found['without_view_dependence']:,}"
    click.echo(said, err=True)
