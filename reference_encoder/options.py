"""The options of the encoder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from scarfmt.blocks.metadata import pack_metadata
from scarfmt.errors import InvalidInput
from scarfmt.limits import MAX_ANCHORS_PER_TILE, MAX_LAYERS

if TYPE_CHECKING:  # the command line needs the options before anything is drawn
    from scarfmt.render.camera import Camera

MIN_QUALITY, MAX_QUALITY = 20.0, 80.0
MAX_CORRECTIONS = 10
MIN_TILE_ANCHORS = 1024
"""Below, framing outweighs content."""
DEFAULT_RANGE, MIN_RANGE = 1_000_000, 1000
"""Gaussians of a range, where a scene is encoded in ranges: about a gigabyte of memory at effort 1."""

STAGES = {"visibility": 0.17, "fit": 0.6, "quality": 0.15, "code": 0.08}
"""What `encode` reports, in order, with the part of the time that each stage takes of 14,428 Gaussians at effort 1."""


@dataclass(frozen=True)
class EncodeOptions:
    """Options of `encode`, checked when they are made.

    Attributes:
        quality: PSNR in dB, against the source, that pictures of the last layer have on average, from wherever views
            are drawn that nothing was decided by; 20..80.
        worst: dB that 19 of 20 of the views have by which results are judged (their 5th percentile), in place of a
            mean; 20..80, or None.
        effort: 0 a draft that weighs Gaussians by size and opacity and looks at nothing but the result; 1 a survey,
            and layers chosen from pictures; 2 a survey of twice as many views.
        corrections: how often at most lambda is corrected by what pictures of the result show, 0..10; 0 takes the
            predicted one, None what `effort` says.
        layers: most layers, 1..16. The first takes as few bytes as give a picture of 25 dB, of a draft about a quarter.
        cameras: views that matter most, e.g. those of the photos; None for everywhere alike.
        only_cameras: whether nothing but `cameras` matters: what they do not see is coarse or gone.
        frame: up axis, or UP:CENTRE_DEG:SPAN_DEG for a scene seen from one side; "auto" for the up axis that the
            scene seems to have.
        tile_anchors: most anchors of a tile, 1024..65536; None for 32768, and 16384 in scenes of more than 262,144.
            With smaller tiles the file is larger, decoding a region of it cheaper, and decoding all of it slower.
        seed: of everything random. The same scene, options, seed, versions of packages and BLAS kernel, which OpenBLAS
            chooses by the processor, give the same bytes, with any number of threads.
        metadata: JSON-able annotations to store, nested at most 64 deep.

    Raises:
        InvalidInput: ``input-options``, ``input-frame``.
    """

    quality: float = 45.0
    worst: float | None = None
    effort: int = 1
    corrections: int | None = None
    layers: int = 5
    cameras: Sequence[Camera] | None = None
    only_cameras: bool = False
    frame: str = "auto"
    tile_anchors: int | None = None
    seed: int = 0
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @property
    def asked_db(self) -> float:
        """The target: a mean or a least PSNR, dB."""
        return self.quality if self.worst is None else self.worst

    def __post_init__(self) -> None:
        if self.frame != "auto":
            from scarfmt.render.camera import check_frame

            check_frame(self.frame)
        if not MIN_QUALITY <= self.quality <= MAX_QUALITY:
            raise InvalidInput("input-options", f"quality {self.quality} is not in 20..80", field="quality")
        if self.worst is not None and not MIN_QUALITY <= self.worst <= MAX_QUALITY:
            raise InvalidInput("input-options", f"worst {self.worst} is not in 20..80", field="worst")
        if self.effort not in EFFORTS:
            raise InvalidInput("input-options", f"effort {self.effort} is not 0, 1 or 2", field="effort")
        if self.corrections is not None and not 0 <= self.corrections <= MAX_CORRECTIONS:
            message = f"corrections is {self.corrections}: it must be between 0 and {MAX_CORRECTIONS}"
            raise InvalidInput("input-options", message, field="corrections")
        if not 1 <= self.layers <= MAX_LAYERS:
            message = f"layers is {self.layers}: it must be between 1 and {MAX_LAYERS}"
            raise InvalidInput("input-options", message, field="layers")
        if self.tile_anchors is not None and not MIN_TILE_ANCHORS <= self.tile_anchors <= MAX_ANCHORS_PER_TILE:
            bounds = f"between {MIN_TILE_ANCHORS} and {MAX_ANCHORS_PER_TILE}"
            message = f"tile_anchors is {self.tile_anchors}: it must be {bounds}"
            raise InvalidInput("input-options", message, field="tile_anchors")
        if self.effort == 0 and self.cameras is not None:
            raise InvalidInput("input-options", "effort 0 weighs without views: cameras need effort 1", field="cameras")
        if self.only_cameras and self.cameras is None:
            raise InvalidInput("input-options", "only_cameras needs cameras", field="only_cameras")
        pack_metadata(self.metadata)


@dataclass(frozen=True, kw_only=True)
class Effort:
    """The settings of an effort level.

    Attributes:
        survey_views: views of the survey; more where a scene holds more; 0 for none.
        judged_views: small pictures of each kind a result is judged by.
        judged_gaussians: fewer, if a source of so many Gaussians would be drawn more than once for each kind.
        corrections: of lambda, by what these show.
    """

    survey_views: int
    judged_views: int
    judged_gaussians: int
    corrections: int


EFFORTS = {
    0: Effort(survey_views=0, judged_views=8, judged_gaussians=0, corrections=0),
    1: Effort(survey_views=96, judged_views=48, judged_gaussians=5_000_000, corrections=3),
    2: Effort(survey_views=192, judged_views=48, judged_gaussians=5_000_000, corrections=3),
}
"""By level."""
