"""From a file to its Gaussians, part by part, for writers of other formats; anchors are baked whole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from reference_decoder.decode import DecodeRequest, Decoding
from reference_decoder.region import tile_boxes
from scarfmt.blocks.metadata import describe
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import Report, silent
from scarfmt.container.schema import Profile
from scarfmt.container.source import ByteSource
from scarfmt.counters import Counters
from scarfmt.errors import InvalidInput
from scarfmt.formats.output import Described
from scarfmt.scene.gaussians import GaussianScene

if TYPE_CHECKING:
    from reference_decoder.bake import Baking


def stream_gaussians(
    source: ByteSource,
    request: DecodeRequest,
    *,
    baking: Baking | None = None,
    counters: Counters | None = None,
    report: Report = silent,
) -> tuple[Described, Iterator[GaussianScene]]:
    """The properties of the scene of a file, and its Gaussians, one tile at a time.

    Args:
        source: the file, open until the parts were taken.
        request: what to decode; all attributes are needed.
        baking: anchor profile: how it is baked, which loses its view dependence.
        counters: all that is read and decoded is added to them.
        report: called with (stage, fraction done) while anchors are refined.

    Raises:
        InvalidInput: the request does not fit; ``input-bake`` for an anchor model without `baking`.
        Malformed, Unsupported, LimitExceeded: the file is refused (SPEC §12), now or while the parts are taken.
    """
    decoding = Decoding(source, request, counters)
    fields = decoding.reader.header.fields
    if fields.profile == Profile.EXPLICIT:
        count = int(decoding.counts.sum()) if request.box is None else None
        described = describe_output(decoding.reader, count)
        return described, decoding.parts(decoding.gaussians)
    if baking is None:
        raise InvalidInput("input-bake", "an anchor model has no fixed Gaussians until it is baked")
    from reference_decoder.bake import bake_model

    model = decoding.whole(decoding.anchors).activate()
    assert not isinstance(model, GaussianScene)
    scene, comments = bake_model(model, baking, report) if len(model) else (None, ())
    described = replace(describe_output(decoding.reader), sh_degree=baking.sh_degree, comments=comments)
    return described, iter([] if scene is None else [scene])


def describe_output(reader: SceneReader, count: int | None = None) -> Described:
    """The properties of the scene of a file, of which `count` Gaussians will be written; None where that is unknown."""
    fields = reader.header.fields
    description = describe(reader.container)
    boxes = np.concatenate(tile_boxes(reader.lattice, reader.container.tile_table))
    return Described(fields.sh_degree, fields.coordinate_frame, description, count, places=boxes)
