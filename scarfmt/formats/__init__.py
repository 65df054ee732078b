"""Reading trained scenes from the formats people have them in. The table `FORMATS` is the one list of them."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, replace
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

from scarfmt.container.source import read_bounded
from scarfmt.errors import InvalidInput
from scarfmt.formats.packed import is_packed, kind_of, unpack
from scarfmt.formats.source import Source
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

__all__ = ["FORMATS", "MAX_PIPE_BYTES", "Format", "detect", "find", "load", "stem"]

MAX_PIPE_BYTES = 1 << 33
"""Bytes of a scene taken from a pipe: 30 million Gaussians as a PLY."""

_ADDRESS = re.compile(r"(https?|ftp|s3|gs):/+")
"""How an address of the web begins; paths lose the second slash."""


@dataclass(frozen=True)
class Format:
    """One input format.

    Attributes:
        id: what `load(format=...)` and the command line call it.
        title: for people.
        extensions: file name endings, lower case; used only where no content test matches.
        module: of this package, loaded when it is first needed: `sniff` and `load`, and `describe` for formats that can
            say anything about a scene.
    """

    id: str
    title: str
    extensions: tuple[str, ...]
    module: str

    @property
    def importer(self) -> Any:
        """Its module."""
        return import_module(f"{__name__}.{self.module}")

    def describe(self, source: Source) -> Description:
        """Read what a file says about the scene, from little of it."""
        importer = self.importer
        return importer.describe(source) if hasattr(importer, "describe") else Description()


FORMATS = (
    Format("compressed-ply", "PlayCanvas PLY", (".compressed.ply",), "compressed_ply"),
    Format("scaffold", "Scaffold-GS folder", (), "scaffold"),
    Format("ply", "INRIA 3D Gaussian splatting PLY", (".ply",), "inria_ply"),
    Format("spz", "Niantic SPZ 1 to 4", (".spz",), "spz"),
    Format("streamed-sog", "PlayCanvas streamed SOG, its finest level", ("lod-meta.json", ".ssog"), "streamed_sog"),
    Format("supersplat", "SuperSplat project", (".ssproj",), "supersplat"),
    Format("sog", "PlayCanvas SOG 1 and 2, bundled or meta.json", (".sog", "meta.json"), "sog"),
    Format("gltf", "glTF 2.0 with KHR_gaussian_splatting", (".glb", ".gltf"), "gltf"),
    Format("usd", "USD with ParticleField3DGaussianSplat", (".usd", ".usda", ".usdc", ".usdz"), "usd"),
    Format("anchor-npz", "Scaffold-GS style anchor model", (".npz",), "anchor_npz"),
    Format("rad", "Spark .rad 1, the leaves of its tree", (".rad",), "rad"),
    Format("ksplat", "GaussianSplats3D .ksplat", (".ksplat",), "ksplat"),
    Format("splat", "antimatter15 .splat", (".splat",), "splat"),
)


def load(path_or_bytes: str | PathLike[str] | bytes, *, format: str | None = None) -> GaussianScene | AnchorModel:
    """Read a scene in any supported format.

    Values are as stored: nothing is clamped, and NaN and infinities are kept (see `scarfmt.formats.clean`).

    Args:
        path_or_bytes: a file, a pipe, a directory holding an unbundled or streamed SOG or a Scaffold-GS model, or the
            content of a file.
        format: id of the format; by default the content decides, then the file name.

    Returns:
        A GaussianScene, or an AnchorModel for an anchor model.

    Raises:
        InvalidInput: unknown format (refusal `input-format`), unreadable or damaged.
        Unsupported: a newer version of a known format.
        LimitExceeded: more Gaussians than any scene has, or a pipe that does not end (refusal `input-limit`).
    """
    source, found = find(path_or_bytes, format)
    scene: GaussianScene | AnchorModel = found.importer.load(source)
    return replace(scene, description=found.describe(source)) if isinstance(scene, GaussianScene) else scene


def find(path_or_bytes: str | PathLike[str] | bytes, format: str | None = None) -> tuple[Source, Format]:
    """The bytes of a scene, unpacked where an archive holds it, and their format; errors as of :func:`load`."""
    source = _source(path_or_bytes)
    if format is None and is_packed(source) and _by_content(source) is None:
        source = unpack(source)
    return source, detect(source) if format is None else _find(format)


def detect(source: Source) -> Format:
    """The format of an input, by content and then by file name.

    Raises:
        InvalidInput: none matches (refusal `input-format`).
    """
    found = _by_content(source)
    if found is not None:
        return found
    kind, name = kind_of(source), source.file_name.lower()
    for candidate in FORMATS:
        if name.endswith(candidate.extensions) and not kind:
            return candidate
    if kind:
        raise InvalidInput("input-format", f"{source.name}: {kind}")
    hint = "" if name else " (.splat content has no mark: give its format)"
    raise InvalidInput("input-format", f"{source.name}: unknown format{hint}; supported: {_list_supported()}")


def stem(name: str) -> str:
    """The name of a scene: its file without the ending, or its folder where the file has the name of a format."""
    path = Path(name)
    endings = (ending for known in FORMATS for ending in known.extensions if path.name.lower().endswith(ending))
    ending = next(endings, path.suffix)
    return path.name[: len(path.name) - len(ending)] or path.absolute().parent.name


def _by_content(source: Source) -> Format | None:
    return next((candidate for candidate in FORMATS if candidate.importer.sniff(source)), None)


def _source(path_or_bytes: str | PathLike[str] | bytes) -> Source:
    if isinstance(path_or_bytes, bytes):
        return Source(path_or_bytes)
    path = Path(path_or_bytes)
    if _ADDRESS.match(str(path)) and not path.exists():
        address = _ADDRESS.sub(r"\1://", str(path))
        raise InvalidInput("input-unreadable", f"{address}: scenes are read from files; download it, and give the file")
    if path.is_fifo():
        with path.open("rb") as pipe:
            return Source(read_bounded(pipe, str(path), MAX_PIPE_BYTES))
    return Source(_index_of(path) if path.is_dir() else path)


def _index_of(directory: Path) -> Path:
    """The file to begin with in a directory that holds a SOG or a Scaffold-GS model."""
    from scarfmt.formats import scaffold, streamed_sog

    streamed = directory / streamed_sog.INDEX
    if streamed.exists():
        return streamed
    found = scaffold.points_of(directory) or directory / "meta.json"
    if not os.path.lexists(found):
        message = f"{directory} is a folder without meta.json (SOG), lod-meta.json or point_cloud.ply (Scaffold-GS)"
        endings = tuple(ending for known in FORMATS for ending in known.extensions)
        if scenes := sorted(path.name for path in directory.iterdir() if path.name.lower().endswith(endings)):
            message += f"; give a scene in it, such as {scenes[0]}"
        raise InvalidInput("input-folder", message)
    return found


def _find(format_id: str) -> Format:
    for candidate in FORMATS:
        if candidate.id == format_id:
            return candidate
    raise InvalidInput("input-format", f"unknown format {format_id!r}; supported: {_list_supported()}")


def _list_supported() -> str:
    return ", ".join(f"{known.id} ({known.title})" for known in FORMATS)
