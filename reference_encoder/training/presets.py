"""The presets of training, and its curriculum: what is on at which part of the run (paper §3.6).

Everything is a fraction of the run, so that short runs keep the order of long ones.
"""

from __future__ import annotations

from dataclasses import dataclass

Span = tuple[float, float]
"""From and to, as fractions of the run; from is inside, to is not."""
NEVER = (1.0, 1.0)


@dataclass(frozen=True)
class Curriculum:
    """When things start and end; fractions 0..1 of the run.

    Attributes:
        statistics: gathered for growing and pruning.
        growth: anchors grow and are pruned.
        pause: no growth, because noise has just begun.
        noise: scaling and offsets are drawn with uniform noise of one step; after it they are rounded, with a
            straight-through gradient, and before it exact.
        rate: from the first number on geometry and masks cost their bits, in full from the second.
        exposures_from: exposures of photos are fitted, and applied where they differ.
        layers_from: each iteration draws a layer; before, all of the scene is trained.
        injection: beta grows from 0 to 1; codebooks start at its beginning (paper: 10k to 30k of 40k).
        masks_until: from the start of `rate` to here it is decided again and again what each layer shows.
        entropy_from: the index network learns along.
        hard_from: features are the quantised ones, codewords are chosen by distortion plus lambda times bits, and the
            picture's gradient reaches decoder and books.
        fine_tune_from: everything is the integers of the file; networks and decoder alone go on learning.
        averages: over each of these spans what is learnt is averaged, and goes on from its mean.
        starved: take the paper's formula at its word: in the soft phase a feature gets 1 - beta of its gradient.
    """

    statistics: Span = (0.0125, 0.375)
    growth: Span = (0.0375, 0.375)
    pause: Span = (0.075, 0.1)
    noise: Span = (0.075, 0.75)
    rate: Span = (0.12, 0.3)
    exposures_from: float = 0.1
    layers_from: float = 0.25
    masks_until: float = 0.85
    injection: Span = (0.25, 0.75)
    entropy_from: float = 0.5
    hard_from: float = 0.75
    fine_tune_from: float = 0.95
    averages: tuple[Span, ...] = ((0.87, 0.95), (0.97, 1.0))
    starved: bool = False


@dataclass(frozen=True)
class Moment:
    """The parts of training that are on at one iteration.

    Attributes:
        gathers, grows: statistics of anchors; growing and pruning.
        noisy, rounded: how scaling and offsets are drawn; exact if neither.
        rate: weight of the rate of geometry and masks, 0..1.
        masks: how much of the time in which masks are decided is over, 0..1.
        exposes: whether exposures of photos are fitted.
        quantises: whether there are codebooks.
        beta: share of the quantised feature in the one that is drawn, 0..1.
        feature_gradient: what a feature gets of the picture's gradient past the quantiser; in the hard phase it
            comes through the quantiser, and this is 0.
        draws_layer, entropy, hard, fine_tunes, averages: as `Curriculum` has them.
    """

    gathers: bool
    grows: bool
    noisy: bool
    rounded: bool
    rate: float
    masks: float
    exposes: bool
    draws_layer: bool
    quantises: bool
    beta: float
    feature_gradient: float
    entropy: bool
    hard: bool
    fine_tunes: bool
    averages: bool

    @property
    def decides(self) -> bool:
        """Whether masks are decided."""
        return 0 < self.masks < 1


def moment(curriculum: Curriculum, done: float) -> Moment:
    """The parts of training that are on when the fraction `done`, 0..1, of a run has passed."""
    masks = _rise((curriculum.rate[0], curriculum.masks_until), done)
    beta, hard = _rise(curriculum.injection, done), done >= curriculum.hard_from
    return Moment(
        gathers=_within(curriculum.statistics, done),
        grows=_within(curriculum.growth, done) and not _within(curriculum.pause, done),
        noisy=_within(curriculum.noise, done),
        rounded=done >= curriculum.noise[1],
        rate=_rise(curriculum.rate, done),
        masks=masks,
        exposes=done >= curriculum.exposures_from,
        draws_layer=done >= curriculum.layers_from,
        quantises=done >= curriculum.injection[0],
        beta=1.0 if hard else beta,
        feature_gradient=0.0 if hard else (1.0 - beta if curriculum.starved else 1.0),
        entropy=done >= curriculum.entropy_from,
        hard=hard,
        fine_tunes=done >= curriculum.fine_tune_from,
        averages=any(_within(span, done) for span in curriculum.averages),
    )


def _within(span: Span, done: float) -> bool:
    return span[0] <= done < span[1]


def _rise(span: Span, done: float) -> float:
    """0 before a span, 1 after it, linear inside; a span without length is a step."""
    first, last = span
    if done >= last:
        return 1.0
    return 0.0 if done <= first else (done - first) / (last - first)


PAPER_CURRICULUM = Curriculum(
    # What the paper states, of 40k iterations: 10k without a quantiser and with noise, 20k of injection, 10k hard with
    # the rate. It names no layer draw, no rate before 30k, no fine-tuning and no means. Densification is that of PCGS.
    noise=(0.0, 0.25),
    pause=NEVER,
    rate=(0.75, 0.75),
    layers_from=0.75,
    entropy_from=0.75,
    fine_tune_from=1.0,
    averages=(),
    starved=True,
)


CODEWORDS, DIMENSION = 1024, 16


@dataclass(frozen=True)
class Preset:
    """The settings of training that are not options of the user.

    Attributes:
        features: D, of anchors; as many hidden units.
        stages: of the quantiser of features, which has `CODEWORDS` of `DIMENSION` numbers in a book; 0: latents number
            by number.
        curriculum: when what happens.
        paper: the paper's projector and index network, and codewords chosen by distortion alone.
        camera_jitter: standard deviation of the place from where networks look about the camera while they learn, in
            distances between cameras. What holds at one place alone shows nowhere else.
    """

    features: int = 32
    stages: int = 0
    curriculum: Curriculum = Curriculum()
    paper: bool = False
    camera_jitter: float = 0.28


PRESETS = {
    "default": Preset(),
    "rvq": Preset(stages=4),
    "paper": Preset(features=50, stages=4, curriculum=PAPER_CURRICULUM, paper=True, camera_jitter=0.0),
}
"""By name: "rvq" is the paper's quantiser under the curriculum of "default"."""
