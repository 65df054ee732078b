"""The layers of each tile that a view needs, over all files of a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from reference_decoder.decode import reader_for
from reference_decoder.region import tiles_meeting
from reference_decoder.request import DecodeRequest
from scarfmt.arrays import I64
from scarfmt.blocks.streaming import Streaming, read_streaming
from scarfmt.counters import Counters, transfers
from scarfmt.scene.placement import Placement
from scarfmt.scene_index.address import SceneFiles
from scarfmt.scene_index.document import ListedFile
from scarfmt.streaming.boxes import Boxes
from scarfmt.streaming.levels import Parts, chosen, meets_picture, parts_of
from scarfmt.streaming.plan import SceneIndex
from scarfmt.streaming.view import Camera


@dataclass(frozen=True)
class LevelOfDetail:
    """The view of a scene from one place, and its bounds.

    Attributes:
        camera: in the coordinates of the scene.
        budget: Gaussians at most; None for all that are in the picture.
        outside: whether tiles out of the picture are given their first layer, and not left out.
    """

    camera: Camera
    budget: int | None = None
    outside: bool = False


class Need(NamedTuple):
    """A tile of a file, after so many layers, and the Gaussians it then has at most."""

    file: int
    tile: int
    layers: int
    gaussians: int


@dataclass(frozen=True)
class _Weighed:
    """The known values of a file that may be in the picture.

    Attributes:
        number: of the file.
        index, told: what its front says, and what it tells clients.
        camera: in its coordinates.
        layers: that may be taken.
        tiles: (n,) that may be taken.
    """

    number: int
    index: SceneIndex
    told: Streaming | None
    camera: Camera
    layers: int
    tiles: I64


def needs_of(scene: SceneFiles, request: DecodeRequest, view: LevelOfDetail, counters: Counters | None) -> list[Need]:
    """The needs of a view, most needed first: the order of the first layer of each tile.

    Files out of the picture are not opened, unless they are to have their first layer. Of what files tell of gains
    use is made where all of them tell it: what is usual is in another unit.

    Args:
        scene: the files.
        request: layers at most, tiles (of a scene of one file), box.
        view: camera and budget.
        counters: what is read is added to them.

    Raises:
        InvalidInput, Malformed, Truncated, Unsupported, LimitExceeded: a file, or the request, is refused.
    """
    files = [
        _known(scene, number, request, view, counters)
        for number, listed in enumerate(scene.index.files)
        if (view.outside or _in_picture(listed, view.camera)) and meets_box(listed, request)
    ]
    told = all(file.told is not None and len(file.told.viewpoints) for file in files)
    parts = Parts.joined(
        [
            parts_of(
                file.number,
                file.index,
                file.told if told else _without_gains(file.told),
                file.camera,
                layers=file.layers,
                tiles=file.tiles,
                outside=view.outside,
            )
            for file in files
        ]
    )
    found = chosen(parts, parts.within(math.inf if view.budget is None else view.budget))
    return [Need(*row) for row in zip(*(column.tolist() for column in found), strict=True)]


def _without_gains(told: Streaming | None) -> Streaming | None:
    """The STREAMING values about the places of tiles, without gains."""
    return None if told is None else replace(told, viewpoints=told.viewpoints[:0], gains=told.gains[:0])


def _known(
    scene: SceneFiles, number: int, request: DecodeRequest, view: LevelOfDetail, counters: Counters | None
) -> _Weighed:
    placement = scene.index.files[number].placement
    with scene.opened(number, counters) as source, transfers(source, counters):
        reader = reader_for(source, request)
        asked = None if request.layers is None else min(request.layers, reader.header.layer_count)
        layers = reader.layer_number(asked)
        tiles = np.array(reader.check_tiles(request.tiles), np.int64)
        corners = placed_request(request, placement).corners()
        if corners is not None:
            tiles = tiles[tiles_meeting(reader, corners)[tiles]]
        index, told = SceneIndex.of(reader.container), read_streaming(reader.container)
    return _Weighed(number, index, told, placed_back(view.camera, placement), layers, tiles)


def placed_request(request: DecodeRequest, placement: Placement | None, layers: int | None = None) -> DecodeRequest:
    """A request of the scene as one of a file.

    Args:
        request: its box is in the coordinates of the scene.
        placement: of the file; the box it is asked for is along its own axes, and so perhaps larger.
        layers: that the file has; None for any number.
    """
    corners = request.corners()
    if corners is not None and placement is not None:
        low, high = placement.box_back(*corners)
        request = replace(request, box=(low.tolist(), high.tolist()))
    if layers is not None and request.layers is not None:
        request = replace(request, layers=min(request.layers, layers))
    return request


def meets_box(listed: ListedFile, request: DecodeRequest) -> bool:
    """Whether a file may have something in the box of a request."""
    corners = request.corners()
    if corners is None:
        return True
    low, high = listed.box
    return bool((low <= corners[1]).all() and (high >= corners[0]).all())


def _in_picture(listed: ListedFile, camera: Camera) -> bool:
    low, high = listed.box
    return bool(meets_picture(Boxes(low[None], high[None]), camera)[0])


def placed_back(camera: Camera, placement: Placement | None) -> Camera:
    """A camera of the scene, in the coordinates of what is placed in it."""
    if placement is None:
        return camera
    velocity = None
    if camera.velocity is not None:
        velocity = placement.directions_back(camera.velocity) / placement.scale
    return replace(
        camera,
        position=placement.points_back(camera.position),
        forward=placement.directions_back(camera.forward),
        up=placement.directions_back(camera.up),
        velocity=velocity,
    )
