"""`scarfmt index`: makes one scene of several files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from scarfmt.cli.files import open_output


@click.command(short_help="List files as one scene.")
@click.argument("files", nargs=-1, required=True, type=click.Path(dir_okay=False))
@click.option("--output", "-o", required=True, help="The index, best named NAME.scar.json.")
@click.option("--transforms", type=click.Path(exists=True, dir_okay=False), help="JSON file that places the files.")
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
def index(files: tuple[str, ...], output: str, transforms: str | None, force: bool, quiet: bool) -> None:
    """Write an index that lists FILES as one scene, which 'inspect', 'decode', 'truncate', 'view' and 'validate' read.

    FILES are .scar files in the folder of the index or below it. The command reads the front of each file and decodes
    nothing. The files may differ in layers, profile and degree of spherical harmonics. They must have the same
    coordinate frame and colour space.

    --transforms is a JSON object. It maps the name of a file, relative to the index, to 4 rows of 4 numbers, which
    rotate, scale (all axes alike) and move the file. Files that are not named stay where they are.

    \b
    Examples:
      scarfmt index part-*.scar -o city.scar.json
      scarfmt index house.scar garden.scar -o scene.scar.json --transforms placed.json
    """
    from reference_decoder.scenes.making import make_index

    folder = Path(output).parent
    made = make_index([Path(file) for file in files], folder, None if transforms is None else _read(Path(transforms)))
    with open_output(output, force) as target:
        target.write(made.text())
    if not quiet:
        last = made.layer(made.layer_count)
        click.echo(f"{len(made.files):,} files, {last.gaussians:,} Gaussians, {last.end:,} bytes", err=True)


def _read(path: Path) -> dict[str, Any]:
    """The transforms of a file, by name.

    Raises:
        click.UsageError: it is no JSON object.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise click.UsageError(f"--transforms: {path} is not JSON: {error}") from error
    if not isinstance(found, dict):
        raise click.UsageError(f"--transforms: {path} is not a JSON object that maps file names to matrices")
    return found
