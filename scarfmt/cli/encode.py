"""`scarfmt encode`: from a trained scene to a .scar file."""

from __future__ import annotations

import errno
import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from reference_encoder.options import (
    EFFORTS,
    MAX_CORRECTIONS,
    MAX_QUALITY,
    MIN_QUALITY,
    MIN_TILE_ANCHORS,
    STAGES,
    EncodeOptions,
)
from scarfmt.cli.failures import FAILED, describe, warnings_on_stderr
from scarfmt.cli.files import STANDARD, check_output, open_input, open_output
from scarfmt.cli.inputs import FORMAT_IDS, read_scene, render_model_option
from scarfmt.cli.out_of_core import OutOfCore, advise, out_of_core_options
from scarfmt.cli.progress import progress
from scarfmt.cli.report import Report, reports
from scarfmt.cli.views import CAMERAS_HELP, FRAME_HELP
from scarfmt.errors import InvalidInput, ScarError, plural
from scarfmt.limits import MAX_ANCHORS_PER_TILE, MAX_LAYERS

if TYPE_CHECKING:
    from reference_encoder.judge.quality import Quality

DEFAULTS = EncodeOptions()
STEPS = {"read": 0.02, **STAGES}
PRESETS: dict[str, dict[str, Any]] = {"web": {}, "archive": {"quality": 55.0}, "preview": {"quality": 36.0}}
"""Options by what the file is for."""


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
    EncodeOptions(metadata=values)
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


_ENDING = ".scar"


@click.command()
@click.argument("inputs", metavar="INPUT...", nargs=-1)
@click.argument("output")
@click.option("--out-dir", metavar="DIR", help="Encode every file named into this folder, under its name.")
@click.option(
    "--preset",
    type=click.Choice(list(PRESETS)),
    help="web: the defaults. archive: --quality 55. preview: --quality 36. Options given beside it win.",
)
@click.option(
    "--quality",
    type=click.FloatRange(MIN_QUALITY, MAX_QUALITY),
    help="Target PSNR against the input, in dB: the mean over views from outside, near and inside; with --cameras,"
    " mostly close to these"
    f" [default: {DEFAULTS.quality:g}].",
)
@click.option(
    "--worst",
    type=click.FloatRange(MIN_QUALITY, MAX_QUALITY),
    metavar="DB",
    help="In place of --quality: the PSNR in dB that 19 of 20 views reach.",
)
@click.option(
    "--effort",
    type=click.IntRange(min(EFFORTS), max(EFFORTS)),
    help="Time spent on a smaller file. 0: a draft, without a survey. 1: a survey from 96 places. 2: from twice as"
    f" many, for files up to 2 % smaller [default: {DEFAULTS.effort}].",
)
@click.option(
    "--corrections",
    type=click.IntRange(0, MAX_CORRECTIONS),
    metavar="N",
    help="Maximum number of passes to meet --quality. 0: no check; the result can miss by several dB [default: set by"
    " --effort].",
)
@click.option(
    "--layers",
    type=click.IntRange(1, MAX_LAYERS),
    help=f"Maximum number of layers [default: {DEFAULTS.layers}].",
)
@click.option(
    "--cameras",
    type=click.Path(exists=True),
    help=f"Capture cameras; quality is highest near them: {CAMERAS_HELP}.",
)
@click.option("--only-cameras", is_flag=True, help="Ignore quality away from --cameras.")
@click.option("--frame", callback=parse_frame, help=f"{FRAME_HELP} [default: {DEFAULTS.frame}]")
@click.option("--sh-degree", type=click.IntRange(0, 3), help="Drop spherical harmonics above this degree.")
@click.option("--drop-invalid", is_flag=True, help="Leave out Gaussians with NaN, and tell how many show.")
@render_model_option
@click.option("--from", "format_id", type=click.Choice(FORMAT_IDS), help="Format of INPUT [default: from content].")
@click.option(
    "--tile-size",
    "tile_anchors",
    type=click.IntRange(MIN_TILE_ANCHORS, MAX_ANCHORS_PER_TILE),
    metavar="N",
    help=f"Maximum anchors per tile, {MIN_TILE_ANCHORS} to {MAX_ANCHORS_PER_TILE}. Smaller tiles make regions cheaper"
    " to decode, and the file larger [default: 32768; 16384 in scenes of more than 262,144"
    " Gaussians].",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help=f"Seed for all random choices. Equal seeds give equal files on one machine [default: {DEFAULTS.seed}].",
)
@click.option(
    "--metadata", multiple=True, metavar="KEY=VALUE", callback=parse_metadata, help="Add an annotation; repeatable."
)
@out_of_core_options
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@click.option(
    "--verbose", "-v", is_flag=True, help="Also report layers, what was removed, and quality by kind of view."
)
@reports
def encode(
    inputs: tuple[str, ...],
    output: str,
    out_dir: str | None,
    preset: str | None,
    force: bool,
    quiet: bool,
    verbose: bool,
    **fields: Any,
) -> Report:
    """Compress the scene INPUT into the .scar file OUTPUT, or each INPUT into a file of DIR. - is stdin or stdout.

    INPUT is a 3DGS or compressed PLY, SPZ, glTF (.glb, .gltf), SOG, .splat, .ksplat, .rad, or an anchor model (.npz, or
    a folder of Scaffold-GS). Parts that are rarely visible get fewer bytes. --cameras or --frame say from where the
    scene will be seen.

    \b
    Examples:
      scarfmt encode point_cloud.ply scene.scar
      scarfmt encode scene.spz scene.scar --cameras cameras.json --layers 4
      scarfmt encode *.ply --out-dir small/ --preset preview
      scarfmt encode - - --frame -y:125:70 --from ply < scene.ply > scene.scar
      scarfmt encode scene.ply scene.scar --metadata title="Old oak" --metadata year=2024
      scarfmt encode city.ply city.scar --work city.work --workers 4
      scarfmt encode city/lod-meta.json city.scar --work city.work --workers 4 --resume
    """
    reading = {name: fields.pop(name) for name in ("format_id", "sh_degree", "drop_invalid", "render_model")}
    ranges = OutOfCore.of(fields)
    if fields["quality"] is not None and fields["worst"] is not None:
        raise click.UsageError("--quality and --worst exclude each other")
    if fields["only_cameras"] and fields["cameras"] is None:
        raise click.UsageError("--only-cameras needs --cameras")
    if out_dir is None and len(inputs) != 1:
        raise click.UsageError("give INPUT and OUTPUT, or several INPUTs and --out-dir DIR")
    if out_dir is not None and ranges is not None:
        raise click.UsageError("--work is for one scene: leave out --out-dir")
    if out_dir is None and output != STANDARD and not output.lower().endswith(_ENDING) and _is_new_file(output):
        raise click.UsageError(f"{output} must end in {_ENDING}; 'scarfmt convert' writes other formats")
    options = _options(PRESETS.get(preset or "", {}), fields)
    one = partial(_encode, options, reading, ranges, force, quiet, verbose)
    with warnings_on_stderr(quiet):
        if out_dir is None:
            return one(inputs[0], output)
        return _encode_each(one, (*inputs, output), out_dir, force, quiet)


