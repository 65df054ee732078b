"""All files of a scene cut to their first layers, and the index of what is left (R-17-12)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from scarfmt.atomic import atomic_write
from scarfmt.container.header import read_header
from scarfmt.container.source import FileSource
from scarfmt.errors import InvalidInput
from scarfmt.scene_index.address import SceneFiles, beside, header_crc32
from scarfmt.scene_index.document import Index, ListedFile, ListedLayer
from scarfmt.tools.truncate import truncate_to


def truncate_scene(scene: SceneFiles, layers: int, target: Path, *, force: bool = False) -> Index:
    """Write an index of the first `layers` layers at `target`, and its files beside it, under the names they have.

    The index comes last: while it is not there, nothing is.

    Args:
        scene: what to cut.
        layers: to keep, from the first; a file that has fewer keeps all.
        target: path of the index.
        force: overwrite what is there.

    Returns:
        The index written.

    Raises:
        InvalidInput: ``input-layers`` when no file has so many; ``output-exists``, ``output-path``.
        Malformed, Truncated, Unsupported, LimitExceeded: a file is refused.
    """
    if not 1 <= layers <= scene.index.layer_count:
        message = f"{layers} of the {scene.index.layer_count} layers of the scene"
        raise InvalidInput("input-layers", message, field="layers")
    if target.exists() and not force:
        raise InvalidInput("output-exists", f"{target} exists; choose another name, or use force to overwrite it")
    files = tuple(_cut(scene, number, layers, target, force) for number in range(len(scene)))
    index = replace(scene.index, files=files)
    with atomic_write(target, force=force) as stream:
        stream.write(index.text())
    return index


def _cut(scene: SceneFiles, number: int, layers: int, target: Path, force: bool) -> ListedFile:
    listed = scene.index.files[number]
    path = Path(beside(target, listed.uri))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput("output-path", f"cannot make {path.parent}: {error.strerror}") from error
    with scene.opened(number) as source, atomic_write(path, force=force) as stream:
        truncate_to(source, min(layers, len(listed.layers)), stream, limits=scene.limits)
    with FileSource(path) as written:
        header = read_header(written, limits=scene.limits)
        return replace(
            listed,
            length=header.file_length,
            header_crc32=header_crc32(written, header.header_length),
            layers=tuple(ListedLayer(one.end_offset, one.anchor_count, one.gaussian_count) for one in header.layers),
        )
