"""A scene to a PLY: tile by tile, in memory that does not grow with it; anchors are baked file by file."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import BinaryIO

from reference_decoder.decode import decode
from reference_decoder.request import DecodeRequest
from reference_decoder.scenes.needs import LevelOfDetail, meets_box, placed_request
from reference_decoder.scenes.scene_set import ScenePart, SceneSet, widened
from reference_decoder.stream_ply import Baking, Rows, baked, target_of, write_counting
from scarfmt.coding.writer import Report, silent
from scarfmt.container.schema import Profile
from scarfmt.counters import Counters
from scarfmt.errors import InvalidInput
from scarfmt.formats.export_ply import ply_header, ply_rows, property_names
from scarfmt.render.camera import Camera
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.scene.placement import Placement


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
    anchors = any(file.profile == Profile.ANCHOR for file in scene.index.files)
    if anchors and (baking is None or view is not None):
        raise InvalidInput("input-scene", "anchor models have no fixed Gaussians until they are baked, all of a file")
    degrees = [file.sh_degree for file in scene.index.files if file.profile == Profile.EXPLICIT]
    degree = max([*degrees, baking.sh_degree] if anchors and baking else degrees)
    names, coefficients = property_names((degree + 1) ** 2 - 1), (degree + 1) ** 2

    def rows(part: ScenePart, _own: Counters | None) -> Rows:
        assert isinstance(part.scene, GaussianScene)
        return ply_rows(replace(part.scene, sh=widened(part.scene.sh, coefficients))), ()

    count: int | None = None
    if view is not None:
        needs = scene.needs(view, request, counters)
        found, count = scene.made_of(needs, rows, request, counters), sum(need.gaussians for need in needs)
    elif anchors and baking:
        found = _baked(scene, request, baking, coefficients, counters, report)
    else:
        found = scene.made(rows, request, counters)
        if request.tiles is None and not request.allow_truncated:
            count = scene.index.layer(request.layers or scene.index.layer_count).gaussians
    with target_of(destination, force) as target:
        if count is None or request.box is not None:
            return write_counting(found, target, names, ())
        target.write(ply_header(count, names, ()))
        for table, _ in found:
            target.write(table.data)
        return count


def _baked(
    scene: SceneSet,
    request: DecodeRequest,
    baking: Baking,
    coefficients: int,
    counters: Counters | None,
    report: Report,
) -> Iterator[Rows]:
    """The Gaussians of each file, anchors baked in its own coordinates and then placed."""
    for number, listed in enumerate(scene.index.files):
        if not meets_box(listed, request):
            continue
        here = placed_request(request, listed.placement, len(listed.layers))
        with scene.files.opened(number) as source:
            found = scene.inside(number, request, decode(source, here, counters=counters)).activated(counters=counters)
        if not len(found):
            continue
        notes: tuple[str, ...] = ()
        if isinstance(found, AnchorModel):
            own = replace(baking, views=placed_views(baking.views, listed.placement))
            found, notes = baked(found, own, counters, report)
        if listed.placement is not None:
            found = listed.placement.scene(found)
        yield ply_rows(replace(found, sh=widened(found.sh, coefficients))), notes


def placed_views(views: Sequence[Camera], placement: Placement | None) -> list[Camera]:
    """Cameras of a scene in the coordinates of what is placed in it: they see the same."""
    if placement is None:
        return list(views)
    out = []
    for view in views:
        pose = view.world_to_camera.copy()
        turn = pose[:3, :3]
        pose[:3, 3] = (turn @ placement.translation + pose[:3, 3]) / placement.scale
        pose[:3, :3] = turn @ placement.rotation
        out.append(replace(view, world_to_camera=pose, near=view.near / placement.scale))
    return out
