"""The formats that scenes of Gaussians are written in. The table `OUTPUTS` is the one list of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Union
from urllib.parse import quote

from scarfmt.errors import InvalidInput
from scarfmt.formats.output import Described, Parts, Written, move_near_zero

if TYPE_CHECKING:
    from scarfmt.formats.export_gltf import Beside
    from scarfmt.formats.spz import SpzOptions


OutputOptions = Union["SpzOptions", "Beside", None]
"""What some formats leave to their writer: numbers of SPZ, None for its defaults; where the buffer of a .gltf goes."""


@dataclass(frozen=True)
class Output:
    """One output format.

    Attributes:
        id: what `write_parts` and the command line call it.
        title: for people.
        suffix: of its files.
        module, function: of this package: what writes parts of a scene, loaded when it is first needed.
    """

    id: str
    title: str
    suffix: str
    module: str
    function: str


def write_parts(
    format_id: str, parts: Parts, described: Described, target: BinaryIO, options: OutputOptions = None
) -> Written:
    """Write a scene in memory that does not grow with it, but with the largest of its parts.

    What waits for its place lies in temporary files, together as large as the output. Where a scene lies so far from
    zero that float32 would lose what shows, an origin is subtracted from its positions.

    Raises:
        InvalidInput: ``output-format``: unknown; ``output-range``: values the format cannot hold; ``output-empty``: no
            Gaussians, for formats that have no empty scenes.
    """
    for known in OUTPUTS:
        if known.id == format_id:
            write = getattr(import_module(f"scarfmt.formats.{known.module}"), known.function)
            given = () if options is None else (options,)
            written: Written = write(*move_near_zero(parts, described), target, *given)
            return written
    names = ", ".join(known.id for known in OUTPUTS)
    raise InvalidInput("output-format", f"unknown output format {format_id!r}; there are {names}")


OUTPUTS = (
    Output("compressed-ply", "PlayCanvas PLY", ".compressed.ply", "compressed_ply", "write_compressed_ply"),
    Output("ply", "INRIA 3D Gaussian splatting PLY", ".ply", "export_ply", "write_ply"),
    Output("spz", "Niantic SPZ 3 and 4", ".spz", "spz", "write_spz"),
    Output("glb", "binary glTF 2.0 with KHR_gaussian_splatting", ".glb", "export_gltf", "write_gltf"),
    Output(
        "gltf",
        "glTF 2.0 with KHR_gaussian_splatting, its buffer beside it",
        ".gltf",
        "export_gltf",
        "write_gltf_beside",
    ),
    Output("sog", "PlayCanvas SOG 2, bundled", ".sog", "export_sog", "write_sog"),
    Output("splat", "antimatter15 .splat", ".splat", "splat", "write_splat"),
    Output("usd", "USD with ParticleField3DGaussianSplat", ".usdc", "usd", "write_usd"),
)


def output_of(name: str) -> Output:
    """The format that a file name ends in.

    Raises:
        InvalidInput: ``output-format``: none.
    """
    for known in sorted(OUTPUTS, key=lambda known: -len(known.suffix)):
        if name.lower().endswith(known.suffix):
            return known
    endings = ", ".join(known.suffix for known in OUTPUTS)
    raise InvalidInput("output-format", f"{name} ends in none of {endings}")


@contextmanager
def open_targets(
    name: str, format_id: str, options: OutputOptions, open_file: Callable[[str], AbstractContextManager[BinaryIO]]
) -> Iterator[tuple[BinaryIO, OutputOptions]]:
    """The file of a scene, and the options; of a .gltf, the file NAME.bin beside it. Both appear when complete."""
    if format_id != "gltf":
        with open_file(name) as target:
            yield target, options
        return
    from scarfmt.formats.export_gltf import Beside

    path = Path(name)
    buffer = path.with_name(f"{path.stem}.bin")
    # The buffer gets its name first: a .gltf never names what is not there.
    with open_file(name) as target, open_file(str(buffer)) as stream:
        yield target, Beside(quote(buffer.name), stream)