def _is_new_file(name: str) -> bool:
    """Whether a name is that of a regular file, or of none yet: devices and pipes have no endings."""
    return not Path(name).exists() or Path(name).is_file()


def _options(preset: dict[str, Any], fields: dict[str, Any]) -> EncodeOptions:
    """The options, checked, and the cameras read, before anything slow is imported or read."""
    given = {**preset, **{name: value for name, value in fields.items() if value is not None}}
    if "cameras" in given:
        from scarfmt.render.capture import load_cameras

        given["cameras"] = load_cameras(given["cameras"])
    return EncodeOptions(**given)


def _encode(
    options: EncodeOptions,
    reading: dict[str, Any],
    ranges: OutOfCore | None,
    force: bool,
    quiet: bool,
    verbose: bool,
    name: str,
    output: str,
) -> Report:
    """Encode one scene, and tell what came of it."""
    start = time.monotonic()
    if ranges is not None:
        done = ranges.encode(name, output, reading, options, force, quiet)
        quality = done.quality
        file: dict[str, Any] = {"source_count": done.count, "file_bytes": done.file_bytes}
        if output != STANDARD:
            file = _inspect(output)
    else:
        with open_output(output, force) as target, progress(quiet, STEPS) as tell:
            tell("read", 0.0)
            scene = read_scene(name, **reading)
            advise(len(scene))
            from reference_encoder.encode import encode as encode_scene

            data = encode_scene(scene, options, tell)
            target.write(data)
        quality, file = data.quality, _inspect(data)
    verdict = "; ".join(filter(None, (quality.verdict(), quality.explain_miss(options))))
    document = {"input": name, "output": output, "seconds": time.monotonic() - start, "verdict": verdict,
                "quality": quality.figures(), "file": file}  # fmt: skip
    lines = [_size_line(file), verdict]
    return Report(document, "\n".join([*_details(file, quality, options.asked_db), *lines] if verbose else lines))


