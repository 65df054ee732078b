"""Inputs that are no scene: packed ones are unpacked, others are named."""

from __future__ import annotations

import zlib
from pathlib import PurePosixPath

from scarfmt.container.schema import SIGNATURE
from scarfmt.errors import InvalidInput, LimitExceeded
from scarfmt.formats.source import (
    BYTES_PER_BYTE,
    FREE_BYTES,
    GZIP,
    Archive,
    Source,
    gunzip,
    is_zip,
    member_names,
    open_archive,
)

_SCENES = (".ply", ".spz", ".splat", ".ksplat", ".sog", ".glb", ".gltf", ".rad", ".usd", ".usda", ".usdc", ".usdz")
_PARTS = (".bin", ".radc")
"""Files beside a scene that it may name: buffers of glTF, chunks of Spark's .rad."""
_PAGE = "a web page or XML; download the file itself"
_KINDS = (
    (SIGNATURE, "a .scar file; use 'scarfmt decode'"),
    (b"RADC", "a chunk of Spark's .rad; give the .rad beside it"),
    (b"7z\xbc\xaf", "a 7z archive; unpack it"),
    (b"Rar!", "a RAR archive; unpack it"),
    (b"\xfd7zXZ", "packed by xz; unpack it"),
    (b"BZh", "packed by bzip2; unpack it"),
    (b"\x28\xb5\x2f\xfd", "packed by zstd; unpack it"),
    (b"PK\x05\x06", "an empty ZIP archive"),
    (b"version https://git-lfs", "a pointer of Git LFS; run 'git lfs pull'"),
    (b"b3dm", "a tile of meshes; give a .glb with Gaussians"),
    (b"LASF", "a LAS point cloud without Gaussians; give a trained scene"),
    (b"ASTM-E57", "an E57 point cloud without Gaussians; give a trained scene"),
    (b"# .pcd", "a PCD point cloud without Gaussians; give a trained scene"),
    (b"spx", "a scene of Reall3dViewer, .spx; convert it to .spz with gsbox"),
    (b"Kg\0\0", "a moving scene, .splatv; export one moment as a PLY"),
    (b"\x80\x02", "a pickle, such as an old checkpoint of PyTorch; export the scene from its trainer as a PLY"),
    (b"RIFF", "a picture; of a SOG, give its meta.json"),
    (b"\x89PNG", "a picture"),
    (b"\xff\xd8\xff", "a picture"),
    (b"<!doctype html", _PAGE),
    (b"<html", _PAGE),
    (b"<?xml", _PAGE),
)
"""How content begins, in lower case or as it is, what it is and what helps."""

_TAR = slice(257, 262)
"""Where a tar archive has its mark."""
_DOCUMENTS = (
    ({"asset", "geometricError", "root"}, "a tileset of 3D Tiles; give one of the .glb files it names"),
    ({"totalSplats"}, "a scene of XGRIDS, .lcc or .lcc2; export it as a PLY"),
    ({"means", "opacities"}, "the output of gsplat's PngCompression; decompress it there, and export it as a PLY"),
    ({"frames"}, "a list of cameras, no scene; give it to --cameras"),
)
"""Members that JSON documents have, what they are and what helps."""


def unpack(source: Source) -> Source:
    """The content of a gzip file, or the only scene of a ZIP archive.

    Raises:
        InvalidInput: damaged; ``input-format``: none or several scenes in the archive.
        LimitExceeded: ``input-limit``: it unpacks to more than a scene would.
    """
    if source.head(2) == GZIP:
        return Source(_inflate(source), source.name.removesuffix(".gz"))
    with open_archive(source) as archive:
        names = member_names(source)
        scenes = [name for name in names if name.lower().endswith(_SCENES)]
        if len(scenes) != 1:
            raise InvalidInput("input-format", f"{source.name}: a ZIP archive with {_contents(names, scenes)}")
        return Source(archive.read(scenes[0]), f"{source.name}/{scenes[0]}", _parts(archive, names, scenes[0]))


def _parts(archive: Archive, names: tuple[str, ...], scene: str) -> dict[PurePosixPath, bytes]:
    """Content of the files that a scene may name, by their path from its folder."""
    folder = PurePosixPath(scene).parent
    paths = {PurePosixPath(name): name for name in names if name.lower().endswith(_PARTS)}
    return {path.relative_to(folder): archive.read(paths[path]) for path in paths if path.is_relative_to(folder)}


def is_packed(source: Source) -> bool:
    """Whether the content is gzip or a ZIP archive; some formats are, too."""
    return source.head(2) == GZIP or is_zip(source)


def kind_of(source: Source) -> str:
    """What an unknown input is, for people; empty where nothing is known of it."""
    head = source.head(64).lstrip()
    if not source.size:
        return "an empty file"
    if source.head(_TAR.stop)[_TAR] == b"ustar":
        return "a tar archive; unpack it"
    if source.document is not None:
        members = source.document.keys()
        return next((kind for needed, kind in _DOCUMENTS if needed <= members), "")
    return next((kind for start, kind in _KINDS if start in (head[: len(start)], head[: len(start)].lower())), "")


def _contents(names: tuple[str, ...], scenes: list[str]) -> str:
    if scenes:
        return f"{len(scenes)} scenes, {', '.join(scenes[:3])}; unpack it, and give one"
    if any(name.endswith("data.pkl") for name in names):
        return "a checkpoint of PyTorch; export the scene from its trainer as a PLY"
    if any(name.endswith(".npy") for name in names):
        return "arrays of NumPy; make a scarfmt.GaussianScene of them, or export the scene as a PLY"
    return f"no scene in it: {', '.join(names[:3]) or 'nothing'}; expected one of {', '.join(_SCENES)}"


def _inflate(source: Source) -> bytes:
    most = FREE_BYTES + BYTES_PER_BYTE * source.size
    try:
        with source.open() as stream:
            data, is_all = gunzip(stream, most)
    except zlib.error as error:
        raise source.corrupt(f"damaged gzip stream ({error})") from error
    if len(data) > most:
        message = f"{source.name}: {source.size} bytes that unpack to more than those of a scene would"
        raise LimitExceeded("input-limit", message)
    if not is_all:
        raise source.corrupt("the gzip stream is cut short")
    return data
