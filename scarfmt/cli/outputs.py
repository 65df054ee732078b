"""Scene files that commands write: the formats to choose from, their options, and what is reported."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from scarfmt.cli.files import STANDARD
from scarfmt.cli.options import with_options
from scarfmt.cli.report import Report
from scarfmt.errors import InputWarning, plural

if TYPE_CHECKING:
    from scarfmt.formats.output import Written
    from scarfmt.formats.outputs import OutputOptions

SUFFIXES = {
    "compressed-ply": ".compressed.ply",
    "ply": ".ply",
    "spz": ".spz",
    "glb": ".glb",
    "gltf": ".gltf",
    "sog": ".sog",
    "splat": ".splat",
    "usd": ".usdc",
}
"""Endings of file names by id of the format, longer ones first."""

spz_options = with_options(
    click.option("--spz-version", type=click.IntRange(3, 4), help="For .spz: 3 (gzip) or 4 (zstd) [default: 4]."),
    click.option(
        "--spz-fraction-bits",
        type=click.IntRange(0, 24),
        metavar="N",
        help="For .spz: positions are multiples of 2^-N [default: the largest N that holds all positions].",
    ),
    click.option(
        "--spz-sh-bits",
        type=click.IntRange(1, 8),
        nargs=2,
        metavar="A B",
        help="For .spz: bits of spherical harmonics, of degree 1 and of higher degrees [default: 5 4].",
    ),
)
"""What :func:`output_options` reads."""


def output_options(format_id: str, said: dict[str, Any]) -> OutputOptions:
    """The options of `spz_options`, which are taken out of `said`.

    Raises:
        click.UsageError: one was given for another format.
    """
    names = ("version", "fraction_bits", "sh_bits")
    given = {name: value for name in names if (value := said.pop(f"spz_{name}")) not in (None, ())}
    if given and format_id != "spz":
        raise click.UsageError("--spz-version, --spz-fraction-bits and --spz-sh-bits are for an .spz output")
    if not given:
        return None
    from scarfmt.formats.spz import SpzOptions

    return SpzOptions(**given)


def output_format(name: str, chosen: str | None, others: tuple[str, ...] = ()) -> str:
    """The format to write: as chosen, or by the file name, or for standard output a PLY.

    Args:
        chosen: id, or None.
        others: endings of formats that are no scenes of Gaussians; such an ending without its dot is the id.

    Raises:
        click.UsageError: the name ends in none that is known, or a .gltf was chosen for standard output.
    """
    if name == STANDARD and chosen == "gltf":
        raise click.UsageError("a .gltf is two files: give a file name, or write a .glb")
    if chosen is not None:
        return chosen
    if name == STANDARD:
        return "ply"
    known = {**SUFFIXES, **{ending[1:]: ending for ending in others}}
    for format_id, ending in known.items():
        if name.lower().endswith(ending):
            return format_id
    endings = ", ".join(known.values())
    raise click.UsageError(f"the output must end in one of {endings}, or give --format; {name} does not")


def report_written(names: tuple[str, str], written: Written, more: Mapping[str, Any], *lines: str) -> Report:
    """The report of a command that wrote a scene; what the format could not hold is a warning each.

    Args:
        lines: for people, besides the count.
    """
    for note in written.notes:
        warnings.warn(note, InputWarning, stacklevel=2)
    document = {"input": names[0], "output": names[1], "count": written.count, "notes": written.notes, **more}
    return Report(document, "\n".join([plural(written.count, written.unit), *lines]))
