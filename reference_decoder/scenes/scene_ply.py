"""A scene to a PLY: tile by tile, in memory that does not grow with it; anchors are baked file by file."""

from __future__ import annotations

import os
from typing import BinaryIO

from reference_decoder.request import DecodeRequest
from reference_decoder.scenes.needs import LevelOfDetail
from reference_decoder.scenes.scene_set import SceneSet
from reference_decoder.scenes.stream_scene import stream_scene
from reference_decoder.stream_ply import Baking, Rows, target_of, write_counting
from scarfmt.coding.writer import Report, silent
from scarfmt.counters import Counters
from scarfmt.formats.export_ply import ply_header, ply_rows, property_names
from scarfmt.scene.gaussians import GaussianScene


def export_scene_ply(
    scene: SceneSet,
    destination: str | os.PathLike[str] | BinaryIO,
    request: DecodeRequest,
    view: LevelOfDetail | None = None,
    *,
    baking: Baking | None = None,
    force: bool = False,
    counters: Counters | None = None,
    report: Report = silent,
) -> int:
    """Write what a scene holds, or what a view needs of it, as an INRIA PLY.

    Args:
        scene: of one file or many.
        destination: a path, written whole or not at all, or an open binary file.
        request: layers, box, or tiles of one file.
        view: camera and budget; None for all.
        baking: how anchor models are baked, with views in the coordinates of the scene; None where there are none.
        force: overwrite an existing file.
        counters: what is read, decoded and fitted is added to them.
        report: called with (stage, fraction done) while anchors are refined.

    Returns:
        Gaussians written.

    Raises:
        InvalidInput: ``input-scene`` for anchor models without `baking`, or with a view; the request does not fit.
        Malformed, Truncated, Unsupported, LimitExceeded: a file is refused.
    """
    stream = stream_scene(scene, request, view, _rows, baking=baking, counters=counters, report=report)
    names = property_names((stream.described.sh_degree + 1) ** 2 - 1)
    with target_of(destination, force) as target:
        if stream.count is None:
            return write_counting(stream.parts, target, names, ())
        target.write(ply_header(stream.count, names, ()))
        for table, _ in stream.parts:
            target.write(table.data)
        return stream.count


def _rows(scene: GaussianScene, notes: tuple[str, ...]) -> Rows:
    return ply_rows(scene), notes
