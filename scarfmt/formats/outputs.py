"""The formats that scenes of Gaussians are written in. The table `OUTPUTS` is the one list of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import BinaryIO

from scarfmt.errors import InvalidInput
from scarfmt.formats.aside import Aside
from scarfmt.formats.export_compressed_ply import write_compressed_ply
from scarfmt.formats.export_gltf import Beside, write_gltf
from scarfmt.formats.export_ply import ply_header, ply_rows, property_names
from scarfmt.formats.export_spz import SpzOptions, write_spz
from scarfmt.formats.output import Described, Parts, Written


@dataclass(frozen=True)
class OutputOptions:
    """Choices that some formats leave to their writer.

    Attributes:
        spz: of SPZ.
        beside: where the buffer of a .gltf goes.
    """

    spz: SpzOptions = field(default_factory=SpzOptions)
    beside: Beside | None = None


@dataclass(frozen=True)
class Output:
    """One output format.

    Attributes:
        id: what `write_parts` and the command line call it.
        title: for people.
        suffix: of its files.
        write: writes parts of a scene.
    """

    id: str
    title: str
    suffix: str
    write: Callable[[Parts, Described, BinaryIO, OutputOptions], Written]


def write_parts(
    format_id: str, parts: Parts, described: Described, target: BinaryIO, options: OutputOptions | None = None
) -> Written:
    """Write a scene in memory that does not grow with it, but with the largest of its parts.

    What waits for its place lies in temporary files, together as large as the output.

    Args:
        format_id: id of an output.
        parts: of the scene, in order.
        described: what holds for all of them.
        target: where to.
        options: of the format.

    Raises:
        InvalidInput: ``output-format``: unknown; ``output-range``: values the format cannot hold; ``output-empty``: no
            Gaussians, for formats that have no empty scenes.
    """
    for known in OUTPUTS:
        if known.id == format_id:
            return known.write(parts, described, target, options or OutputOptions())
    names = ", ".join(known.id for known in OUTPUTS)
    raise InvalidInput("output-format", f"unknown output format {format_id!r}; there are {names}")


def _ply(parts: Parts, described: Described, target: BinaryIO, _options: OutputOptions) -> Written:
    count = 0
    with Aside(("rows",)) as aside:
        for part in parts:
            aside.add("rows", ply_rows(part))
            count += len(part)
        target.write(ply_header(count, property_names((described.sh_degree + 1) ** 2 - 1), ()))
        aside.copy("rows", target)
    return Written(count, ())


def _gltf(parts: Parts, described: Described, target: BinaryIO, options: OutputOptions) -> Written:
    if options.beside is None:
        raise InvalidInput("output-format", "a .gltf needs a place for its buffer; write a .glb")
    return write_gltf(parts, described, target, options.beside)


OUTPUTS = (
    Output(
        "compressed-ply",
        "PlayCanvas PLY",
        ".compressed.ply",
        lambda parts, described, target, _: write_compressed_ply(parts, described, target),
    ),
    Output("ply", "INRIA 3D Gaussian splatting PLY", ".ply", _ply),
    Output(
        "spz",
        "Niantic SPZ 3 and 4",
        ".spz",
        lambda parts, described, target, options: write_spz(parts, described, target, options.spz),
    ),
    Output(
        "glb",
        "binary glTF 2.0 with KHR_gaussian_splatting",
        ".glb",
        lambda parts, described, target, _: write_gltf(parts, described, target),
    ),
    Output("gltf", "glTF 2.0 with KHR_gaussian_splatting, its buffer beside it", ".gltf", _gltf),
)
