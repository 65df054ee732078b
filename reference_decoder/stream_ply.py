"""From a file to a PLY: tile by tile, in memory that does not grow with the scene; anchors are baked whole."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import BinaryIO, Unpack

import numpy as np

from reference_decoder.bake import bake
from reference_decoder.bake import comments as bake_comments
from reference_decoder.decode import decode_scene, iter_made
from reference_decoder.decoded import Decoded
from reference_decoder.eyes import default_views
from reference_decoder.request import DecodeRequest, RequestFields, requested
from scarfmt.arrays import F32
from scarfmt.atomic import atomic_write
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import Report, silent
from scarfmt.container.header import HeaderFields
from scarfmt.container.schema import Profile
from scarfmt.container.source import Origin, opened
from scarfmt.counters import Counters, transfers
from scarfmt.formats.export_ply import ply_header, ply_rows, property_names
from scarfmt.render.camera import Camera
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

Rows = tuple[F32, tuple[str, ...]]
"""Rows of a PLY, (n, properties) float32, and the comments that belong to them."""
_SPOOL_BYTES = 1 << 26
BAKE_STEPS = 256


@dataclass(frozen=True)
class Baking:
    """How an anchor model becomes plain Gaussians.

    Attributes:
        views: cameras to fit for, best those the scene was captured from; without any,
            :func:`reference_decoder.eyes.default_views`.
        steps: of refining, one picture each (:mod:`reference_decoder.refine`), which needs the extra `render`; with 0,
            each Gaussian is fitted by itself.
        sh_degree: of the fitted spherical harmonics, 0..3.
    """

    views: Sequence[Camera] = ()
    steps: int = BAKE_STEPS
    sh_degree: int = 2


def export_ply(
    source: Origin,
    destination: str | os.PathLike[str] | BinaryIO,
    request: DecodeRequest | None = None,
    *,
    baking: Baking | None = None,
    comments: Sequence[str] = (),
    force: bool = False,
    counters: Counters | None = None,
    report: Report = silent,
    **fields: Unpack[RequestFields],
) -> int:
    """Write what a file holds as an INRIA PLY. An anchor model is baked, which loses its view dependence.

    Args:
        source, request, fields: as for :func:`reference_decoder.decode.decode`; all attributes are needed.
        destination: a path, written whole or not at all, or an open binary file.
        baking: anchor profile: how it is baked.
        comments: header comment lines, ASCII, after those of a baked model.
        force: overwrite an existing file.
        counters: all that is read, decoded and fitted is added to them; pictures drawn to refine are not.
        report: called with (stage, fraction done) while anchors are refined.

    Returns:
        Gaussians written.

    Raises:
        InvalidInput: the file exists and `force` is not set, a comment cannot be written, or the request does not fit.
        Malformed, Unsupported, LimitExceeded: the file is refused (SPEC §12).
    """
    wanted, baking = requested(request, fields), baking or Baking()
    ply_header(0, [], comments)  # a comment that cannot be written is better refused before than after decoding
    header, anchors = header_fields(source, wanted, counters)
    explicit = header.profile == Profile.EXPLICIT
    names = property_names(((header.sh_degree if explicit else baking.sh_degree) + 1) ** 2 - 1)
    rows = _rows(source, wanted, counters) if explicit else _baked(source, wanted, baking, counters, report)
    with target_of(destination, force) as target:
        if not explicit or wanted.tiles is not None or wanted.box is not None:
            return write_counting(rows, target, names, comments)
        target.write(ply_header(anchors, names, comments))
        for table, _ in rows:
            target.write(table.data)
        return anchors


def header_fields(source: Origin, request: DecodeRequest, counters: Counters | None) -> tuple[HeaderFields, int]:
    """Header fields, and anchors after the layers requested, which the directory confirms."""
    with opened(source) as stream, transfers(stream, counters):
        reader = SceneReader(stream, limits=request.limits, allow_truncated=request.allow_truncated)
        return reader.header.fields, reader.header.layers[reader.layer_number(request.layers) - 1].anchor_count


def write_counting(rows: Iterator[Rows], target: BinaryIO, names: list[str], comments: Sequence[str]) -> int:
    """Rows go aside until their number is known, which the header must state first."""
    count = 0
    notes: tuple[str, ...] = ()
    with tempfile.SpooledTemporaryFile(_SPOOL_BYTES) as aside:
        for table, table_notes in rows:
            notes = table_notes
            aside.write(table.data)
            count += len(table)
        target.write(ply_header(count, names, [*notes, *comments]))
        aside.seek(0)
        shutil.copyfileobj(aside, target, 1 << 20)
    return count


def _rows(source: Origin, request: DecodeRequest, counters: Counters | None) -> Iterator[Rows]:
    """The Gaussians of each tile, made where it is decoded."""

    def made(part: Decoded, own: Counters | None) -> Rows:
        scene = part.activated(counters=own)
        assert isinstance(scene, GaussianScene)
        return ply_rows(scene), ()

    return iter_made(source, request, made, counters)


def _baked(
    source: Origin, request: DecodeRequest, baking: Baking, counters: Counters | None, report: Report
) -> Iterator[Rows]:
    model = decode_scene(source, request, counters=counters)
    assert isinstance(model, AnchorModel)
    if len(model):
        scene, notes = baked(model, baking, counters, report)
        yield ply_rows(scene), notes


def baked(
    model: AnchorModel, baking: Baking, counters: Counters | None = None, report: Report = silent
) -> tuple[GaussianScene, tuple[str, ...]]:
    """The Gaussians that anchors, one at least, are baked into, and comments that say how."""
    views = baking.views or default_views(model)
    scene = bake(model, np.array([view.centre for view in views]), baking.sh_degree, counters)
    if baking.steps:
        from reference_decoder.refine import refined

        scene = refined(model, scene, views, baking.steps, report)
    return scene, bake_comments(len(views), baking.steps, baking.sh_degree)


@contextmanager
def target_of(destination: str | os.PathLike[str] | BinaryIO, force: bool) -> Iterator[BinaryIO]:
    """The target of a file: one that appears whole or not at all, or an open stream.

    Raises:
        InvalidInput: ``output-exists``, ``output-path``.
    """
    if isinstance(destination, str | os.PathLike):
        with atomic_write(destination, force=force) as stream:
            yield stream
    else:
        yield destination
