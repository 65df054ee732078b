"""The functions of `import scarfmt`: open, decode, encode, inspect, truncate or validate a file in one call each.

Files come as a path, a URL, their bytes, or a :class:`~scarfmt.container.source.ByteSource` that is open already.
What a call costs beyond reading is imported when it is called: torch and numba only by an encode.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, Unpack

from reference_decoder.decode import decode as decode_source
from reference_decoder.decode import decode_scene as decode_scene_source
from reference_decoder.decode import iter_tiles
from reference_decoder.decoded import Decoded
from reference_decoder.dequantise import tile_boxes
from reference_decoder.request import DecodeRequest, RequestFields, requested
from reference_decoder.scenes.scene_set import SceneSet
from reference_decoder.scenes.scene_set import open_scene as open_scene_set
from reference_encoder.training.options import Report as TrainReport
from reference_encoder.training.options import Stop, Trained, TrainOptions, never
from reference_encoder.training.options import silent as untold
from scarfmt.arrays import F64
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import Report, silent
from scarfmt.container.header import Header, LayerSummary, read_header
from scarfmt.container.source import Origin, open_source, opened
from scarfmt.counters import Counters
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.tools import inspection
from scarfmt.tools import truncate as truncation
from scarfmt.tools import validate as validation
from scarfmt.tools.validate import Validation

if TYPE_CHECKING:
    from reference_encoder.options import EncodeOptions
    from reference_encoder.training.capture import Capture


class ScarFile:
    """An open file, made by :func:`open`: a context manager that closes the file.

    Args:
        origin: a path, a URL, bytes, or an open ByteSource.
        limits: what to accept of the file.

    Attributes:
        source: the file's bytes; it counts what is read.
        header: the checked header; its `layers` tell what each layer adds.
    """

    def __init__(self, origin: Origin, limits: Limits = DEFAULT_LIMITS) -> None:
        self.source = open_source(origin)
        self._limits = limits
        try:
            self.header: Header = read_header(self.source, limits=limits, allow_truncated=True)
        except BaseException:
            self.source.close()
            raise

    def __repr__(self) -> str:
        anchors, layers = self.header.anchor_count, self.header.layer_count
        return f"<ScarFile: {anchors:,} anchors, {len(self.layers)} of {layers} layers>"

    @property
    def layers(self) -> tuple[LayerSummary, ...]:
        """The summary of each complete layer: all of `header.layers`, unless the file is truncated."""
        return tuple(layer for layer in self.header.layers if layer.end_offset <= self.source.size)

    @cached_property
    def tile_boxes(self) -> tuple[F64, F64]:
        """Lowest and highest corners of all tiles, each (T, 3) float64 world units; reads the tables at the front.

        Raises:
            Malformed, Unsupported, LimitExceeded: the tables are refused (SPEC §12).
        """
        reader = SceneReader(self.source, limits=self._limits, allow_truncated=True)
        return tile_boxes(reader.lattice, reader.container.tile_table)

    def decode(self, request: DecodeRequest | None = None, **fields: Unpack[RequestFields]) -> Decoded:
        """Decode what `request`, or its `fields`, ask for, as :func:`decode`."""
        return decode_source(self.source, self._request(request, fields))

    def tiles(self, request: DecodeRequest | None = None, **fields: Unpack[RequestFields]) -> Iterator[Decoded]:
        """Decode a tile at a time, leaving out tiles without anchors; memory does not grow with the scene."""
        return iter_tiles(self.source, self._request(request, fields))

    def inspect(self, *, metadata: bool = False) -> dict[str, Any]:
        """Describe the file, as :func:`inspect`."""
        return inspection.inspect(self.source, metadata=metadata, limits=self._limits)

    def truncate(self, layers: int) -> bytes:
        """The file of the first `layers` layers, as :func:`truncate`."""
        return truncation.truncate(self.source, layers, limits=self._limits)

    def validate(self, *, layers: int | None = None) -> Validation:
        """Check the file against every rule, as :func:`validate`."""
        return validation.validate(self.source, layers=layers, limits=self._limits)

    def close(self) -> None:
        """Close the file; nothing can be read any more."""
        self.source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _request(self, request: DecodeRequest | None, fields: RequestFields) -> DecodeRequest:
        """The request; fields that name no limits have those the file was opened with."""
        return requested(request, fields if request else {"limits": self._limits, **fields})


def open(source: Origin, *, limits: Limits = DEFAULT_LIMITS) -> ScarFile:
    """Open a file and read its header, so as to ask more than one thing of it. A file cut short is accepted.

    Args:
        source: a path, a URL, bytes, or an open ByteSource, which the handle then closes.
        limits: what to accept of the file, also of later requests that state no limits.

    Raises:
        InvalidInput: ``input-source`` when it cannot be opened.
        Malformed, Unsupported, LimitExceeded: the header is refused (SPEC §12).
    """
    return ScarFile(source, limits)


def open_scene(origin: Origin, *, limits: Limits = DEFAULT_LIMITS) -> SceneSet:
    """Open a scene, whether it is one file or an index of many, to read it by region, by layers or for a view.

    Args:
        origin: path or URL of a .scar file or of a scene index; or bytes or an open ByteSource of a file, which the
            scene then closes.
        limits: what to accept of each file.

    Raises:
        InvalidInput: ``input-source`` when it cannot be opened; ``input-scene`` for an index without a place.
        Malformed, Unsupported, LimitExceeded: the index, or the front of the file, is refused (SPEC §12, §17).
    """
    return open_scene_set(origin, limits=limits)


def decode(
    source: Origin,
    request: DecodeRequest | None = None,
    *,
    counters: Counters | None = None,
    **fields: Unpack[RequestFields],
) -> Decoded:
    """Decode a file, or what is asked of it. Of a URL only the bytes needed are transferred.

    Args:
        source: a path, a URL, bytes, or an open ByteSource, which stays open.
        request: what to decode; None for what `fields` say, and without them for everything.
        counters: what was read and computed is added to them.
        fields: those of :class:`DecodeRequest`, in place of one: layers, tiles, box, attributes, limits, threads,
            allow_truncated, backend.

    Returns:
        The exact values; `scene` makes of them a :class:`GaussianScene`, or an :class:`AnchorModel`.

    Raises:
        InvalidInput: the source cannot be opened, or the request does not fit the file.
        Malformed, Unsupported, LimitExceeded: the file is refused (SPEC §12).
    """
    return decode_source(source, request, counters=counters, **fields)


def decode_scene(
    source: Origin,
    request: DecodeRequest | None = None,
    *,
    counters: Counters | None = None,
    **fields: Unpack[RequestFields],
) -> GaussianScene | AnchorModel:
    """The Gaussians of a file: the same numbers as ``decode(...).scene``, in half the time and memory.

    Arguments and errors are those of :func:`decode`; all attributes are needed.
    """
    return decode_scene_source(source, request, counters=counters, **fields)


def encode(
    scene: GaussianScene | AnchorModel | str | os.PathLike[str] | bytes,
    options: EncodeOptions | None = None,
    *,
    report: Report = silent,
) -> bytes:
    """The bytes of a file for a scene. Needs the extra ``encode``.

    Args:
        scene: a scene without NaN or infinity, or a file of any format that :func:`scarfmt.formats.load` knows.
        options: None for the defaults. Their cameras may be those of :func:`scarfmt.load_cameras`.
        report: called with (stage, fraction done) as the work proceeds.

    Raises:
        InvalidInput: ``input-empty``, ``input-options``, ``input-dependency``, or the scene file cannot be used.
    """
    if options is not None:
        options.check()
    from reference_encoder.encode import encode as encode_scene

    if isinstance(scene, str | os.PathLike | bytes):
        from scarfmt.formats import load
        from scarfmt.formats.clean import clean

        scene, _ = clean(load(scene))
    return encode_scene(scene, options, report)


def train(
    capture: Capture | str | os.PathLike[str],
    options: TrainOptions | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    report: TrainReport = untold,
    stop: Stop = never,
) -> Trained:
    """Train a file from photos. Needs the extra ``train``.

    Args:
        capture: of :func:`scarfmt.load_capture`, or what that reads.
        options: None for the defaults.
        folder: for checkpoints, log and plot; if it holds a checkpoint of the same capture and options, training goes
            on from that. They stay until :func:`~reference_encoder.training.checkpoints.discard_checkpoints`. None to
            keep nothing.
        report: called with a :class:`~reference_encoder.training.options.Progress` as the work proceeds.
        stop: asked every iteration; once it says yes, training ends early with the best file so far.

    Returns:
        The file's bytes as `data`, and what each layer costs and is worth.

    Raises:
        InvalidInput: ``input-options``, ``input-dependency``, ``input-checkpoint``, or the capture cannot be used.
    """
    settled = (options or TrainOptions()).settled()
    from reference_encoder.training.capture import Capture, load_capture
    from reference_encoder.training.run import train as train_capture

    kept = None if folder is None else Path(folder)
    with tempfile.TemporaryDirectory(prefix="scarfmt-") as temporary:
        read = capture if isinstance(capture, Capture) else load_capture(capture, workspace=kept or Path(temporary))
        trained: Trained = train_capture(read, settled, kept, report, stop)
    return trained


def inspect(source: Origin, *, metadata: bool = False, limits: Limits = DEFAULT_LIMITS) -> dict[str, Any]:
    """A JSON-able description of a file, from its header alone unless `metadata` is asked for.

    Args:
        source: a path, a URL, bytes, or an open ByteSource; whole or cut short.
        metadata: also read the annotations, as key ``metadata``.
        limits: what to accept of the file.

    Returns:
        What :func:`scarfmt.tools.inspection.inspect` says.

    Raises:
        InvalidInput: ``input-source`` when it cannot be opened.
        Malformed, Truncated, Unsupported, LimitExceeded: what is read is refused (SPEC §12).
    """
    with opened(source) as stream:
        return inspection.inspect(stream, metadata=metadata, limits=limits)


def truncate(source: Origin, layers: int, *, limits: Limits = DEFAULT_LIMITS) -> bytes:
    """The file holding only the first `layers` layers, made without decoding (SPEC §14).

    Args:
        source: a path, a URL, bytes, or an open ByteSource; cut short or not.
        layers: layers to keep, 1..layer count of the file.
        limits: what to accept of the file.

    Raises:
        InvalidInput: ``input-layers`` when the file does not have so many, ``input-source``.
        Malformed, Truncated, Unsupported, LimitExceeded: the file is refused (SPEC §12).
    """
    with opened(source) as stream:
        return truncation.truncate(stream, layers, limits=limits)


def validate(
    source: Origin, *, layers: int | None = None, limits: Limits = DEFAULT_LIMITS, report: Report = silent
) -> Validation:
    """Check a file against every rule of the specification; what is found is in `findings` of the result.

    Args:
        source: a path, a URL, bytes, or an open ByteSource.
        layers: check only the first so many layers; None for all that are there.
        limits: what counts as too large.
        report: called with (stage, fraction done) as the work proceeds.

    Raises:
        InvalidInput: ``input-layers`` when the file does not declare so many, ``input-source``.
    """
    with opened(source) as stream:
        return validation.validate(stream, layers=layers, limits=limits, report=report)
