"""`scarfmt merge`: joins files that hold parts of one scene."""

from __future__ import annotations

from contextlib import ExitStack

import click

from scarfmt.cli.files import open_input, open_output, timeout_option
from scarfmt.cli.report import Report, reports
from scarfmt.errors import plural


@click.command()
@click.argument("inputs", metavar="INPUT...", nargs=-1, required=True)
@click.option("--output", "-o", metavar="OUTPUT", required=True, help="The file to write, or - for standard output.")
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@timeout_option
@reports
def merge(inputs: tuple[str, ...], output: str, force: bool, quiet: bool) -> Report:
    """Join files that hold parts of one scene (paths or URLs), without decoding them.

    The files must have the same models and lattice, and no tile in common. Files made by `scarfmt split` fit
    together. The order of the files does not matter.

    \b
    Examples:
      scarfmt merge part-1.scar part-2.scar -o scene.scar
      scarfmt merge https://example.org/part-1.scar part-2.scar -o - > scene.scar
    """
    from scarfmt.tools.merge import merge_to

    with ExitStack() as stack:
        sources = [stack.enter_context(open_input(name)) for name in inputs]
        size = merge_to(sources, stack.enter_context(open_output(output, force)))
    document = {"inputs": inputs, "output": output, "bytes": size}
    return Report(document, f"{plural(len(inputs), 'file')}, {size:,} bytes")
