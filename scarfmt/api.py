"""The functions of `import scarfmt`: load, save, open, decode, encode, inspect or validate a file in one call each.

Files come as a path, a URL, their bytes, or a :class:`~scarfmt.container.source.ByteSource` that is open already.
What a call costs beyond reading is imported when it is called: torch and numba only by an encode.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Iterator
from functools import cached_property, partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from reference_decoder.decode import DecodeRequest, decode, decode_scene, iter_tiles, make_request
from reference_decoder.decoded import Decoded
from reference_decoder.lod_selection import LevelOfDetail, iter_view
from reference_decoder.region import tile_boxes
from reference_encoder.training.options import Report as TrainReport
from reference_encoder.training.options import Stop, Trained, TrainOptions, never
from reference_encoder.training.options import silent as untold
from scarfmt.arrays import F64
from scarfmt.atomic import atomic_write
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import Report, silent
from scarfmt.container.header import Header, LayerSummary, is_scar, read_header
from scarfmt.container.source import KeptSource, Origin, open_source, use_source
from scarfmt.counters import Counters
from scarfmt.errors import InputWarning, InvalidInput, plural
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.scene.gaussians import AnchorModel, GaussianScene, concatenate
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
            self._kept = KeptSource(self.source)
            self.header: Header = read_header(self._kept, limits=limits, allow_truncated=True)
        except BaseException:
            self.source.close()
            raise

    def __repr__(self) -> str:
        anchors, layers = self.header.anchor_count, self.header.layer_count
        return f"<ScarFile: {plural(anchors, 'anchor')}, {len(self.complete_layers)} of {plural(layers, 'layer')}>"

    @property
    def complete_layers(self) -> tuple[LayerSummary, ...]:
        """The summary of each complete layer: all of `header.layers`, unless the file is truncated."""
        return tuple(layer for layer in self.header.layers if layer.end_offset <= self.source.size)

    def layers(self) -> Iterator[GaussianScene | AnchorModel]:
        """The scene after the first layer, after the second, and so on, each closer to the source.

        What was read is kept until the file is closed, and no byte is read twice.

        Raises:
            Malformed, Unsupported, LimitExceeded: the file is refused (SPEC §12).
        """
        for number in range(1, len(self.complete_layers) + 1):
            yield decode_scene(self._kept, layers=number, limits=self._limits, allow_truncated=True)

    @cached_property
    def tile_boxes(self) -> tuple[F64, F64]:
        """Lowest and highest corners of all tiles, each (T, 3) float64 world units; reads the tables at the front.

        Raises:
            Malformed, Unsupported, LimitExceeded: the tables are refused (SPEC §12).
        """
        reader = SceneReader(self.source, limits=self._limits, allow_truncated=True)
        return tile_boxes(reader.lattice, reader.container.tile_table)

    def decode(self, request: DecodeRequest | None = None, **fields: Any) -> Decoded:
        """Decode what `request`, or its `fields`, ask for, as :func:`decode`."""
        return decode(self.source, self._request(request, fields))

    def tiles(self, request: DecodeRequest | None = None, **fields: Any) -> Iterator[Decoded]:
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

    def _request(self, request: DecodeRequest | None, fields: dict[str, Any]) -> DecodeRequest:
        """The request; fields that name no limits have those the file was opened with."""
        return make_request(request, fields if request else {"limits": self._limits, **fields})


def open(source: Origin, *, limits: Limits = DEFAULT_LIMITS) -> ScarFile:
    """Open a file and read its header, so as to ask more than one thing of it. A file cut short is accepted.

    Args:
        source: a path, a URL, bytes, or an open ByteSource, which the handle then closes.
        limits: what to accept of the file, also of later requests that state no limits.

    Raises:
        InvalidInput: ``input-source`` when it cannot be opened; a FileNotFoundError too where there is no such file.
        Malformed, Unsupported, LimitExceeded: the header is refused (SPEC §12).
    """
    return ScarFile(source, limits)


def decode_view(
    source: Origin,
    view: LevelOfDetail,
    request: DecodeRequest | None = None,
    *,
    counters: Counters | None = None,
    **fields: Any,
) -> GaussianScene:
    """The Gaussians that a view needs: more layers of near tiles, none of tiles outside of the picture.

    Args:
        source: a path, a URL, bytes, or an open ByteSource of a file of plain Gaussians.
        view: the camera, and the Gaussians at most.
        request, counters, fields: as for :func:`decode`.

    Raises:
        InvalidInput: ``input-scene`` for an anchor model; the request does not fit.
        Malformed, Unsupported, LimitExceeded: the file is refused (SPEC §12).
    """
    with use_source(source) as stream:
        parts = list(iter_view(stream, make_request(request, fields), view, counters))
        return concatenate(parts, read_header(stream, allow_truncated=True).fields.sh_degree)


def load(source: str | os.PathLike[str] | bytes, *, format: str | None = None) -> GaussianScene | AnchorModel:
    """The scene of a file of any format: .scar, or what :func:`scarfmt.formats.load` reads.

    Args:
        source: a path, bytes, or the URL of a .scar file.
        format: id of another format; by default the content decides, then the name.

    Raises:
        FileNotFoundError: there is no such file; it is an InvalidInput too.
        InvalidInput: the file is unreadable or damaged, or its format unknown.
        Malformed, Unsupported, LimitExceeded: a .scar file is refused (SPEC §12).
    """
    if format is None and is_scar(source):
        return decode_scene(source)
    from scarfmt.formats import load as load_scene

    return load_scene(source, format=format)


def save(
    scene: GaussianScene | AnchorModel,
    target: str | os.PathLike[str],
    *,
    options: EncodeOptions | None = None,
    force: bool = False,
) -> None:
    """Write a scene to a file, in the format that its name ends in. The file appears when it is complete.

    Args:
        scene: Gaussians; or an anchor model, for a .scar or .npz file.
        target: a path that ends in .scar or as one of `scarfmt.formats.outputs`.
        options: of the encoder, for a .scar file.
        force: replace a file that exists.

    Raises:
        FileExistsError: the file exists; it is an InvalidInput too.
        InvalidInput: ``output-format``, ``output-path``, ``output-range``, or what the encoder refuses.

    Warns:
        InputWarning: what the format cannot hold as it is.
    """
    name = os.fspath(target)
    write = partial(atomic_write, force=force)
    if name.lower().endswith(".scar"):
        with write(name) as file:
            file.write(encode(scene, options))
        return
    from scarfmt.formats.anchor_npz import save_anchor_npz
    from scarfmt.formats.output import Described
    from scarfmt.formats.outputs import open_targets, output_of, write_parts

    if isinstance(scene, AnchorModel):
        if not name.lower().endswith(".npz"):
            raise InvalidInput("output-format", "an anchor model has no fixed Gaussians: save it as .scar or .npz")
        with write(name) as file:
            save_anchor_npz(scene, file)
        return
    format_id = output_of(name).id
    with open_targets(name, format_id, None, write) as (file, settled):
        written = write_parts(format_id, [scene], Described.of(scene), file, settled)
    for note in written.notes:
        warnings.warn(note, InputWarning, stacklevel=2)


def convert(source: str | os.PathLike[str] | bytes, target: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write the scene of a file in another format: :func:`load`, then :func:`save`, with their errors and warnings."""
    save(load(source), target, force=force)


