"""`scarfmt inspect`: what a file holds, from its header."""

from __future__ import annotations

import click

from scarfmt.cli.files import open_input, print_json


@click.command(short_help="Tell what a file holds.")
@click.argument("file")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object on stdout.")
@click.option("--metadata", is_flag=True, help="Also read and show the metadata the file carries.")
@click.option("--models", is_flag=True, help="Also tell what codes the symbols: tables, predictors, networks.")
def inspect(file: str, as_json: bool, metadata: bool, models: bool) -> None:
    """Tell what FILE holds: counts, layers, and where the bytes go.

    FILE is a path, a URL or - for stdin. Only the header is read, 2 KB at most: of a URL, one small request. A file
    cut short is told as such; that is no error here.

    \b
    Examples:
      scarfmt inspect scene.scar
      scarfmt inspect https://example.org/scene.scar --metadata
      scarfmt inspect scene.scar --models
      scarfmt inspect scene.scar --json | jq '.layers[].end_offset'
    """
    from scarfmt.tools import inspection

    with open_input(file) as source:
        report = inspection.inspect(source, metadata=metadata)
        if models:
            from scarfmt.tools.models_report import describe_models

            report["models"] = describe_models(source)
    if as_json:
        print_json(report)
        return
    click.echo(inspection.format_text(report), nl=False)
    if models:
        from scarfmt.tools.models_report import format_models

        click.echo("\n" + format_models(report["models"]), nl=False)
