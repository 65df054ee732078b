"""From a file to its Gaussians, part by part, for writers of other formats; anchors are baked whole."""

from __future__ import annotations

from collections.abc import Iterator

from reference_decoder.decode import decode_scene, iter_made
from reference_decoder.decoded import Decoded
from reference_decoder.request import DecodeRequest
from reference_decoder.stream_ply import Baking, baked, header_fields
from scarfmt.coding.writer import Report, silent
from scarfmt.container.schema import Profile
from scarfmt.container.source import Origin
from scarfmt.counters import Counters
from scarfmt.formats.output import Described
from scarfmt.scene.gaussians import AnchorModel, GaussianScene


def stream_gaussians(
    source: Origin,
    request: DecodeRequest,
    *,
    baking: Baking | None = None,
    counters: Counters | None = None,
    report: Report = silent,
) -> tuple[Described, Iterator[GaussianScene]]:
    """The properties of the scene of a file, and its Gaussians, one tile at a time.

    Args:
        source, request: as for :func:`reference_decoder.decode.decode`; all attributes are needed.
        baking: anchor profile: how it is baked.
        counters: all that is read, decoded and fitted is added to them.
        report: called with (stage, fraction done) while anchors are refined.

    Raises:
        Malformed, Unsupported, LimitExceeded: the file is refused (SPEC §12), now or while the parts are taken.
    """
    baking = baking or Baking()
    fields, _ = header_fields(source, request, counters)
    if fields.profile == Profile.EXPLICIT:
        parts, degree = iter_made(source, request, _scene, counters), fields.sh_degree
    else:
        parts, degree = _baked(source, request, baking, counters, report), baking.sh_degree
    return Described(degree, fields.coordinate_frame, fields.colour_space), parts


def _scene(part: Decoded, own: Counters | None) -> GaussianScene:
    scene = part.activated(counters=own)
    assert isinstance(scene, GaussianScene)
    return scene


def _baked(
    source: Origin, request: DecodeRequest, baking: Baking, counters: Counters | None, report: Report
) -> Iterator[GaussianScene]:
    model = decode_scene(source, request, counters=counters)
    assert isinstance(model, AnchorModel)
    if len(model):
        yield baked(model, baking, counters, report)[0]
