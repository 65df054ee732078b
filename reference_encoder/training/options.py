"""The options of training, its progress reports and its result."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from reference_encoder.training.presets import PRESETS
from scarfmt.errors import InvalidInput
from scarfmt.limits import MAX_LAYERS

DEVICES = ("cpu", "cuda")
HOLD_OUT = 8
"""The papers' convention: of the photos sorted by name, the first and every 8th after it are for tests."""
LEAST_RESOLUTION = 16
"""Pixels of a photo's longest side."""
DEFAULT_MINUTES = 60.0
PAPER_ITERATIONS = 40_000
MAX_MINUTES = 100_000.0
MAX_ITERATIONS = 10_000_000
MIN_LAMBDA, MAX_LAMBDA = 1e-3, 1e3
LAST_LAYER = 2.0
MIN_LAST_LAYER, MAX_LAST_LAYER = 1.0, 100.0
MIN_SIZE = 10_000
"""Bytes: networks alone take most of as many."""


@dataclass(frozen=True)
class TrainOptions:
    """Options of training.

    Attributes:
        minutes: how long it may take in all, with reading and writing, above 0. Excludes `iterations`.
        iterations: how many it takes, in place of a time. Neither: what the preset says (:meth:`resolve`).
        layers: of the file, 1..16.
        last_layer: how many times as often as each other layer the last one is trained, 1..100: more for a better file
            and worse prefixes.
        lambda_: factor of the rate in the loss, 0.001..1000: 1 as tuned, more for smaller files.
        size: target size of the file, bytes, prefixes in proportion; the weight of bytes follows, but not below 0.002
            times `lambda_`. None: fixed weights.
        preset: "default" (what pays in bytes), "rvq" (that, with codewords for features) or "paper" (its curriculum,
            codebooks and entropy model).
        device: "cpu" or "cuda".
        seed: of everything random. With `iterations`, the same capture, options, packages and machine give the same
            bytes; with `minutes` the number of iterations depends on how fast the machine happens to be.
    """

    minutes: float | None = None
    iterations: int | None = None
    layers: int = 4
    last_layer: float = LAST_LAYER
    lambda_: float = 1.0
    size: int | None = None
    preset: str = "default"
    device: str = "cpu"
    seed: int = 0

    def resolve(self) -> TrainOptions:
        """These options with one of `minutes` and `iterations` set: 60 minutes by default, 40,000 iterations as in the
        paper.
        """
        if self.minutes is not None or self.iterations is not None:
            return self
        if self.preset == "paper":
            return replace(self, iterations=PAPER_ITERATIONS)
        return replace(self, minutes=DEFAULT_MINUTES)

    def __post_init__(self) -> None:
        if self.minutes is not None and self.iterations is not None:
            raise _wrong("minutes", "minutes and iterations exclude each other: give one of them")
        if self.minutes is not None and not 0 < self.minutes <= MAX_MINUTES:
            raise _wrong("minutes", f"minutes is {self.minutes}: it must be above 0 and at most {MAX_MINUTES:.0f}")
        ranges = (
            ("iterations", self.iterations, 1, MAX_ITERATIONS),
            ("layers", self.layers, 1, MAX_LAYERS),
            ("last_layer", self.last_layer, MIN_LAST_LAYER, MAX_LAST_LAYER),
            ("lambda_", self.lambda_, MIN_LAMBDA, MAX_LAMBDA),
            ("size", self.size, MIN_SIZE, math.inf),
            ("seed", self.seed, 0, math.inf),
        )
        for name, value, least, most in ranges:
            if value is not None and not least <= value <= most:
                between = f"at least {least}" if most == math.inf else f"in {least:g}..{most:g}"
                raise _wrong(name, f"{name.rstrip('_')} is {value}: it must be {between}")
        for name, said, choices in (("preset", self.preset, PRESETS), ("device", self.device, DEVICES)):
            if said not in choices:
                raise _wrong(name, f"{said!r} is not one of {', '.join(choices)}")


FINISHING = "finishing"
"""The phase in which the file is made, and a draft of it is in the folder of the run."""


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
        held_out: names of the photos that were not learnt from.
        converged: whether a longer run would change little.
    """

    data: bytes = field(repr=False)
    layers: tuple[LayerQuality, ...]
    iterations: int
    seconds: float
    displacement: float = math.nan
    held_out: tuple[str, ...] = ()
    converged: bool = True


class Suspended(Exception):
    """Training was suspended before its end, as the caller asked, with a checkpoint to continue from.

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
    """False: train to the end."""
    return False


def _wrong(name: str, message: str) -> InvalidInput:
    return InvalidInput("input-options", message, field=name)
