"""`scarfmt truncate`: a smaller file of the first layers."""

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

    OUTPUT is byte for byte the file an encoder would have written for those layers alone. INPUT may be a file whose
    download broke off, if those layers had arrived.

    Of a scene index all files are cut. OUTPUT is the new index, ending in .json, or a folder for it; the files lie
    beside it as those of INPUT do. A file that has fewer layers keeps them all.

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
    """Cut the files of an index; returns their bytes, and those there were."""
    from scarfmt.scene_index.cutting import truncate_scene

    scene = open_index(name, source)
    target = Path(output)
    if target.is_dir() or target.suffix != ".json":
        target = target / PurePosixPath(urlsplit(name).path if "://" in name else Path(name).as_posix()).name
    cut = truncate_scene(scene, layers, target, force=force)
    return cut.layer(layers).end, scene.index.layer(scene.index.layer_count).end
