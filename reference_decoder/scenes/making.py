"""Entries of a scene index, and an index of several files, made from their fronts alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from reference_decoder.dequantise import tile_boxes
from scarfmt.coding.reader import SceneReader
from scarfmt.container.source import ByteSource, FileSource
from scarfmt.errors import InvalidInput, Malformed
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.scene.placement import Placement
from scarfmt.scene_index.address import header_crc32, naming, uri_of
from scarfmt.scene_index.document import Index, ListedFile, ListedLayer, check_uri

Rows = Sequence[Sequence[float]]
"""A 4 x 4 matrix by rows."""


def listed_file(reader: SceneReader, source: ByteSource, uri: str, transform: Rows | None = None) -> ListedFile:
    """The index entry of a file. Its box is that of its tiles, which no anchor leaves.

    Args:
        reader: of the file.
        source: the file.
        uri: of the file.
        transform: where it is placed; None for nowhere else.
    """
    header = reader.header
    low, high = tile_boxes(reader.lattice, reader.container.tile_table)
    origin = header.fields.origin
    return ListedFile(
        uri,
        header.file_length,
        header_crc32(source, header.header_length),
        header.fields.profile,
        header.fields.sh_degree,
        header.fields.slots,
        tuple(low.min(axis=0).tolist()) if len(low) else origin,
        tuple(high.max(axis=0).tolist()) if len(high) else origin,
        tuple(ListedLayer(one.end_offset, one.anchor_count, one.gaussian_count) for one in header.layers),
        None if transform is None else tuple(tuple(map(float, row)) for row in transform),
    )


def make_index(
    paths: Sequence[Path],
    folder: Path,
    transforms: Mapping[str, Rows] | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> Index:
    """An index of files.

    Args:
        paths: the files, in the order of the scene; one at least.
        folder: where the index will be; the files are in it or below.
        transforms: where files are placed, by uri; the others stay where they are.
        limits: what to accept of each file.

    Raises:
        InvalidInput: ``input-scene``: a file is elsewhere, has a name that an index cannot hold, comes twice, has
            another coordinate frame or colour space than the first, or a transform is none or of no file;
            ``input-source``.
        Malformed, Unsupported, LimitExceeded: a file is refused (SPEC §12).
    """
    transforms = transforms or {}
    uris = [_checked_uri(path, folder) for path in paths]
    if len(set(uris)) < len(uris) or not uris:
        raise InvalidInput("input-scene", "a scene needs at least one file, and no file twice")
    for uri, rows in transforms.items():
        _check_transform(uri, rows, uris)
    files, kinds = [], []
    for path, uri in zip(paths, uris, strict=True):
        with naming(uri), FileSource(path) as source:
            reader = SceneReader(source, limits=limits)
            files.append(listed_file(reader, source, uri, transforms.get(uri)))
            kinds.append((reader.header.fields.coordinate_frame, reader.header.fields.colour_space))
            if kinds[-1] != kinds[0]:
                told = " and ".join(kind.name for kind in kinds[-1])
                first = " and ".join(kind.name for kind in kinds[0])
                raise InvalidInput("input-scene", f"{told}, the first file of the scene {first}")
    return Index(tuple(files), *kinds[0])


def _checked_uri(path: Path, folder: Path) -> str:
    try:
        return check_uri(uri_of(path, folder))
    except Malformed as error:
        raise InvalidInput("input-scene", error.message) from error


def _check_transform(uri: str, rows: Rows, uris: Sequence[str]) -> None:
    if uri not in uris:
        raise InvalidInput("input-scene", f"the transforms name {uri!r}, which is not a file of the scene", field=uri)
    try:
        if len(rows) != 4 or any(len(row) != 4 for row in rows):
            raise ValueError("not 4 rows of 4 numbers")
        Placement.of(rows)
    except (TypeError, ValueError) as error:
        raise InvalidInput("input-scene", f"no transform: {error}", field=uri) from error
