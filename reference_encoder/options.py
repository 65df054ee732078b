"""What a user can ask of the encoder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from scarfmt.blocks.metadata import pack_metadata
from scarfmt.errors import InvalidInput
from scarfmt.limits import MAX_ANCHORS_PER_TILE, MAX_LAYERS
from scarfmt.render.camera import Camera

LATENTS = ("linear", "learned")
ESTIMATORS = ("rotation", "straight-through")
MIN_QUALITY, MAX_QUALITY = 20.0, 80.0
MAX_CORRECTIONS = 10
MIN_TILE_ANCHORS = 1024
"""Below, framing outweighs content."""


@dataclass(frozen=True)
class EncodeOptions:
    """Options of `encode`.

    Attributes:
        quality: about the PSNR in dB, against the source, of pictures of the last layer; 20..80.
        effort: 1 fast, static tables alone; 2 default; 3 slow: size of the training sample, epochs, codebooks, views,
            networks tried, corrections.
        corrections: how often at most lambda is corrected by what pictures of the result show, 0..10; 0 takes the
            predicted one, None what `effort` says, and at effort 1 none of scenes of more than 262,144. Of explicit
            scenes only.
        layers: most layers, 1..16. The first takes about a quarter of the bytes, from effort 2 as few as give a picture
            of 25 dB.
        cameras: views that matter, e.g. those of the photos; None for rings round the core.
        frame: up axis, or UP:CENTRE_DEG:SPAN_DEG for a scene seen from one side.
        latent: "linear" (a weighted Karhunen-Loève basis, the default as measured) or "learned" (the paper's
            RVQ-VAE).
        estimator: gradient through the learned latent's quantiser: "rotation" or "straight-through".
        decode_budget: most multiply-adds of integer networks an anchor may cost a decoder; 0 for static tables alone,
            None for whatever makes the file smallest.
        tile_anchors: most anchors of a tile, 1024..65536; None for 32768, and 16384 in scenes of more than 262,144.
            With smaller tiles the file is larger, decoding a region of it cheaper, and decoding all of it slower.
        seed: of everything random; same seed, same bytes.
        metadata: JSON-able annotations to store.
    """

    quality: float = 45.0
    effort: int = 2
    corrections: int | None = None
    layers: int = 5
    cameras: Sequence[Camera] | None = None
    frame: str = "-y"
    latent: str = "linear"
    estimator: str = "rotation"
    decode_budget: int | None = None
    tile_anchors: int | None = None
    seed: int = 0
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def check(self) -> None:
        """Check ranges, and that a file can hold the metadata.

        Raises:
            InvalidInput: ``input-options``.
        """
        if not MIN_QUALITY <= self.quality <= MAX_QUALITY:
            raise InvalidInput("input-options", f"quality {self.quality} is not in 20..80", field="quality")
        if self.effort not in (1, 2, 3):
            raise InvalidInput("input-options", f"effort {self.effort} is not 1, 2 or 3", field="effort")
        if self.corrections is not None and not 0 <= self.corrections <= MAX_CORRECTIONS:
            message = f"{self.corrections} corrections: 0..{MAX_CORRECTIONS} are possible"
            raise InvalidInput("input-options", message, field="corrections")
        if not 1 <= self.layers <= MAX_LAYERS:
            raise InvalidInput("input-options", f"{self.layers} layers: 1..{MAX_LAYERS} are possible", field="layers")
        if self.decode_budget is not None and self.decode_budget < 0:
            raise InvalidInput("input-options", f"a budget of {self.decode_budget}: 0 is least", field="decode_budget")
        if self.tile_anchors is not None and not MIN_TILE_ANCHORS <= self.tile_anchors <= MAX_ANCHORS_PER_TILE:
            message = f"tiles of {self.tile_anchors}: {MIN_TILE_ANCHORS}..{MAX_ANCHORS_PER_TILE} anchors are possible"
            raise InvalidInput("input-options", message, field="tile_anchors")
        for name, choices in (("latent", LATENTS), ("estimator", ESTIMATORS)):
            if getattr(self, name) not in choices:
                said = getattr(self, name)
                raise InvalidInput("input-options", f"{said!r} is not one of {', '.join(choices)}", field=name)
        pack_metadata(self.metadata)


@dataclass(frozen=True)
class Effort:
    """What an effort level means.

    Attributes:
        sample: vectors the codebooks are trained on.
        epochs: passes over them.
        stages: RVQ stages tried.
        thorough_views: twice the survey views.
        judged_views: pictures a result is judged by.
        corrections: of lambda, by what these show.
        looks_at_layers: whether pictures decide what layers hold.
    """

    sample: int
    epochs: int
    stages: int
    thorough_views: bool
    judged_views: int
    corrections: int
    looks_at_layers: bool


EFFORTS = {
    1: Effort(32768, 5, 2, False, 4, 2, False),
    2: Effort(65536, 7, 2, False, 6, 2, True),
    3: Effort(262144, 12, 3, True, 12, 3, True),
}
