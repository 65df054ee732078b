"""`scarfmt export`: the viewer and a scene in one page."""

from __future__ import annotations

from pathlib import PurePosixPath
from urllib.parse import urlsplit

import click

from scarfmt.cli.files import open_input, open_output, timeout_option
from scarfmt.cli.report import Report, reports


@click.command()
@click.argument("input_", metavar="INPUT")
@click.argument("output")
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@timeout_option
@reports
def export(input_: str, output: str, force: bool, quiet: bool) -> Report:
    """Write a page that shows INPUT (a path, a URL or -) by itself, from a disk or any server.

    OUTPUT is an HTML file with the viewer and the scene in it.

    \b
    Examples:
      scarfmt export scene.scar scene.html
    """
    from scarfmt.tools.inspection import inspect
    from scarfmt.viewer.embedded import write_page

    name = PurePosixPath(urlsplit(input_).path).name if input_ != "-" else "scene.scar"
    with open_input(input_) as source:
        inspect(source)
        with open_output(output, force) as target:
            size = write_page(source, name, target)
    return Report({"input": input_, "output": output, "bytes": size}, f"{size:,} bytes")