def encode(
    scene: GaussianScene | AnchorModel | str | os.PathLike[str] | bytes,
    options: EncodeOptions | None = None,
    *,
    report: Report = silent,
) -> bytes:
    """The bytes of a file for a scene.

    Args:
        scene: a scene, or a file of any format that :func:`scarfmt.formats.load` knows.
        options: None for the defaults. Their cameras may be those of :func:`scarfmt.load_cameras`.
        report: called with (stage, fraction done) as the work proceeds.

    Raises:
        InvalidInput: ``input-empty``, ``input-options``, ``input-dependency``, or the scene file cannot be used.
    """
    from reference_encoder.encode import encode as encode_scene
    from scarfmt.formats import load as load_scene
    from scarfmt.formats.clean import clean

    if isinstance(scene, str | os.PathLike | bytes):
        scene = load_scene(scene)
    return encode_scene(clean(scene)[0], options, report)


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
            on from that. They stay until :func:`~reference_encoder.training.run_folder.discard_checkpoints`. None to
            keep nothing.
        report: called with a :class:`~reference_encoder.training.options.Progress` as the work proceeds.
        stop: asked every iteration; once it says yes, training ends early with the best file so far.

    Returns:
        The file's bytes as `data`, and what each layer costs and is worth.

    Raises:
        InvalidInput: ``input-options``, ``input-dependency``, ``input-checkpoint``, or the capture cannot be used.
    """
    settled = (options or TrainOptions()).resolve()
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
    with use_source(source) as stream:
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
    with use_source(source) as stream:
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
    with use_source(source) as stream:
        return validation.validate(stream, layers=layers, limits=limits, report=report)
