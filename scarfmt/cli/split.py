"""`scarfmt split`: cuts a file into several, each with some of its tiles."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scarfmt.cli.decode import parse_box
from scarfmt.cli.files import STANDARD, open_input, open_output, timeout_option
from scarfmt.cli.report import Report, reports
from scarfmt.errors import plural

if TYPE_CHECKING:
    from reference_decoder.decode import Box
    from scarfmt.arrays import I64
    from scarfmt.container.file import Container


@click.command()
@click.argument("input_", metavar="INPUT")
@click.argument("output")
@click.option("--files", type=click.IntRange(min=2), metavar="N", help="Write N files of about equal size.")
@click.option("--box", metavar="X0,Y0,Z0,X1,Y1,Z1", type=parse_box,
              help="Write the tiles that meet this box into OUTPUT.")  # fmt: skip
@click.option("--rest", metavar="FILE", help="With --box: write all other tiles into FILE.")
@click.option("--force", is_flag=True, help="Overwrite files that exist.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
@timeout_option
@reports
def split(
    input_: str, output: str, files: int | None, box: Box | None, rest: str | None, force: bool, quiet: bool
) -> Report:
    """Cut INPUT (a path or a URL) into files of whole tiles, without decoding it.

    With --files, the name OUTPUT is numbered: part.scar becomes part-1.scar, part-2.scar and so on. Each file covers a
    part of space and can be decoded by itself. `scarfmt merge` joins the files again.

    \b
    Examples:
      scarfmt split city.scar district.scar --files 4
      scarfmt split city.scar centre.scar --box -50,-50,-10,50,50,40 --rest suburbs.scar
    """
    from scarfmt.container.file import Container
    from scarfmt.tools.split import even_parts, split_to

    _check(output, files, box, rest)
    with ExitStack() as stack:
        source = stack.enter_context(open_input(input_))
        container = Container(source)
        names = [output, *([rest] if rest else [])] if files is None else _number(output, files)
        targets = [stack.enter_context(open_output(name, force)) for name in names]
        if files is not None:
            parts = even_parts(container, files)
        else:
            assert box is not None
            parts = _inside_and_outside(container, box)[: len(names)]
        sizes = split_to(source, parts, targets)
    made = list(zip(names, map(len, parts), sizes, strict=True))
    rows = [{"output": name, "tiles": tiles, "bytes": size} for name, tiles, size in made]
    lines = [f"{name}: {plural(tiles, 'tile')}, {size:,} bytes" for name, tiles, size in made]
    return Report({"input": input_, "files": rows}, "\n".join(lines))


def _check(output: str, files: int | None, box: Box | None, rest: str | None) -> None:
    if (files is None) == (box is None):
        raise click.UsageError("give either --files or --box")
    if rest is not None and box is None:
        raise click.UsageError("--rest needs --box")
    if files is not None and output == STANDARD:
        raise click.UsageError("--files writes several files: give OUTPUT a file name, not -")


def _number(name: str, files: int) -> list[str]:
    path = Path(name)
    return [str(path.with_name(f"{path.stem}-{number}{path.suffix}")) for number in range(1, files + 1)]


def _inside_and_outside(container: Container, box: Box) -> list[I64]:
    """Tiles that meet a box, and those that do not.

    Raises:
        InvalidInput: ``input-box``: none meets it, or all do.
    """
    import numpy as np

    from reference_decoder.decode import DecodeRequest
    from reference_decoder.region import tile_boxes
    from scarfmt.errors import InvalidInput
    from scarfmt.scene.model import Lattice

    corners = DecodeRequest(box=box).corners()
    assert corners is not None
    fields = container.header.fields
    low, high = tile_boxes(Lattice(fields.origin, fields.voxel, fields.lattice_bits), container.tile_table)
    meets = ((low <= corners[1]) & (high >= corners[0])).all(axis=1)
    if meets.all() or not meets.any():
        found = "no tile meets" if not meets.any() else "all tiles meet"
        raise InvalidInput("input-box", f"{found} the box, so there is nothing to split", field="box")
    return [np.flatnonzero(meets), np.flatnonzero(~meets)]
