"""The content of layers, chosen by prediction or from pictures (encoder side).

A layer shows the most important classes at some lambda; later layers show more classes at smaller lambdas. The first is
the picture somebody sees before the rest has arrived, the last is what `quality` asks for, and in between bytes grow by
like factors. The model of errors (docs/decisions/0003) is meant for small errors and ranks coarse pictures badly, so an
encoder draws them from effort 1 on (docs/decisions/0018-layers-by-looks.md). A first layer must not have holes: of the
classes it cannot show whole it shows those that cover most among their neighbours (0026-first-layers.md). It does
without colours that depend on the view where their models would take much of it, and shows the fewest classes that look
good enough (0060-fewest-classes.md) to the judge of files (0062-one-judge.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from reference_encoder.rdo.curves import RdCurve, StepChoices
from reference_encoder.rdo.rdo_input import RdoInput
from reference_encoder.tuning import (
    BELOW_DB,
    COARSE_ABSENCE,
    COARSER_LAMBDAS,
    DECODER_WEIGHT_BITS,
    FEWEST_DIVIDED,
    FRONT_CLASSES,
    FRONT_LAMBDA,
    FRONT_STEP,
    FRONT_STRIDE,
    LAMBDAS,
    LARGEST_LAMBDA_RATIO,
    LARGEST_SHARE,
    MOST_MODEL_SHARE,
    NEIGHBOURS,
    PICTURE_DB,
    USUAL_DB,
    WORTH_DB,
)
from scarfmt.arrays import F64, I64

Steps = tuple[int, ...]
"""Steps of each channel that a class receives."""
PreviewMetric = Callable[[Sequence[Steps], Sequence[float]], float]
"""From what each class of a layer receives, and the part of each that is there, to how good it looks, dB."""
Rating = Callable[["LayerChoice"], float]
"""From a choice to how good it looks, dB."""


@dataclass(frozen=True)
class LayerChoice:
    """The choice of what a layer shows.

    Attributes:
        lambda_: squared picture error per bit.
        parts: of each class that is shown, the most important first, how much of it: 1 for all.
        latent: whether it shows colours that depend on the view, or features.
    """

    lambda_: float
    parts: tuple[float, ...]
    latent: bool = True

    @property
    def shown(self) -> int:
        """Classes of which anything is shown."""
        return len(self.parts)

    @property
    def without_parts(self) -> LayerChoice:
        """The layer once the parts of classes that it shows are classes of their own."""
        return replace(self, parts=(1.0,) * self.shown)


def show_whole(lambda_: float, shown: int) -> LayerChoice:
    """The layer that shows all of the first classes."""
    return LayerChoice(lambda_, (1.0,) * shown)


@dataclass(frozen=True)
class LayerCosts:
    """The costs and gains of layers.

    Attributes:
        curves: channels in coding order.
        presence_bits: lambda -> (classes,) bits of positions, labels and whatever else presence costs.
        sizes: (classes,) anchors; 0 where classes are shown whole or not at all.
        absence: (classes,) squared picture error of leaving the class out.
        model_bits: bits of the decoder of latents, which the first layer that has a latent carries too.
        last: lambda of the last layer.
    """

    curves: Sequence[RdCurve]
    presence_bits: Callable[[float], F64]
    sizes: I64
    absence: F64
    model_bits: float
    last: float
    _offers: dict[tuple[float, bool], tuple[F64, F64]] = field(default_factory=dict, init=False, repr=False)

    @property
    def final(self) -> LayerChoice:
        """The last layer."""
        return show_whole(self.last, len(self.absence))

    @property
    def least(self) -> LayerChoice:
        """The cheapest layer there is."""
        return show_whole(float(self.lambdas[-1]), 1)

    @cached_property
    def lambdas(self) -> F64:
        """Lambdas to choose from, rising from that of the last layer."""
        return np.asarray(self.last * np.geomspace(1, LARGEST_LAMBDA_RATIO, LAMBDAS))

    def steps(self, choice: LayerChoice) -> list[Steps]:
        """The steps that each class receives."""
        steps = self._choices.at(choice.lambda_, self.last, choice.latent)[0]
        return [tuple(map(int, column)) for column in steps[:, : choice.shown].T]

    def bits(self, choice: LayerChoice) -> float:
        """Bits up to a layer."""
        each = self._offer(choice.lambda_, choice.latent)[1]
        return float(self.model_bits * choice.latent + np.dot(choice.parts, each[: choice.shown]))

    def error(self, choice: LayerChoice) -> float:
        """Predicted squared picture error of a layer that shows whole classes."""
        left = self._offer(choice.lambda_, choice.latent)[0][: choice.shown]
        return float(left.sum() + self.absence[choice.shown :].sum())

    def pays(self, lambda_: float) -> NDArray[np.bool_]:
        """(classes,) whether each is predicted to be worth its bits at `lambda_`."""
        error, bits = self._offer(lambda_, True)
        return np.asarray(error + lambda_ * bits < self.absence)

    def affords_latents(self, share: float) -> bool:
        """Whether the models that latents need leave most of that share of the bits to the scene."""
        return self.model_bits <= MOST_MODEL_SHARE * share * self.bits(self.final)

    def affordable(self, kind: LayerChoice, bits: float) -> LayerChoice | None:
        """The layer like `kind` with the smallest lambda that takes at most `bits`; None if there is none."""
        for lambda_ in self.lambdas.tolist():
            choice = replace(kind, lambda_=lambda_)
            if self.bits(choice) <= bits:
                return choice
        return None

    def fronts(self) -> list[tuple[float, ...]]:
        """Parts that a first layer may show, growing: of the :data:`FRONT_CLASSES` last classes less and less."""
        classes = np.arange(len(self.sizes))
        found: dict[tuple[float, ...], None] = {}
        for front in np.arange(0, len(self.sizes), FRONT_STEP):
            parts = np.clip(np.rint(NEIGHBOURS * (1 - (classes - front) / FRONT_CLASSES)) / NEIGHBOURS, 0, 1)
            parts = np.where(self.sizes < FEWEST_DIVIDED, np.ceil(parts), parts)
            found.setdefault(tuple(float(part) for part in parts if part > 0))
        return list(found)

    @cached_property
    def _choices(self) -> StepChoices:
        return StepChoices.of(self.curves)

    def _offer(self, lambda_: float, latent: bool) -> tuple[F64, F64]:
        """(classes,) error left at a lambda, and bits taken, positions and labels among them; looked up once."""
        key = lambda_, latent
        if key not in self._offers:
            _, error, bits = self._choices.at(lambda_, self.last, latent)
            self._offers[key] = error, bits + self.presence_bits(lambda_)
        return self._offers[key]


def predict_later_layers(first: LayerChoice, costs: LayerCosts, layers: int) -> list[LayerChoice]:
    """The `first` layer of at least two, and those that are predicted to be best after it."""
    choices = [first]
    for lambda_ in reversed(costs.lambdas[costs.lambdas < first.lambda_]):
        paying = np.flatnonzero(costs.pays(float(lambda_)))
        choices.append(show_whole(float(lambda_), max([choices[-1].shown, *(paying[-1:] + 1).tolist()])))
    choices.append(costs.final)
    bits = np.array([costs.bits(choice) for choice in choices])
    between = np.geomspace(max(bits[0], 1.0), max(bits[-1], 1.0), layers)[1:-1]
    kept = {int(np.argmin(np.abs(bits - budget))) for budget in between} - {0, len(bits) - 1}
    return [choices[0], *(choices[k] for k in sorted(kept)), costs.final]


def predict_first_layer(costs: LayerCosts, share: float) -> LayerChoice:
    """The first layer of `share` of the bits that is good as a rule, without a look at it.

    Of the best looking ones lambda is about :data:`FRONT_LAMBDA` times that of the last layer.
    """
    budget, latent = share * costs.bits(costs.final), costs.affords_latents(share)
    kinds = (LayerChoice(costs.last, parts, latent) for parts in costs.fronts())
    choices = [choice for choice in (costs.affordable(kind, budget) for kind in kinds) if choice]
    return min(choices, key=lambda c: abs(np.log(c.lambda_ / (FRONT_LAMBDA * costs.last))), default=costs.least)


def find_first_layer(costs: LayerCosts, metric: PreviewMetric, quality: float, share: float) -> LayerChoice:
    """The smallest first layer that looks as good as :data:`PICTURE_DB`.

    If none does within :data:`LARGEST_SHARE` of the bits, the best within `share`.

    Args:
        costs: of layers.
        metric: how good a layer looks.
        quality: of the last layer, dB: the first stays well below.
        share: of the bits.
    """
    rate, wanted, all_bits = _rate_once(costs, metric), min(PICTURE_DB, quality - BELOW_DB), costs.bits(costs.final)
    kinds = [LayerChoice(costs.last, parts, costs.affords_latents(share)) for parts in costs.fronts()]
    usual = costs.last * 10 ** max(0.0, (quality - USUAL_DB) / 10)
    found = _find_smallest(costs, rate, kinds, usual, wanted, LARGEST_SHARE * all_bits)
    if found is not None:
        return found
    affordable = (costs.affordable(kind, share * all_bits) for kind in kinds[::FRONT_STRIDE])
    return max((choice for choice in affordable if choice), key=rate, default=costs.least)


def _rate_once(costs: LayerCosts, metric: PreviewMetric) -> Rating:
    """How good choices look, dB; each is looked at once, whatever lambdas lead to the same steps."""
    look = cache(lambda steps, parts: metric(list(steps), parts))
    return lambda choice: look(tuple(costs.steps(choice)), choice.parts)


def _find_smallest(
    costs: LayerCosts, rate: Rating, kinds: Sequence[LayerChoice], usual: float, wanted: float, most: float
) -> LayerChoice | None:
    """About the smallest layer of one of the growing `kinds` that looks good enough, None if that takes too much.

    Holes are what spoils a first picture, not coarse values: it is mostly the first kind that looks good enough at a
    lambda like `usual`, with the largest lambda that still does.
    """

    def usually(kind: LayerChoice) -> LayerChoice | None:
        finest = costs.affordable(kind, most)
        return finest and replace(kind, lambda_=max(finest.lambda_, usual))

    def excess(index: int) -> float:
        choice = usually(kinds[index])
        # What is out of reach is too much, not too little: smaller ones are looked for before it.
        return math.inf if choice is None else rate(choice) - wanted

    index = _find_sign_change(len(kinds), excess)
    choice = usually(kinds[index]) if index < len(kinds) else None
    if choice is None:
        return None
    found = _coarsen(costs, rate, choice, wanted)
    for kind in kinds[index + FRONT_STRIDE :: FRONT_STRIDE]:
        choice = costs.affordable(kind, costs.bits(found))
        if choice is None or rate(choice) < wanted:
            break
        found = _coarsen(costs, rate, choice, wanted)
    return found


def _coarsen(costs: LayerCosts, rate: Rating, choice: LayerChoice, wanted: float) -> LayerChoice:
    """The layer like `choice`, which looks good enough, with about the largest lambda that still does."""
    coarser = [replace(choice, lambda_=float(each)) for each in costs.lambdas if each > choice.lambda_]
    rising = [choice, *coarser[:COARSER_LAMBDAS]]
    return rising[_find_sign_change(len(rising) - 1, lambda index: wanted - rate(rising[index + 1]))]


def _find_sign_change(count: int, function: Callable[[int], float]) -> int:
    """The first of 0.. where a rising function is not negative, `count` if it is negative everywhere.

    By false position, each value computed once; by halves as long as only one sign is known, and after a step that kept
    more than half of the interval.
    """
    low, high, below, above, slow = -1, count, -math.inf, math.inf, False
    while high - low > 1:
        width, known = high - low, math.isfinite(above - below)
        part = -below / (above - below) if known and not slow else 0.5
        here = min(max(round(low + width * part), low + 1), high - 1)
        value = function(here)
        if value < 0:
            low, below = here, value
        else:
            high, above = here, value
        slow = known and not slow and 2 * (high - low) > width
    return high


def find_later_layers(costs: LayerCosts, metric: PreviewMetric, first: LayerChoice, layers: int) -> list[LayerChoice]:
    """Choices for at most `layers` layers, after the `first` each the best looking of like many bits.

    Each looks better than the one before by :data:`WORTH_DB`, the last included.
    """
    rate, choices = _rate_once(costs, metric), [first]
    least, most = (max(costs.bits(choice), 1.0) for choice in (first, costs.final))
    for budget in np.geomspace(least, most, layers)[1:-1].tolist():
        choice = _find_best(costs, rate, choices[-1], budget)
        if choice is not None and rate(choice) >= rate(choices[-1]) + WORTH_DB:
            choices.append(choice)
    while len(choices) > 1 and rate(costs.final) < rate(choices[-1]) + WORTH_DB:
        choices.pop()
    return [*choices, costs.final]


def _find_best(costs: LayerCosts, rate: Rating, before: LayerChoice, budget: float) -> LayerChoice | None:
    """The best looking layer of so many bits that takes back nothing of the one `before`; None if there is none.

    The number of classes goes down from what is predicted to be best, as long as that looks better.
    """
    kinds = (show_whole(costs.last, shown) for shown in range(before.shown, costs.final.shown + 1))
    affordable = (costs.affordable(kind, budget) for kind in kinds)
    choices = [choice for choice in affordable if choice is not None and choice.lambda_ <= before.lambda_]
    if not choices:
        return None
    best = min(range(len(choices)), key=lambda index: costs.error(choices[index]))
    while best > 0 and rate(choices[best - 1]) > rate(choices[best]):
        best -= 1
    return choices[best]


def price_layers(problem: RdoInput, curves: Sequence[RdCurve]) -> LayerCosts:
    """The costs and gains of layers."""
    classes, repeat = problem.classes, problem.repeat
    absence = repeat * COARSE_ABSENCE * np.bincount(classes.of, classes.importance, classes.count)
    counts = np.bincount(classes.of, minlength=classes.count)
    sizes = np.rint((0 if classes.coverage_rank is None else repeat) * counts).astype(np.int64)
    weights = 0 if problem.latent is None else sum(layer.weights.size for layer in problem.latent.decoder.layers)
    return LayerCosts(
        curves=curves,
        presence_bits=classes.presence_bits,
        sizes=sizes,
        absence=absence.astype(np.float64),
        model_bits=DECODER_WEIGHT_BITS * weights,
        last=problem.lambda_,
    )


@dataclass(frozen=True)
class LayeredInput:
    """What is to be decided about a scene, and what its layers hold.

    Attributes:
        problem: with those classes split of which the first layer shows a part.
        curves: what it costs.
        choices: for all layers.
        first: the first of them before any class was split.
    """

    problem: RdoInput
    curves: Sequence[RdCurve]
    choices: Sequence[LayerChoice]
    first: LayerChoice


def layer_by_rule(problem: RdoInput, curves: Sequence[RdCurve], layers: int) -> LayeredInput:
    """The content of layers without a look at pictures: a first layer without holes, then others; or all in one."""
    if layers == 1:
        last = price_layers(problem, curves).final
        return LayeredInput(problem, curves, [last], last)
    first = predict_first_layer(price_layers(problem, curves), problem.base_share)
    problem, curves = split_classes(problem, curves, first.parts)
    costs = price_layers(problem, curves)
    return LayeredInput(problem, curves, predict_later_layers(first.without_parts, costs, layers), first)


def split_classes(
    problem: RdoInput, curves: Sequence[RdCurve], parts: Sequence[float]
) -> tuple[RdoInput, Sequence[RdCurve]]:
    """With those classes split of which the first layer shows only some of the given parts."""
    if min(parts) == 1:
        return problem, curves
    split = replace(problem, classes=problem.classes.split(parts))
    return split, [curve.split(parts) for curve in curves]
