"""`scarfmt inspect`: what a file holds, from its header."""

from __future__ import annotations

from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scarfmt.cli.files import check_stdout, open_input, open_output, read_origin, timeout_option
from scarfmt.cli.report import Report, reports

if TYPE_CHECKING:
    from scarfmt.container.source import ByteSource

_HEAD_BYTES = 4096
"""Size of the first request to a URL, in bytes: larger than the longest header."""


@click.command()
@click.argument("file")
@click.option("--metadata", is_flag=True, help="Also read and show the metadata the file carries.")
@click.option("--models", is_flag=True, help="Also report models of symbols: tables, predictors, networks.")
@click.option("--streaming", is_flag=True, help="Also report the data by which clients choose tiles to fetch first.")
@click.option(
    "--thumbnail", metavar="OUT", help="Also write the small picture in the file to OUT, whose ending says the format."
)
@click.option("--force", is_flag=True, help="Replace OUT if it exists.")
@timeout_option
@reports
def inspect(file: str, metadata: bool, models: bool, streaming: bool, thumbnail: str | None, force: bool) -> Report:
    """Report what FILE holds: counts, layers, and bytes of each kind of data.

    FILE is a path, a URL or - for stdin, whole or cut short. Without options only its header is read. Of scenes in
    other formats the command reports format, counts and what they say about themselves.

    \b
    Examples:
      scarfmt inspect scene.scar
      scarfmt inspect https://example.org/scene.scar --metadata
      scarfmt inspect scene.scar --models
      scarfmt inspect scene.scar --thumbnail scene.png
      scarfmt inspect scene.scar --json | jq '.layers[].end_offset'
    """
    from scarfmt.native.binding import absence, describe
    from scarfmt.tools import inspection

    check_stdout()
    origin = read_origin(file)
    if (other := _other_scene(origin)) is not None:
        return other
    head_bytes = None if metadata or models or streaming or thumbnail else _HEAD_BYTES
    with open_input(origin, head_bytes=head_bytes) as source:
        report = inspection.inspect(source, metadata=metadata)
        if models:
            from scarfmt.tools.models_report import describe_models

            report["models"] = describe_models(source)
        if streaming:
            from scarfmt.container.file import Container
            from scarfmt.tools.models_report import describe_streaming, format_streaming

            report["streaming"] = describe_streaming(Container(source, allow_truncated=True))
        if thumbnail is not None:
            _write_thumbnail(source, file, thumbnail, force)
    report["engine"] = {"name": "native" if absence() is None else "numpy", "no_native": absence()}
    parts = [f"{inspection.format_text(report)}{'engine':<17} {describe()}, here"]
    if models:
        from scarfmt.tools.models_report import format_models

        parts.append(format_models(report["models"]).rstrip("\n"))
    if streaming:
        parts.append(format_streaming(report["streaming"]).rstrip("\n"))
    return Report(report, "\n\n".join(parts), table=True)


def _write_thumbnail(source: ByteSource, file: str, name: str, force: bool) -> None:
    from scarfmt.container.file import Container
    from scarfmt.errors import InvalidInput
    from scarfmt.tools.inspection import read_thumbnail

    picture = read_thumbnail(Container(source, allow_truncated=True))
    if picture is None:
        raise InvalidInput("input-options", f"{file} has no thumbnail", field="--thumbnail")
    if not name.endswith(".webp"):
        from scarfmt.render.images import convert_picture

        picture = convert_picture(picture, Path(name).suffix)
    with open_output(name, force) as target:
        target.write(picture)


def _other_scene(file: str | bytes) -> Report | None:
    """The report on a scene that is no .scar file; None for a .scar file, and where only its reader can tell."""
    if isinstance(file, str) and ("://" in file or file.endswith(".scar") or not Path(file).exists()):
        return None
    from dataclasses import asdict

    from scarfmt.container.header import is_scar
    from scarfmt.errors import InvalidInput
    from scarfmt.formats import find, load
    from scarfmt.scene.gaussians import GaussianScene

    try:
        if is_scar(file):
            return None
        _, found = find(file)
    except InvalidInput:
        return None
    scene = load(file)
    unit = "gaussians" if isinstance(scene, GaussianScene) else "anchors"
    facts: dict[str, Any] = {"format": found.id, unit: len(scene)}
    if isinstance(scene, GaussianScene):
        said = asdict(scene.description)
        facts |= {"sh_degree": scene.sh_degree, "not_finite": int(scene.invalid_rows().sum())}
        facts |= {name: value.name.lower() if isinstance(value, IntEnum) else value for name, value in said.items()}
    text = [f"{name.replace('_', ' '):<21} {value}" for name, value in facts.items() if value not in (None, "")]
    return Report(facts, "\n".join(text), table=True)
