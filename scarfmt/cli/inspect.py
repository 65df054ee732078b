"""`scarfmt inspect`: what a file holds, from its header."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from scarfmt.cli.files import check_stdout, open_input, opens_index, print_json, timeout_option

if TYPE_CHECKING:
    from scarfmt.container.source import ByteSource

_HEAD_BYTES = 4096
"""First request to a URL: more than the longest header."""


@click.command(short_help="Report what a file holds.")
@click.argument("file")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object on stdout.")
@click.option("--metadata", is_flag=True, help="Also read and show the metadata the file carries.")
@click.option("--models", is_flag=True, help="Also report what codes the symbols: tables, predictors, networks.")
@click.option("--streaming", is_flag=True, help="Also report what tells a client which tiles to fetch first.")
@timeout_option
def inspect(file: str, as_json: bool, metadata: bool, models: bool, streaming: bool) -> None:
    """Report what FILE holds: counts, layers, and where the bytes go.

    FILE is a path, a URL or - for stdin. Only the header is read, at most 2.3 KB. Of a URL that is one request of
    4 KiB; with --metadata, --models or --streaming it is one of 64 KiB, and more where those blocks lie further back. A
    file cut short is reported as such, which is no error here. The last line of what the header says is the engine that
    decodes on this machine.

    Of a scene index what it tells of its files is reported: they are not opened.

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
