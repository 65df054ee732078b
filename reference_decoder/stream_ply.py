"""From a file to a PLY, tile by tile: memory does not grow with the scene."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import BinaryIO, Unpack

import numpy as np

from reference_decoder.bake import bake, default_eyes
from reference_decoder.bake import comments as bake_comments
from reference_decoder.decode import iter_made, iter_tiles
from reference_decoder.decoded import Decoded
from reference_decoder.request import DecodeRequest, RequestFields, requested
from scarfmt.arrays import F32, F64
from scarfmt.atomic import atomic_write
from scarfmt.coding.reader import SceneReader
from scarfmt.container.header import HeaderFields
from scarfmt.container.schema import Profile
from scarfmt.container.source import Origin, opened
from scarfmt.counters import Counters, transfers
from scarfmt.formats.export_ply import ply_header, ply_rows, property_names
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

Rows = tuple[F32, tuple[str, ...]]
"""Rows of a PLY, (n, properties) float32, and the comments that belong to them."""
_SPOOL_BYTES = 1 << 26
_EYE_SAMPLE = 1 << 16


def export_ply(
    source: Origin,
    destination: str | os.PathLike[str] | BinaryIO,
    request: DecodeRequest | None = None,
    *,
    eyes: F64 | None = None,
    bake_degree: int = 2,
    comments: Sequence[str] = (),
    force: bool = False,
    counters: Counters | None = None,
    **fields: Unpack[RequestFields],
) -> int:
    """Write what a file holds as an INRIA PLY. An anchor model is baked, which loses its view dependence.

    Args:
        source, request, fields: as for :func:`reference_decoder.decode.decode`; all attributes are needed.
        destination: a path, written whole or not at all, or an open binary file.
        eyes: anchor profile: (E, 3) camera centres to fit at. Give those the scene was captured from: the default,
            a sphere round the scene, sees anchors as no training camera did.
        bake_degree: anchor profile: degree of the fitted spherical harmonics, 0..3.
        comments: header comment lines, ASCII, after those of a baked model.
        force: overwrite an existing file.
        counters: all that is read and computed is added to them.

    Returns:
        Gaussians written.

    Raises:
        InvalidInput: the file exists and `force` is not set, a comment cannot be written, or the request does not fit.
        Malformed, Unsupported, LimitExceeded: the file is refused (SPEC §12).
    """
    wanted = requested(request, fields)

    def parts(attributes: frozenset[str] | None = None) -> Iterator[Decoded]:
        chosen = wanted if attributes is None else replace(wanted, attributes=attributes)
        return iter_tiles(source, chosen, counters=counters)

    ply_header(0, [], comments)  # a comment that cannot be written is better refused before than after decoding
    header, anchors = _facts(source, wanted, counters)
    explicit = header.profile == Profile.EXPLICIT
    names = property_names(((header.sh_degree if explicit else bake_degree) + 1) ** 2 - 1)
    rows = _rows(source, wanted, counters) if explicit else _baked(parts, eyes, bake_degree, counters)
    with _target(destination, force) as target:
        if not explicit or wanted.tiles is not None or wanted.box is not None:
            return _write_counting(rows, target, names, comments)
        target.write(ply_header(anchors, names, comments))
        for table, _ in rows:
            target.write(table.data)
        return anchors


def _facts(source: Origin, request: DecodeRequest, counters: Counters | None) -> tuple[HeaderFields, int]:
    """Header fields, and anchors after the layers requested, which the directory confirms."""
    with opened(source) as stream, transfers(stream, counters):
        reader = SceneReader(stream, limits=request.limits, allow_truncated=request.allow_truncated)
        return reader.header.fields, reader.header.layers[reader.layer_number(request.layers) - 1].anchor_count


def _write_counting(rows: Iterator[Rows], target: BinaryIO, names: list[str], comments: Sequence[str]) -> int:
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
    parts: Callable[[frozenset[str] | None], Iterator[Decoded]],
    eyes: F64 | None,
    degree: int,
    counters: Counters | None,
) -> Iterator[Rows]:
    """The Gaussians that the anchors of each tile are baked into."""
    for part in parts(None):
        scene = part.activated(counters=counters)
        assert isinstance(scene, AnchorModel)
        if eyes is None:
            eyes = default_eyes(_sample(parts(frozenset({"positions"}))))
        yield ply_rows(bake(scene, eyes, degree, counters)), bake_comments(len(eyes), degree)


def _sample(parts: Iterator[Decoded]) -> F64:
    """(n, 3) positions of some anchors of every tile."""
    kept = [part.positions[:: 1 + len(part) // _EYE_SAMPLE] for part in parts if part.positions is not None]
    return np.concatenate(kept)


@contextmanager
def _target(destination: str | os.PathLike[str] | BinaryIO, force: bool) -> Iterator[BinaryIO]:
    if isinstance(destination, str | os.PathLike):
        with atomic_write(destination, force=force) as stream:
            yield stream
    else:
        yield destination
