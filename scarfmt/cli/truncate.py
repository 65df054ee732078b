"""`scarfmt truncate`: keeps the first layers of a file."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import click

from scarfmt.cli.files import open_index, open_input, open_output, opens_index, timeout_option

if TYPE_CHECKING:
    from scarfmt.container.source import ByteSource


@click.command(short_help="Keep only the first layers of a file.")
@click.argument("input_", metavar="INPUT")
@click.argument("output")
@click.option("--layers", type=click.IntRange(min=1), required=True, help="Layers to keep, from the first.")
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@timeout_option
def truncate(input_: str, output: str, layers: int, force: bool, quiet: bool) -> None:
    """Keep only the first layers of INPUT (a path, a URL or -), without decoding it.

    OUTPUT is byte for byte the file an encoder would have written for those layers alone. INPUT may be an incomplete
    download, if those layers have arrived.

    INPUT may be a scene index. All of its files are then cut. OUTPUT is the new index, whose name ends in .json, or a
    folder for it. The new files lie beside the new index as the old files lie beside INPUT. A file that has fewer
    layers keeps all of them.

    \b
    Examples:
      scarfmt truncate scene.scar preview.scar --layers 1
      scarfmt truncate https://example.org/scene.scar small.scar --layers 2
      scarfmt truncate city.scar.json preview/ --layers 1
      curl -s https://example.org/scene.scar | scarfmt truncate - - --layers 2 > small.scar
    """
    from scarfmt.tools.truncate import truncate_to

    with open_input(input_) as source:
        if opens_index(source):
            size, total = _truncate_index(input_, source, output, layers, force)
        else:
            with open_output(output, force) as target:
                size, total = truncate_to(source, layers, target), source.size
    if not quiet:
        click.echo(f"{layers} layers, {size:,} of {total:,} bytes", err=True)


def _truncate_index(name: str, source: ByteSource, output: str, layers: int, force: bool) -> tuple[int, int]:
    """Cut the files of an index; returns the bytes of the new files and of the old ones."""
    from scarfmt.scene_index.cutting import truncate_scene

    scene = open_index(name, source)
    target = Path(output)
    if target.is_dir() or target.suffix != ".json":
        target = target / PurePosixPath(urlsplit(name).path if "://" in name else Path(name).as_posix()).name
    cut = truncate_scene(scene, layers, target, force=force)
    return cut.layer(layers).end, scene.index.layer(scene.index.layer_count).end
