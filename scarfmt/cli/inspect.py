"""`scarfmt inspect`: what a file holds, from its header."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from scarfmt.cli.files import check_stdout, open_input, opens_index, print_json, timeout_option

if TYPE_CHECKING:
    from scarfmt.container.source import ByteSource

_HEAD_BYTES = 4096
"""Size of the first request to a URL, in bytes: larger than the longest header."""


@click.command(short_help="Report what a file holds.")
@click.argument("file")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object on stdout.")
@click.option("--metadata", is_flag=True, help="Also read and show the metadata the file carries.")
@click.option("--models", is_flag=True, help="Also report models of symbols: tables, predictors, networks.")
@click.option("--streaming", is_flag=True, help="Also report the data by which clients choose tiles to fetch first.")
@timeout_option
def inspect(file: str, as_json: bool, metadata: bool, models: bool, streaming: bool) -> None:
    """Report what FILE holds: counts, layers, and bytes of each kind of data.

    FILE is a path, a URL or - for stdin. The command reads only the header, at most 2.3 KB. From a URL that takes one
    request of 4 KiB. With --metadata, --models or --streaming it takes one request of 64 KiB, and more requests if
    those blocks lie further back. A truncated file is reported as truncated, which is not an error here. The last line
    names the engine that decodes on this machine.

    FILE may be a scene index. The command then reports what the index lists, and does not open the files.

    \b
    Examples:
      scarfmt inspect scene.scar
      scarfmt inspect https://example.org/scene.scar --metadata
      scarfmt inspect scene.scar --models
      scarfmt inspect scene.scar --json | jq '.layers[].end_offset'
    """
    from scarfmt.engines import absence, described
    from scarfmt.tools import inspection

    check_stdout()
    head_bytes = None if metadata or models or streaming else _HEAD_BYTES
    with open_input(file, head_bytes=head_bytes) as source:
        if opens_index(source):
            if head_bytes is None:
                raise click.UsageError("--metadata, --models and --streaming are for a file, not for an index")
            _inspect_index(source, as_json)
            return
        report = inspection.inspect(source, metadata=metadata)
        if models:
            from scarfmt.tools.models_report import describe_models

            report["models"] = describe_models(source)
        if streaming:
            from scarfmt.container.file import Container
            from scarfmt.tools.streaming_report import describe_streaming, format_streaming

            report["streaming"] = describe_streaming(Container.open(source, allow_truncated=True))
    report["engine"] = {"name": "kernel" if absence() is None else "numpy", "no_kernel": absence()}
    if as_json:
        print_json(report)
        return
    click.echo(inspection.format_text(report), nl=False)
    click.echo(f"{'engine':<17} {described()}, here")
    if models:
        from scarfmt.tools.models_report import format_models

        click.echo("\n" + format_models(report["models"]), nl=False)
    if streaming:
        click.echo("\n" + format_streaming(report["streaming"]), nl=False)


def _inspect_index(source: ByteSource, as_json: bool) -> None:
    from scarfmt.scene_index.address import read_index
    from scarfmt.scene_index.report import describe, format_text

    report = describe(read_index(source))
    if as_json:
        print_json(report)
    else:
        click.echo(format_text(report), nl=False)
