"""The options of training, its progress reports and its result."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from scarfmt.errors import InvalidInput
from scarfmt.limits import MAX_LAYERS

PRESETS = ("default", "rvq", "paper")
DEVICES = ("cpu", "cuda")
CONTEXTS = ("decoded", "grid2d3d", "grid3d", "waves", "none")
ENTROPY_MODELS = ("static", "mlp", "gru", "gru+attention")
HOLD_OUT = 8
"""The papers' convention: of the photos sorted by name, the first and every 8th after it are for tests."""
LEAST_RESOLUTION = 16
"""Pixels of a photo's longest side."""
DEFAULT_MINUTES = 60.0
PAPER_ITERATIONS = 40_000
MAX_MINUTES = 100_000.0
MAX_ITERATIONS = 10_000_000
MIN_LAMBDA, MAX_LAMBDA = 1e-3, 1e3
LAMBDA_SSIM = 0.2
"""The weight of SSIM in 3DGS, Scaffold-GS and similar methods."""
LAST_LAYER = 2.0
MIN_LAST_LAYER, MAX_LAST_LAYER = 1.0, 100.0
MIN_SIZE = 10_000
"""Bytes: networks alone take most of as many."""


@dataclass(frozen=True)
class TrainOptions:
    """Options of training.

    Attributes:
        minutes: how long it may take, above 0; all schedules are fractions of it. Excludes `iterations`.
        iterations: how many it takes, in place of a time. None of both: what the preset says (:meth:`settled`).
        layers: of the file, 1..16.
        last_layer: how many times as often as each other layer the last one is trained, 1..100: more for a better file
            and worse prefixes.
        lambda_: factor of the rate in the loss, 0.001..1000: 1 as tuned, more for smaller files.
        lambda_ssim: share of 1 - SSIM in what a picture lacks, 0..1; the rest is L1 (paper §3.5).
        size: bytes that the file shall have, about, prefixes in proportion; prices of bits follow, not below `lambda_`
            times `price.LEAST_PRICE`. None: fixed prices.
        preset: "default" (what pays in bytes) or "paper" (its curriculum, codebooks and entropy model).
        device: "cpu" or "cuda".
        context: what the index network sees: "decoded", "grid2d3d", "grid3d", "waves" or "none"; None for what the
            preset says.
        entropy: what codes the indices: "static", "mlp", "gru" or "gru+attention"; None for what the preset says.
        seed: of everything random. With `iterations`, the same capture, options, packages and machine give the same
            bytes; with `minutes` the number of iterations depends on how fast the machine happens to be.
    """

    minutes: float | None = None
    iterations: int | None = None
    layers: int = 4
    last_layer: float = LAST_LAYER
    lambda_: float = 1.0
    lambda_ssim: float = LAMBDA_SSIM
    size: int | None = None
    preset: str = "default"
    device: str = "cpu"
    context: str | None = None
    entropy: str | None = None
    seed: int = 0

    def settled(self) -> TrainOptions:
        """These options with one of `minutes` and `iterations` set: 60 minutes by default, 40,000 iterations as in the
        paper.

        Raises:
            InvalidInput: ``input-options``.
        """
        self.check()
        if self.minutes is not None or self.iterations is not None:
            return self
        if self.preset == "paper":
            return replace(self, iterations=PAPER_ITERATIONS)
        return replace(self, minutes=DEFAULT_MINUTES)

    def check(self) -> None:
        """Check ranges and choices.

        Raises:
            InvalidInput: ``input-options``.
        """
        if self.minutes is not None and self.iterations is not None:
            raise _wrong("minutes", "minutes and iterations exclude each other: give one of them")
        if self.minutes is not None and not 0 < self.minutes <= MAX_MINUTES:
            raise _wrong("minutes", f"{self.minutes} minutes: above 0, at most {MAX_MINUTES:.0f} are possible")
        if self.iterations is not None and not 1 <= self.iterations <= MAX_ITERATIONS:
            raise _wrong("iterations", f"{self.iterations} iterations: 1..{MAX_ITERATIONS} are possible")
        if not 1 <= self.layers <= MAX_LAYERS:
            raise _wrong("layers", f"{self.layers} layers: 1..{MAX_LAYERS} are possible")
        if not MIN_LAST_LAYER <= self.last_layer <= MAX_LAST_LAYER:
            message = f"{self.last_layer} times as often is not in {MIN_LAST_LAYER:g}..{MAX_LAST_LAYER:g}"
            raise _wrong("last_layer", message)
        if not MIN_LAMBDA <= self.lambda_ <= MAX_LAMBDA:
            raise _wrong("lambda_", f"lambda {self.lambda_} is not in {MIN_LAMBDA:g}..{MAX_LAMBDA:g}")
        if not 0 <= self.lambda_ssim <= 1:
            raise _wrong("lambda_ssim", f"lambda of SSIM {self.lambda_ssim} is not in 0..1")
        if self.size is not None and self.size < MIN_SIZE:
            raise _wrong("size", f"{self.size} bytes: {MIN_SIZE} is least")
        if self.seed < 0:
            raise _wrong("seed", f"seed {self.seed} is below 0")
        _check_choice("preset", self.preset, PRESETS)
        _check_choice("device", self.device, DEVICES)
        if self.context is not None:
            _check_choice("context", self.context, CONTEXTS)
        if self.entropy is not None:
            _check_choice("entropy", self.entropy, ENTROPY_MODELS)


