"""`scarfmt truncate`: keeps the first layers of a file."""

from __future__ import annotations

import click

from scarfmt.cli.files import open_input, open_output, timeout_option
from scarfmt.cli.report import Report, reports
from scarfmt.errors import plural


@click.command()
@click.argument("input_", metavar="INPUT")
@click.argument("output")
@click.option("--layers", type=click.IntRange(min=1), required=True, help="Layers to keep, from the first.")
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@timeout_option
@reports
def truncate(input_: str, output: str, layers: int, force: bool, quiet: bool) -> Report:
    """Keep only the first layers of INPUT (a path, a URL or -), without decoding it.

    OUTPUT is byte for byte the file an encoder would have written for those layers alone. INPUT may be an incomplete
    download, if those layers have arrived.

    \b
    Examples:
      scarfmt truncate scene.scar preview.scar --layers 1
      scarfmt truncate https://example.org/scene.scar small.scar --layers 2
      curl -s https://example.org/scene.scar | scarfmt truncate - - --layers 2 > small.scar
    """
    from scarfmt.tools.truncate import truncate_to

    with open_input(input_) as source, open_output(output, force) as target:
        size = truncate_to(source, layers, target)
    document = {"input": input_, "output": output, "layers": layers, "bytes": size, "input_bytes": source.size}
    return Report(document, f"{plural(layers, 'layer')}, {size:,} of {source.size:,} bytes")
