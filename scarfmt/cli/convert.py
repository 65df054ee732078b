"""`scarfmt convert`: from one scene format to another, without a .scar file in between."""

from __future__ import annotations

from functools import partial
from typing import Any

import click

from scarfmt.cli.failures import requires_extra, warnings_on_stderr
from scarfmt.cli.files import open_output
from scarfmt.cli.inputs import FORMAT_IDS, read_scene, render_model_option
from scarfmt.cli.outputs import SUFFIXES, output_format, output_options, report_written, spz_options
from scarfmt.cli.report import Report, reports


@click.command()
@click.argument("input_", metavar="INPUT")
@click.argument("output")
@click.option("--from", "from_", type=click.Choice(FORMAT_IDS), help="Format of INPUT [default: from content].")
@click.option("--format", "format_id", type=click.Choice(list(SUFFIXES)), help="Format of OUTPUT [default: its name].")
@click.option("--sh-degree", type=click.IntRange(0, 3), help="Drop spherical harmonics above this degree.")
@click.option("--drop-invalid", is_flag=True, help="Leave out Gaussians with NaN, and tell how many show.")
@render_model_option
@spz_options
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@reports
@requires_extra("import")
def convert(
    input_: str,
    output: str,
    from_: str | None,
    format_id: str | None,
    sh_degree: int | None,
    drop_invalid: bool,
    render_model: str | None,
    force: bool,
    quiet: bool,
    **said: Any,
) -> Report:
    """Convert the scene INPUT into OUTPUT. Either may be - (stdin, stdout).

    INPUT is any format that 'encode' reads, except an anchor model, which has no fixed Gaussians. The whole scene is
    read into memory. OUTPUT is a .ply, .compressed.ply, .spz, .glb, .gltf, .sog, .splat or .usdc. The command reports
    what the format of OUTPUT cannot hold. To convert a .scar file, use 'decode'.

    \b
    Examples:
      scarfmt convert scene.spz scene.glb
      scarfmt convert scene.ply scene.spz --spz-version 3
      scarfmt convert scene.glb scene.compressed.ply
    """
    format_id = output_format(output, format_id)
    options = output_options(format_id, said)
    from scarfmt.formats.output import Described
    from scarfmt.formats.outputs import open_targets, write_parts
    from scarfmt.scene.gaussians import GaussianScene

    opened = open_targets(output, format_id, options, partial(open_output, force=force))
    with warnings_on_stderr(quiet), opened as (target, options):
        scene = read_scene(input_, from_, sh_degree, drop_invalid, render_model)
        if not isinstance(scene, GaussianScene):
            raise click.UsageError("an anchor model has no fixed Gaussians: encode it, then decode with --bake")
        written = write_parts(format_id, [scene], Described.of(scene), target, options)
        return report_written((input_, output), written, {"format": format_id})
