"""A scene opened, whether it is one file or an index of many: counts, boxes, tiles in some order, all of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from types import TracebackType
from typing import Self, TypeVar, Unpack

import numpy as np

from reference_decoder.decode import check_gathered, iter_made
from reference_decoder.decoded import Decoded
from reference_decoder.request import DecodeRequest, RequestFields, requested
from reference_decoder.scenes.levels import LevelReader
from reference_decoder.scenes.making import listed_file
from reference_decoder.scenes.needs import LevelOfDetail, Need, meets_box, needs_of, placed_request
from scarfmt.arrays import F64
from scarfmt.coding.reader import SceneReader
from scarfmt.container.source import ByteSource, Origin, open_source
from scarfmt.counters import Counters
from scarfmt.errors import InvalidInput
from scarfmt.formats.joined import widened
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.scene.placement import Placement
from scarfmt.scene_index.address import Opener, SceneFiles, SingleFile, read_index, scene_files
from scarfmt.scene_index.document import HEAD_BYTES, Index, ListedLayer, is_index

T = TypeVar("T")
Act = Callable[["ScenePart", Counters | None], T]


@dataclass(frozen=True)
class ScenePart:
    """The decoded part of a tile.

    Attributes:
        file: number of the file, from 0.
        tile: number of the tile in it.
        layers: that it was decoded after.
        scene: Gaussians placed in the scene; or an anchor model, in the coordinates of its file.
        placement: of the file; None for none.
    """

    file: int
    tile: int
    layers: int
    scene: GaussianScene | AnchorModel
    placement: Placement | None


class SceneSet:
    """An open scene, made by :func:`open_scene`: a context manager that closes it.

    Attributes:
        files: its files.
    """

    def __init__(self, files: SceneFiles) -> None:
        self.files = files

    def __repr__(self) -> str:
        last = self.layers[-1]
        return f"<SceneSet: {len(self.files):,} files, {last.gaussians:,} Gaussians, {len(self.layers)} layers>"

    @property
    def index(self) -> Index:
        """The scene index: the values known of the files before they are opened."""
        return self.files.index

    @property
    def layers(self) -> tuple[ListedLayer, ...]:
        """The totals of all files after each layer; a file that has fewer layers counts with all it has."""
        return tuple(self.index.layer(number) for number in range(1, self.index.layer_count + 1))

    @property
    def boxes(self) -> tuple[F64, F64]:
        """Lowest and highest corners, (F, 3) each, of boxes round the anchors of files, in the scene's coordinates."""
        low, high = zip(*(file.box for file in self.index.files), strict=True)
        return np.array(low), np.array(high)

    def iter_tiles(
        self,
        request: DecodeRequest | None = None,
        view: LevelOfDetail | None = None,
        *,
        order: str = "file",
        counters: Counters | None = None,
        **fields: Unpack[RequestFields],
    ) -> Iterator[ScenePart]:
        """Decode a tile at a time, leaving out what is empty; memory does not grow with the scene.

        Args:
            request: layers at most, a box in the coordinates of the scene, tiles of a scene of one file.
            view: from where the scene is seen, and with how many Gaussians; None for all tiles at the same layer.
            order: ``"file"``: file by file; or ``"camera"``: what the view needs most first.
            counters: what is read and computed is added to them.
            fields: those of a request, in place of one.

        Raises:
            InvalidInput: the request does not fit; a file cannot be opened.
            Malformed, Truncated, Unsupported, LimitExceeded: a file is refused (SPEC §12, §17).
        """
        if order not in ("file", "camera") or (order == "camera" and view is None):
            message = f"order {order!r} is unknown: use file, or camera if there is a view"
            raise InvalidInput("input-scene", message, field="order")
        wanted = requested(request, fields)
        if view is None:
            yield from self.made(lambda part, _: part, wanted, counters)
        else:
            needs = self.needs(view, wanted, counters)
            yield from self.made_of(needs, lambda part, _: part, wanted, counters, by_need=order == "camera")

    def needs(self, view: LevelOfDetail, request: DecodeRequest, counters: Counters | None = None) -> list[Need]:
        """The tiles that a view needs, each with a number of layers, most needed first. Raises as
        :meth:`iter_tiles`."""
        self._check(request)
        return needs_of(self.files, request, view, counters)

    def made(self, act: Act[T], request: DecodeRequest, counters: Counters | None = None) -> Iterator[T]:
        """The result of `act` for all requested tiles, file by file, in the threads that decode. It never returns
        None."""
        self._check(request)
        for number, listed in enumerate(self.index.files):
            if not meets_box(listed, request):
                continue
            here = placed_request(request, listed.placement, len(listed.layers))
            make = partial(self._act, act, number, here.layers, request)
            with self.files.opened(number, counters) as source:
                yield from (one[0] for one in iter_made(source, here, make, counters) if one)

    def made_of(
        self,
        needs: list[Need],
        act: Act[T],
        request: DecodeRequest,
        counters: Counters | None = None,
        *,
        by_need: bool = False,
    ) -> Iterator[T]:
        """The result of `act` for some tiles, each after its layers, by the rules of :meth:`made`."""
        with LevelReader(self.files, request, counters) as reader:

            def make(file: int, layers: int, part: Decoded, own: Counters | None) -> tuple[T, ...]:
                return self._act(act, file, layers, request, part, own)

            yield from (one[0] for one in reader.made(needs, make, by_need=by_need) if one)

    def decode(
        self,
        request: DecodeRequest | None = None,
        view: LevelOfDetail | None = None,
        *,
        counters: Counters | None = None,
        **fields: Unpack[RequestFields],
    ) -> GaussianScene:
        """All Gaussians of what was asked for, in memory; degrees of harmonics that a file lacks are 0.

        Arguments and errors of :meth:`iter_tiles`.

        Raises:
            InvalidInput: ``input-scene`` for anchor models: they are one for each file.
            LimitExceeded: ``limit-gathered``: all files together hold more than this reader holds at once; where no
                box and no view leave anything out, before a file is opened.
        """
        wanted = requested(request, fields)
        if view is None and wanted.box is None and wanted.tiles is None:
            check_gathered(self._anchors(wanted.layers), 1, wanted.limits)
        found: list[GaussianScene] = []
        held = 0
        for part in self.iter_tiles(wanted, view, counters=counters):
            if not isinstance(part.scene, GaussianScene):
                raise InvalidInput("input-scene", "anchor models have no fixed Gaussians: read them tile by tile")
            found.append(part.scene)
            held += len(part.scene)
            check_gathered(held, 1, wanted.limits)
        return joined(found, max(file.sh_degree for file in self.index.files))

    def _anchors(self, layers: int | None) -> int:
        """Anchors of all files after their first layers, as the index has them."""
        return sum(file.layers[: layers or len(file.layers)][-1].anchors for file in self.index.files)

    def inside(self, number: int, request: DecodeRequest, part: Decoded) -> Decoded:
        """The decoded part of a file without what lies outside the box of a request, after the file is placed."""
        placement, corners = self.index.files[number].placement, request.corners()
        if placement is None or corners is None or part.positions is None:
            return part
        at = placement.points(part.positions)
        return part.take(np.asarray(((at >= corners[0]) & (at <= corners[1])).all(axis=1)))

    def _check(self, request: DecodeRequest) -> None:
        if request.tiles is not None and len(self.files) > 1:
            raise InvalidInput("input-tiles", "tile numbers belong to one file: give a box instead", field="tiles")
        if request.layers is not None and not 1 <= request.layers <= self.index.layer_count:
            message = f"layer {request.layers} asked for, the scene has 1..{self.index.layer_count}"
            raise InvalidInput("input-layers", message)

    def _act(
        self,
        act: Act[T],
        number: int,
        layers: int | None,
        request: DecodeRequest,
        part: Decoded,
        counters: Counters | None,
    ) -> tuple[T, ...]:
        """The result of `act` for the part in the box of the request; nothing if the part is empty."""
        placement = self.index.files[number].placement
        part = self.inside(number, request, part)
        if not len(part):
            return ()
        tile, after = int(part.tiles[0]), part.layers if layers is None else layers
        scene = part.activated(counters=counters)
        if placement is not None and isinstance(scene, GaussianScene):
            scene = placement.scene(scene)
        return (act(ScenePart(number, tile, after, scene, placement), counters),)

    def holds(self, source: ByteSource) -> bool:
        """Whether the scene is the one file that a source was opened for."""
        return isinstance(self.files, SingleFile) and self.files.source is source

    def close(self) -> None:
        """Close what is open."""
        self.files.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_scene(
    origin: Origin, *, limits: Limits = DEFAULT_LIMITS, opener: Opener | None = None, source: ByteSource | None = None
) -> SceneSet:
    """Open a scene: a .scar file, or an index of several. Of a file the front is read, of an index the index.

    Args:
        origin: path or URL; or bytes or a source of one file.
        limits: what to accept of each file.
        opener: of the files of an index, by path or URL; None for the usual one.
        source: what was opened for `origin` already; it is then closed with the scene, or here.

    Raises:
        InvalidInput: ``input-source``; ``input-scene`` for an index that has no place.
        Malformed, Truncated, Unsupported, LimitExceeded: the index, or the front of the file, is refused.
    """
    stream = open_source(origin) if source is None else source
    try:
        if not is_index(stream.read(0, min(stream.size, HEAD_BYTES))):
            return SceneSet(_single(stream, limits))
        files = scene_files(origin, read_index(stream), opener=opener, limits=limits)
    except BaseException:
        stream.close()
        raise
    stream.close()
    return SceneSet(files)


def _single(source: ByteSource, limits: Limits) -> SingleFile:
    reader = SceneReader(source, limits=limits, allow_truncated=True)
    fields = reader.header.fields
    index = Index((listed_file(reader, source, "scene.scar"),), fields.coordinate_frame, fields.colour_space)
    return SingleFile(index, source, limits)


def joined(parts: list[GaussianScene], degree: int) -> GaussianScene:
    """One scene of all, of that degree."""
    coefficients = (degree + 1) ** 2
    if not parts:
        empty = (np.zeros((0, *shape), np.float32) for shape in ((3,), (4,), (), (coefficients, 3)))
        return GaussianScene(np.zeros((0, 3)), *empty)
    wide = [replace(part, sh=widened(part.sh, coefficients)) for part in parts]
    return GaussianScene(*(np.concatenate([getattr(part, name) for part in wide]) for name in vars(wide[0])))