def _inspect(file: str | bytes) -> dict[str, Any]:
    from scarfmt.tools import inspection

    with open_input(file) as source:
        return inspection.inspect(source, metadata=True)


def _encode_each(
    one: Callable[[str, str], Report], names: Sequence[str], folder: str, force: bool, quiet: bool
) -> Report:
    """Encode scenes one after the other; those that fail are listed at the end."""
    targets = _targets(names, folder)
    Path(folder).mkdir(parents=True, exist_ok=True)
    for target in targets:
        check_output(target, force)
    documents, failures = [], []
    for name, target in zip(names, targets, strict=True):
        try:
            found = one(name, target)
        except (ScarError, click.UsageError, MemoryError, OSError) as error:
            if isinstance(error, OSError) and error.errno == errno.EPIPE:
                raise
            failures.append(f"{name}: {describe(error)}")
            documents.append({"input": name, "output": None, "error": describe(error)})
            line = f"{name}: failed"
        else:
            documents.append(found.document)
            line = f"{name} -> {target}: {found.document['file']['file_bytes']:,} bytes; {found.document['verdict']}"
        if not quiet:
            click.echo(line, err=True)
    end = f"{len(names) - len(failures)} of {plural(len(names), 'scene')} encoded"
    if failures:
        end += "; failed:"
    text = "\n".join([end, *(f"  {failure}" for failure in failures)])
    return Report({"files": documents}, text, code=FAILED if failures else 0)


def _targets(names: Sequence[str], folder: str) -> list[str]:
    """The output of each input.

    Raises:
        click.UsageError: an input has no name, or two would have the same output.
    """
    from scarfmt.formats import stem

    found: dict[str, str] = {}
    for name in names:
        if name == STANDARD:
            raise click.UsageError("--out-dir needs files with names, not -")
        target = str(Path(folder) / f"{stem(name)}{_ENDING}")
        if target in found:
            raise click.UsageError(f"{found[target]} and {name} would both become {target}: encode one by itself")
        found[target] = name
    return list(found)


def _unit(file: dict[str, Any]) -> str:
    return "anchor" if file.get("profile") == "anchor" else "Gaussian"


def _size_line(file: dict[str, Any]) -> str:
    count, size, unit = file["source_count"], file["file_bytes"], _unit(file)
    kept = f", {file['anchors']:,} kept" if "anchors" in file else ""
    return f"{plural(count, unit)} in{kept}; {size:,} bytes, {size / count:.2f} per {unit} of the input"


def _details(file: dict[str, Any], quality: Quality, asked_db: float) -> list[str]:
    """Layers, survey and quality, in lines."""
    unit = _unit(file)
    lines = [
        f"layer {layer['layer']}: {layer['end_offset']:>12,} bytes  {plural(layer['anchors'], unit):>20}"
        f"  {layer['end_offset'] / file['source_count']:6.2f} bytes per {unit} of the input"
        for layer in file.get("layers", ())
    ]
    lines += _survey((file.get("metadata") or {}).get("survey"))
    if not len(quality):
        return lines
    lines.append(f"quality on {plural(len(quality), 'test view')}, dB:")
    for name, found in {"all": quality, **quality.by_kind()}.items():
        line = f"mean {found.mean_db:6.2f}  5th percentile {found.low_db:6.2f}  worst {found.worst_db:6.2f}"
        lines.append(f"  {name:<6}  {line}")
    return lines + [f"  {shortfall}" for shortfall in quality.shortfalls(asked_db)]


def _survey(found: Any) -> list[str]:
    """The survey of METADATA: the views of the encoder, and what it left out. Other contents are ignored."""
    if not isinstance(found, dict) or not {"up", "radius", "left_out"} <= found.keys():
        return []
    how = "detected; --frame to override" if found["up_detected"] else "as given"
    doubt = f", perhaps {found['up_or']}" if "up_or" in found else ""
    views = ", ".join(f"{count} {kind}" for kind, count in found["views"].items())
    gone = found["left_out"]
    line = f"removed: {gone['invisible']:,} never visible, {gone['faint']:,} too faint for this quality"
    if "without_view_dependence" in found:
        line += f"; {found['without_view_dependence']:,} lost their view-dependent colour"
    return [f"up: {found['up']}{doubt} ({how}); radius {found['radius']:g}; views: {views}", line]
