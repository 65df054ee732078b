"""The Gaussians of a scene, tile by tile, for what writes them; anchors are baked file by file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from reference_decoder.decode import decode
from reference_decoder.request import DecodeRequest
from reference_decoder.scenes.needs import LevelOfDetail, meets_box, placed_request
from reference_decoder.scenes.scene_set import ScenePart, SceneSet
from reference_decoder.stream_ply import Baking, baked
from scarfmt.coding.writer import Report, silent
from scarfmt.container.schema import Profile
from scarfmt.counters import Counters
from scarfmt.errors import InvalidInput
from scarfmt.formats.joined import widened
from scarfmt.formats.output import Described
from scarfmt.render.camera import Camera
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.scene.placement import Placement

T = TypeVar("T")

Make = Callable[[GaussianScene, tuple[str, ...]], T]
"""Makes of some Gaussians, and of comments that belong to them, what is wanted of them."""


@dataclass(frozen=True)
class SceneStream(Generic[T]):
    """A scene on its way.

    Attributes:
        described: what holds for all parts.
        parts: what was made of each.
        count: Gaussians of all; None where that shows only at the end.
    """

    described: Described
    parts: Iterator[T]
    count: int | None


def stream_scene(
    scene: SceneSet,
    request: DecodeRequest,
    view: LevelOfDetail | None,
    make: Make[T],
    *,
    baking: Baking | None = None,
    counters: Counters | None = None,
    report: Report = silent,
) -> SceneStream[T]:
    """The Gaussians of a scene, or those that a view needs. All parts have the highest degree of its files.

    Args:
        scene: of one file or many.
        request: layers, box, or tiles of one file.
        view: camera and budget; None for all.
        make: what to make of each part, in the thread that decodes it.
        baking: how anchor models are baked, with views in the coordinates of the scene; None where there are none.
        counters: what is read, decoded and fitted is added to them.
        report: called with (stage, fraction done) while anchors are refined.

    Raises:
        InvalidInput: ``input-scene`` for anchor models without `baking`, or with a view; the request does not fit.
        Malformed, Truncated, Unsupported, LimitExceeded: a file is refused, now or while the parts are taken.
    """
    index = scene.index
    anchors = any(file.profile == Profile.ANCHOR for file in index.files)
    if anchors and (baking is None or view is not None):
        raise InvalidInput("input-scene", "anchor models have no fixed Gaussians: bake whole files")
    degrees = [file.sh_degree for file in index.files if file.profile == Profile.EXPLICIT]
    degree = max([*degrees, baking.sh_degree] if anchors and baking else degrees)

    def made(part: ScenePart, _own: Counters | None) -> T:
        assert isinstance(part.scene, GaussianScene)
        return make(_of_degree(part.scene, degree), ())

    count: int | None = None
    if view is not None:
        needs = scene.needs(view, request, counters)
        found, count = scene.made_of(needs, made, request, counters), sum(need.gaussians for need in needs)
    elif anchors and baking:
        parts = _baked(scene, request, baking, counters, report)
        found = (make(_of_degree(part, degree), notes) for part, notes in parts)
    else:
        found = scene.made(made, request, counters)
        if request.tiles is None and not request.allow_truncated:
            count = index.layer(request.layers or index.layer_count).gaussians
    described = Described(degree, index.coordinate_frame, index.colour_space)
    return SceneStream(described, found, None if request.box is not None else count)


def _of_degree(scene: GaussianScene, degree: int) -> GaussianScene:
    return replace(scene, sh=widened(scene.sh, (degree + 1) ** 2))


def _baked(
    scene: SceneSet, request: DecodeRequest, baking: Baking, counters: Counters | None, report: Report
) -> Iterator[tuple[GaussianScene, tuple[str, ...]]]:
    """The Gaussians of each file, anchors baked in its own coordinates and then placed; with comments."""
    for number, listed in enumerate(scene.index.files):
        if not meets_box(listed, request):
            continue
        here = placed_request(request, listed.placement, len(listed.layers))
        with scene.files.opened(number, counters) as source:
            found = scene.inside(number, request, decode(source, here, counters=counters)).activated(counters=counters)
        if not len(found):
            continue
        notes: tuple[str, ...] = ()
        if isinstance(found, AnchorModel):
            own = replace(baking, views=placed_views(baking.views, listed.placement))
            found, notes = baked(found, own, counters, report)
        if listed.placement is not None:
            found = listed.placement.scene(found)
        yield found, notes


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
