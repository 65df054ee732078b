"""Reading trained scenes from the formats people have them in. The table `FORMATS` is the one list of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from scarfmt.container.source import read_bounded
from scarfmt.errors import InvalidInput
from scarfmt.formats import anchor_npz, compressed_ply, gltf, inria_ply, scaffold, sog, splat, spz, streamed_sog
from scarfmt.formats.anchor_npz import save_anchor_npz
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

__all__ = ["FORMATS", "MAX_PIPE_BYTES", "Format", "detect", "load", "save_anchor_npz"]

MAX_PIPE_BYTES = 1 << 33
"""Bytes of a scene taken from a pipe: 30 million Gaussians as a PLY."""


@dataclass(frozen=True)
class Format:
    """One input format.

    Attributes:
        id: what `load(format=...)` and the command line call it.
        title: for people.
        extensions: file name endings, lower case; used only where no content test matches.
        sniff: whether the content is of this format.
        load: reads it.
    """

    id: str
    title: str
    extensions: tuple[str, ...]
    sniff: Callable[[Source], bool]
    load: Callable[[Source], GaussianScene | AnchorModel]


FORMATS = (
    Format("compressed-ply", "PlayCanvas PLY", (".compressed.ply",), compressed_ply.sniff, compressed_ply.load),
    Format("scaffold", "Scaffold-GS folder", (), scaffold.sniff, scaffold.load),
    Format("ply", "INRIA 3D Gaussian splatting PLY", (".ply",), inria_ply.sniff, inria_ply.load),
    Format("spz", "Niantic SPZ 1 to 4", (".spz",), spz.sniff, spz.load),
    Format("gltf", "glTF 2.0 with KHR_gaussian_splatting", (".glb", ".gltf"), gltf.sniff, gltf.load),
    Format(
        "streamed-sog",
        "PlayCanvas streamed SOG, its finest level",
        ("lod-meta.json",),
        streamed_sog.sniff,
        streamed_sog.load,
    ),
    Format("sog", "PlayCanvas SOG 1 and 2, bundled or meta.json", (".sog", "meta.json"), sog.sniff, sog.load),
    Format("anchor-npz", "Scaffold-GS style anchor model", (".npz",), anchor_npz.sniff, anchor_npz.load),
    Format("splat", "antimatter15 .splat", (".splat",), splat.sniff, splat.load),
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
    source = _source(path_or_bytes)
    return _named(format).load(source) if format is not None else detect(source).load(source)


def detect(source: Source) -> Format:
    """The format of an input, by content and then by file name.

    Raises:
        InvalidInput: none matches (refusal `input-format`).
    """
    for candidate in FORMATS:
        if candidate.sniff(source):
            return candidate
    name = source.file_name.lower()
    for candidate in FORMATS:
        if name.endswith(candidate.extensions):
            return candidate
    hint = "" if name else " (.splat content has no mark: give its format)"
    raise InvalidInput("input-format", f"{source.name}: unknown format{hint}; supported: {_supported()}")


def _source(path_or_bytes: str | PathLike[str] | bytes) -> Source:
    if isinstance(path_or_bytes, bytes):
        return Source(path_or_bytes)
    path = Path(path_or_bytes)
    if path.is_fifo():
        with path.open("rb") as pipe:
            return Source(read_bounded(pipe, str(path), MAX_PIPE_BYTES))
    return Source(_index_of(path) if path.is_dir() else path)


def _index_of(directory: Path) -> Path:
    """The file to begin with in a directory that holds a SOG or a Scaffold-GS model."""
    streamed = directory / streamed_sog.INDEX
    if streamed.exists():
        return streamed
    return scaffold.points_of(directory) or directory / "meta.json"


def _named(format_id: str) -> Format:
    for candidate in FORMATS:
        if candidate.id == format_id:
            return candidate
    raise InvalidInput("input-format", f"unknown format {format_id!r}; supported: {_supported()}")


def _supported() -> str:
    return ", ".join(f"{known.id} ({known.title})" for known in FORMATS)