@dataclass(frozen=True)
class Progress:
    """The progress of training.

    Attributes:
        iteration: the last one done, from 1.
        iterations: all of them, as planned now.
        seconds: spent, those before a resumption included.
        seconds_left: until the end, as expected now.
        phase: what is being learnt, a few words.
        psnr: dB on held-out photos, all layers, as last measured; None before that, or with no photo held out.
        bytes: of the file, all layers, as last measured or estimated; None before that.
        anchors: how many there are.
        gaussians: how many of their slots are open.
        loss: of the last iterations, averaged.
    """

    iteration: int
    iterations: int
    seconds: float
    seconds_left: float
    phase: str
    psnr: float | None
    bytes: int | None
    anchors: int
    gaussians: int
    loss: float


@dataclass(frozen=True)
class LayerQuality:
    """The quality of a file up to one of its layers.

    Attributes:
        bytes: of the file cut after this layer.
        psnr: mean PSNR over the held-out photos, dB, of pictures that training draws of the values it wrote, rounded
            to 8 bits; NaN without any.
        ssim: mean of the SSIM; NaN without any.
    """

    bytes: int
    psnr: float = math.nan
    ssim: float = math.nan


@dataclass(frozen=True)
class Trained:
    """The result of training.

    Attributes:
        data: a whole .scar file.
        layers: of each layer, from the first.
        iterations: how many were done.
        seconds: spent, those before a resumption included.
        displacement: mean distance, pixels, of pictures from their photos; far from 0 where poses do not fit together,
            NaN where it cannot be told.
    """

    data: bytes
    layers: tuple[LayerQuality, ...]
    iterations: int
    seconds: float
    displacement: float = math.nan


class LeftOff(Exception):
    """Training left off before its end, as it was asked to, with a checkpoint to go on from.

    Attributes:
        progress: where it stands.
    """

    def __init__(self, progress: Progress) -> None:
        super().__init__(f"left off after iteration {progress.iteration:,} of {progress.iterations:,}")
        self.progress = progress


Report = Callable[[Progress], None]
Stop = Callable[[], bool]


def silent(_progress: Progress) -> None:
    """A report that goes nowhere."""


def never() -> bool:
    """A stop that nobody asks for."""
    return False


def _check_choice(name: str, said: str, choices: tuple[str, ...]) -> None:
    if said not in choices:
        raise _wrong(name, f"{said!r} is not one of {', '.join(choices)}")


def _wrong(name: str, message: str) -> InvalidInput:
    return InvalidInput("input-options", message, field=name)
