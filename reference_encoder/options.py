"""The options of the encoder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from scarfmt.blocks.metadata import pack_metadata
from scarfmt.errors import InvalidInput
from scarfmt.limits import MAX_ANCHORS_PER_TILE, MAX_LAYERS, MAX_VIEWPOINTS

if TYPE_CHECKING:  # the command line needs the options before anything is drawn
    from scarfmt.render.camera import Camera

LATENTS = ("linear", "learned")
ESTIMATORS = ("rotation", "straight-through")
MIN_QUALITY, MAX_QUALITY = 20.0, 80.0
MAX_CORRECTIONS = 10
MIN_TILE_ANCHORS = 1024
"""Below, framing outweighs content."""
DEFAULT_RANGE, MIN_RANGE = 1_000_000, 1000
"""Gaussians of a range, where a scene is encoded in ranges: about a gigabyte of memory at effort 1."""
DEFAULT_MBIT = 20.0
MIN_MBIT, MAX_MBIT = 0.01, 100_000.0


@dataclass(frozen=True)
class EncodeOptions:
    """Options of `encode`.

    Attributes:
        quality: PSNR in dB, against the source, that pictures of the last layer have on average, from wherever views
            are drawn that nothing was decided by; 20..80.
        worst: dB that 19 of 20 of the views have by which results are judged (their 5th percentile), in place of a
            mean; 20..80, or None.
        effort: 1 fast, static tables alone; 2 default; 3 slow: size of the training sample, epochs, codebooks, views,
            networks tried, corrections.
        corrections: how often at most lambda is corrected by what pictures of the result show, 0..10; 0 takes the
            predicted one, None what `effort` says.
        layers: most layers, 1..16. The first takes about a quarter of the bytes, from effort 2 as few as give a picture
            of 25 dB.
        cameras: views that matter most, e.g. those of the photos; None for everywhere alike.
        only_cameras: whether nothing but `cameras` matters: what they do not see is coarse or gone.
        frame: up axis, or UP:CENTRE_DEG:SPAN_DEG for a scene seen from one side; "auto" for the up axis that the
            scene seems to have.
        latent: "linear" (a weighted Karhunen-Loève basis, the default as measured) or "learned" (the paper's
            RVQ-VAE).
        estimator: gradient through the learned latent's quantiser: "rotation" or "straight-through".
        mbit: the bandwidth that files are made for, megabits per second, 0.01..100000; None for 20. A network is
            kept where transfer and decoding together (`scarfmt.coding.decoder_model`) get shorter.
        archive: bytes alone count, whatever decoding takes; excludes `mbit`.
        decode_budget: most multiply-adds of integer networks an anchor may cost a decoder; 0 for static tables alone,
            None for no bound beside `mbit`.
        tile_anchors: most anchors of a tile, 1024..65536; None for 32768, and 16384 in scenes of more than 262,144.
            With smaller tiles the file is larger, decoding a region of it cheaper, and decoding all of it slower.
        viewpoints: from how many places clients are told what layers of tiles gain (SPEC §7.13), 0..64; 0 for no such
            block. None for 4 to 8, as many as take a two-hundredth of the file. Of a single tile only its box and,
            where cameras are given, a view to begin with are then told.
        seed: of everything random. The same scene, options, seed, versions of packages and BLAS kernel give the same
            bytes, with any number of threads. Another BLAS kernel, which OpenBLAS chooses by the processor, can change
            last bits of binary64 numbers in the file, such as the first widths in LAYER; decoded values then agree
            within the tolerance of SPEC §9.5 on all scenes tried, which is not promised.
        metadata: JSON-able annotations to store, nested at most 64 deep.
    """

    quality: float = 45.0
    worst: float | None = None
    effort: int = 2
    corrections: int | None = None
    layers: int = 5
    cameras: Sequence[Camera] | None = None
    only_cameras: bool = False
    frame: str = "auto"
    latent: str = "linear"
    estimator: str = "rotation"
    mbit: float | None = None
    archive: bool = False
    decode_budget: int | None = None
    tile_anchors: int | None = None
    viewpoints: int | None = None
    seed: int = 0
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @property
    def asked_db(self) -> float:
        """The target: a mean or a least PSNR, dB."""
        return self.quality if self.worst is None else self.worst

    @property
    def bits_per_ns(self) -> float:
        """Bits that a nanosecond of decoding is worth: what is transferred meanwhile, 0 where bytes alone count."""
        return 0.0 if self.archive else (DEFAULT_MBIT if self.mbit is None else self.mbit) / 1000

    @property
    def trains_networks(self) -> bool:
        """Whether integer networks are tried, and kept where they pay."""
        return EFFORTS[self.effort].networks and self.decode_budget != 0

    @property
    def needs_torch(self) -> bool:
        """Whether torch has to be there, for an explicit scene; measuring an anchor model needs it always."""
        return self.trains_networks or self.latent == "learned"

    def check(self) -> None:
        """Check ranges, and that a file can hold the metadata.

        Raises:
            InvalidInput: ``input-options``, ``input-frame``.
        """
        from scarfmt.render.camera import check_frame

        check_frame(self.frame)
        if not MIN_QUALITY <= self.quality <= MAX_QUALITY:
            raise InvalidInput("input-options", f"quality {self.quality} is not in 20..80", field="quality")
        if self.worst is not None and not MIN_QUALITY <= self.worst <= MAX_QUALITY:
            raise InvalidInput("input-options", f"worst {self.worst} is not in 20..80", field="worst")
        if self.effort not in EFFORTS:
            raise InvalidInput("input-options", f"effort {self.effort} is not 1, 2 or 3", field="effort")
        if self.corrections is not None and not 0 <= self.corrections <= MAX_CORRECTIONS:
            message = f"{self.corrections} corrections: 0..{MAX_CORRECTIONS} are possible"
            raise InvalidInput("input-options", message, field="corrections")
        if not 1 <= self.layers <= MAX_LAYERS:
            raise InvalidInput("input-options", f"{self.layers} layers: 1..{MAX_LAYERS} are possible", field="layers")
        if self.mbit is not None and not MIN_MBIT <= self.mbit <= MAX_MBIT:
            message = f"{self.mbit} Mbit/s is not in {MIN_MBIT:g}..{MAX_MBIT:g}"
            raise InvalidInput("input-options", message, field="mbit")
        if self.archive and self.mbit is not None:
            message = "archive counts bytes alone, so a bandwidth says nothing: give one of them"
            raise InvalidInput("input-options", message, field="archive")
        if self.decode_budget is not None and self.decode_budget < 0:
            raise InvalidInput("input-options", f"decode budget {self.decode_budget} is below 0", field="decode_budget")
        if self.tile_anchors is not None and not MIN_TILE_ANCHORS <= self.tile_anchors <= MAX_ANCHORS_PER_TILE:
            message = f"tiles of {self.tile_anchors}: {MIN_TILE_ANCHORS}..{MAX_ANCHORS_PER_TILE} anchors are possible"
            raise InvalidInput("input-options", message, field="tile_anchors")
        if self.viewpoints is not None and not 0 <= self.viewpoints <= MAX_VIEWPOINTS:
            message = f"{self.viewpoints} viewpoints: 0..{MAX_VIEWPOINTS} are possible"
            raise InvalidInput("input-options", message, field="viewpoints")
        if self.only_cameras and self.cameras is None:
            raise InvalidInput("input-options", "only_cameras needs cameras", field="only_cameras")
        pack_metadata(self.metadata)
        for name, choices in (("latent", LATENTS), ("estimator", ESTIMATORS)):
            if getattr(self, name) not in choices:
                said = getattr(self, name)
                raise InvalidInput("input-options", f"{said!r} is not one of {', '.join(choices)}", field=name)
        pack_metadata(self.metadata)


@dataclass(frozen=True, kw_only=True)
class IndexTraining:
    """The effort of training an index network.

    Attributes:
        rows: most rows in the training sample. Many rows seen twice beat few seen often: what codewords of their own
            learn from a sample does not hold for the rest of the scene.
        visits: rows seen in all epochs together.
        most_epochs: of a small scene.
    """

    rows: int
    visits: int
    most_epochs: int


@dataclass(frozen=True, kw_only=True)
class PredictorTraining:
    """The effort of training a predictor.

    Attributes:
        units: hidden units.
        iterations: steps of the descent.
    """

    units: int
    iterations: int


@dataclass(frozen=True, kw_only=True)
class Effort:
    """The settings of an effort level.

    Attributes:
        sample: vectors the codebooks are trained on.
        epochs: passes over them.
        stages: RVQ stages tried.
        survey_views: views of the survey; more where a scene holds more.
        judged_views: small pictures of each kind a result is judged by.
        judged_gaussians: fewer, if a source of so many Gaussians would be drawn more than once for each kind.
        corrections: of lambda, by what these show.
        looks_at_layers: whether pictures decide what layers hold.
        networks: whether predictors and an index network are tried, and kept where they pay.
        attention: whether an index network with spatial-query attention is tried too.
        rounds: of choosing codewords again at the index network's prices.
        training: of the index network.
        predictors: of each predictor.
    """

    sample: int
    epochs: int
    stages: int
    survey_views: int
    judged_views: int
    judged_gaussians: int
    corrections: int
    looks_at_layers: bool
    networks: bool
    attention: bool
    rounds: int
    training: IndexTraining
    predictors: PredictorTraining


EFFORTS = {
    1: Effort(
        sample=32768,
        epochs=5,
        stages=2,
        survey_views=96,
        judged_views=128,
        judged_gaussians=8_000_000,
        corrections=4,
        looks_at_layers=False,
        networks=False,
        attention=False,
        rounds=0,
        training=IndexTraining(rows=200_000, visits=400_000, most_epochs=16),
        predictors=PredictorTraining(units=4, iterations=400),
    ),
    2: Effort(
        sample=65536,
        epochs=7,
        stages=2,
        survey_views=192,
        judged_views=128,
        judged_gaussians=16_000_000,
        corrections=5,
        looks_at_layers=True,
        networks=True,
        attention=False,
        rounds=1,
        training=IndexTraining(rows=500_000, visits=1_000_000, most_epochs=22),
        predictors=PredictorTraining(units=8, iterations=800),
    ),
    3: Effort(
        sample=262144,
        epochs=12,
        stages=3,
        survey_views=384,
        judged_views=192,
        judged_gaussians=64_000_000,
        corrections=6,
        looks_at_layers=True,
        networks=True,
        attention=True,
        rounds=3,
        training=IndexTraining(rows=4_000_000, visits=10_000_000, most_epochs=60),
        predictors=PredictorTraining(units=16, iterations=2000),
    ),
}
"""By level: docs/encoder-effort.md has them as a table."""
