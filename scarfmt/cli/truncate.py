"""`scarfmt truncate`: a smaller file of the first layers."""

from __future__ import annotations

import click

from scarfmt.cli.files import open_input, open_output, timeout_option


@click.command(short_help="Keep only the first layers of a file.")
@click.argument("input_", metavar="INPUT")
@click.argument("output")
@click.option("--layers", type=click.IntRange(min=1), required=True, help="Layers to keep, from the first.")
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@timeout_option
def truncate(input_: str, output: str, layers: int, force: bool, quiet: bool) -> None:
    """Keep only the first layers of INPUT (a path, a URL or -), without decoding it.

    OUTPUT is byte for byte the file an encoder would have written for those layers alone. INPUT may be a file whose
    download broke off, if those layers had arrived.

    \b
    Examples:
      scarfmt truncate scene.scar preview.scar --layers 1
      scarfmt truncate https://example.org/scene.scar small.scar --layers 2
      curl -s https://example.org/scene.scar | scarfmt truncate - - --layers 2 > small.scar
    """
    from scarfmt.tools.truncate import truncate_to

    with open_input(input_) as source, open_output(output, force) as target:
        size = truncate_to(source, layers, target)
        total = source.size
    if not quiet:
        click.echo(f"{layers} layers, {size:,} of {total:,} bytes", err=True)
