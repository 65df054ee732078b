"""`scarfmt convert`: from one scene format to another, without a .scar file in between."""

from __future__ import annotations

from typing import Any

import click

from scarfmt.cli.failures import requires_extra, warnings_on_stderr
from scarfmt.cli.inputs import FORMAT_IDS, read_scene
from scarfmt.cli.outputs import SUFFIXES, open_scene_output, output_format, output_options, report_written, spz_options


@click.command(short_help="Convert a scene between PLY, SPZ, glTF and others.")
@click.argument("input_", metavar="INPUT")
@click.argument("output")
@click.option("--from", "from_", type=click.Choice(FORMAT_IDS), help="Format of INPUT [default: from content].")
@click.option("--format", "format_id", type=click.Choice(list(SUFFIXES)), help="Format of OUTPUT [default: its name].")
@click.option("--sh-degree", type=click.IntRange(0, 3), help="Drop spherical harmonics above this degree.")
@click.option("--drop-invalid", is_flag=True, help="Leave out Gaussians with NaN or infinite values.")
@spz_options
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@requires_extra("import")
def convert(
    input_: str,
    output: str,
    from_: str | None,
    format_id: str | None,
    sh_degree: int | None,
    drop_invalid: bool,
    force: bool,
    quiet: bool,
    **said: Any,
) -> None:
    """Convert the scene INPUT into OUTPUT. Either may be - (stdin, stdout).

    INPUT is any format that 'encode' reads, except an anchor model, which has no fixed Gaussians. The whole scene is
    read into memory. OUTPUT is a .ply, .compressed.ply, .spz, .glb or .gltf. The command reports what the format of
    OUTPUT cannot hold. To convert a .scar file, use 'decode'.

    \b
    Examples:
      scarfmt convert scene.spz scene.glb
      scarfmt convert scene.ply scene.spz --spz-version 3
      scarfmt convert scene.glb scene.compressed.ply
    """
    format_id = output_format(output, format_id)
    options = output_options(format_id, said)
    from scarfmt.formats.output import Described
    from scarfmt.scene.gaussians import GaussianScene

    with warnings_on_stderr(quiet), open_scene_output(output, format_id, options, force) as out:
        scene = read_scene(input_, from_, sh_degree, drop_invalid, quiet)
        if not isinstance(scene, GaussianScene):
            raise click.UsageError("an anchor model has no fixed Gaussians: encode it, then decode with --bake")
        written = out.write(Described(scene.sh_degree), [scene])
        done = report_written(written, quiet)
    if not quiet:
        click.echo(done, err=True)
