"""What the layers of a file show: by prediction, or by looking (encoder side).

A layer shows the most important classes at some lambda; later layers show more classes at smaller lambdas. The first is
the picture somebody sees before the rest has arrived, the last is what `quality` asks for, and in between bytes grow by
like factors. The model of errors (docs/decisions/0003) is meant for small errors and ranks coarse pictures badly, so an
encoder with time to spare draws them (docs/decisions/0018-layers-by-looks.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.decide.allocate import ChannelPlan, LatentChain, PositionBits, increment
from reference_encoder.decide.problem import Problem
from reference_encoder.tuning import (
    BELOW_DB,
    DB_A_LAMBDA,
    LAMBDAS,
    LARGEST_LAMBDA_RATIO,
    LARGEST_SHARE,
    LOOKS,
    PARTS,
    PICTURE_DB,
    WORTH_DB,
)
from scarfmt.arrays import F64

Entry = tuple[int, ...]
"""What a class receives: stages, steps of each channel, LATENT steps."""
Look = Callable[[Sequence[Entry], float], float]
"""From what each class of a layer receives, and the part of the last of them that is there, to the PSNR in dB."""


@dataclass(frozen=True)
class LayerChoice:
    """What a layer shows.

    Attributes:
        lambda_: squared picture error per bit.
        shown: classes, the most important first.
        part: of the last of them, the most important anchors; 1 for all.
    """

    lambda_: float
    shown: int
    part: float = 1.0


@dataclass(frozen=True)
class LayerCosts:
    """What layers cost and gain.

    Attributes:
        plans: channels in coding order.
        latent: RVQ stages, then steps of the latent channel.
        position_bits: lambda -> (classes,) bits of positions, labels and whatever else presence costs.
        absence: (classes,) squared picture error of leaving the class out.
        lost: error of the anchors dropped for good.
        model_bits: bits of codebooks and networks, which the first layer carries too.
        last: lambda of the last layer.
    """

    plans: Sequence[ChannelPlan]
    latent: LatentChain
    position_bits: PositionBits
    absence: F64
    lost: float
    model_bits: float
    last: float

    @property
    def final(self) -> LayerChoice:
        """The last layer."""
        return LayerChoice(self.last, len(self.absence))

    @property
    def least(self) -> LayerChoice:
        """The cheapest layer there is."""
        return LayerChoice(float(self.lambdas[-1]), 1)

    @property
    def lambdas(self) -> F64:
        """Lambdas to choose from, rising from that of the last layer."""
        return np.asarray(self.last * np.geomspace(1, LARGEST_LAMBDA_RATIO, LAMBDAS))

    def entries(self, choice: LayerChoice) -> list[Entry]:
        """What each class receives."""
        return [self._increment(klass, choice.lambda_)[0] for klass in range(choice.shown)]

    def bits(self, choice: LayerChoice) -> float:
        """Bits up to a layer."""
        fixed = self.position_bits(choice.lambda_)
        each = [self._increment(klass, choice.lambda_)[2] + fixed[klass] for klass in range(choice.shown)]
        return float(self.model_bits + sum(each[:-1]) + choice.part * each[-1])

    def error(self, choice: LayerChoice) -> float:
        """Predicted squared picture error of a layer of whole classes."""
        shown = sum(self._increment(klass, choice.lambda_)[1] for klass in range(choice.shown))
        return float(self.lost + shown + self.absence[choice.shown :].sum())

    def pays(self, klass: int, lambda_: float) -> bool:
        """Whether a class is predicted to be worth its bits at `lambda_`."""
        _, error, bits = self._increment(klass, lambda_)
        return error + lambda_ * (bits + float(self.position_bits(lambda_)[klass])) < float(self.absence[klass])

    def affordable(self, shown: int, bits: float, part: float = 1.0) -> LayerChoice | None:
        """The layer of so many classes with the smallest lambda that takes at most `bits`; None if there is none."""
        choices = (LayerChoice(float(lambda_), shown, part) for lambda_ in self.lambdas)
        return next((choice for choice in choices if self.bits(choice) <= bits), None)

    def coarser(self, choice: LayerChoice) -> list[LayerChoice]:
        """The layer with larger lambdas, rising."""
        return [replace(choice, lambda_=float(lambda_)) for lambda_ in self.lambdas if lambda_ > choice.lambda_]

    def _increment(self, klass: int, lambda_: float) -> tuple[Entry, float, float]:
        return increment(self.plans, self.latent, klass, lambda_, self.last)


@dataclass(frozen=True)
class Layering:
    """What layers hold, found at one lambda of the last layer and good for others nearby.

    Classes are ranked from the least important up, at steps of importance from what is just worth its bits: where
    lambda changes, it is the most important end that gains or loses a class.

    Attributes:
        classes: there were when the layers were chosen, before any was split.
        first: the first layer; of its last class perhaps a part, which becomes a class of its own.
        later: layers after it but for the last, lambdas in those of the last layer.
    """

    classes: int
    first: LayerChoice
    later: tuple[LayerChoice, ...]

    @classmethod
    def of(cls, classes: int, first: LayerChoice, choices: Sequence[LayerChoice]) -> Layering:
        """Of the `choices` for all layers, found after the last class of the `first` was split."""
        last = choices[-1].lambda_
        later = tuple(replace(choice, lambda_=choice.lambda_ / last) for choice in choices[1:-1])
        return cls(classes, replace(first, lambda_=first.lambda_ / last), later)

    def split(self, problem: Problem) -> Problem:
        """The problem with the class split that the first layer shows a part of."""
        if self.first.part == 1:
            return problem
        return problem.split(self._shown(self.first, problem.classes.count, 0) - 1, self.first.part)

    def choices(self, costs: LayerCosts) -> list[LayerChoice]:
        """Choices for all layers, of a problem that was split."""
        extra, count = int(self.first.part < 1), costs.final.shown
        return [
            *(
                LayerChoice(choice.lambda_ * costs.last, self._shown(choice, count, extra))
                for choice in (self.first, *self.later)
            ),
            costs.final,
        ]

    def _shown(self, choice: LayerChoice, count: int, extra: int) -> int:
        """Classes that a layer shows where there are `count`, `extra` of them by splitting."""
        return min(max(choice.shown + count - extra - self.classes, 1), count)


def predicted(costs: LayerCosts, share: float, layers: int) -> list[LayerChoice]:
    """Choices for at most `layers` layers by the model of errors, the first with `share` of the bits.

    Of the first layers that take so much, with every number of classes, it is the one with the least error. A class
    comes as soon as it pays.
    """
    if layers == 1:
        return [costs.final]
    budget = share * costs.bits(costs.final)
    affordable = (costs.affordable(shown, budget) for shown in range(1, costs.final.shown + 1))
    choices = [min((choice for choice in affordable if choice), key=costs.error, default=costs.least)]
    for lambda_ in reversed(costs.lambdas[costs.lambdas < choices[0].lambda_]):
        paying = [klass + 1 for klass in range(costs.final.shown) if costs.pays(klass, float(lambda_))]
        choices.append(LayerChoice(float(lambda_), max([choices[-1].shown, *paying])))
    choices.append(costs.final)
    bits = np.array([costs.bits(choice) for choice in choices])
    between = _budgets(bits[0], bits[-1], layers)[1:-1]
    kept = {int(np.argmin(np.abs(bits - budget))) for budget in between} - {0, len(bits) - 1}
    return [choices[0], *(choices[k] for k in sorted(kept)), costs.final]


def first_picture(costs: LayerCosts, look: Look, quality: float, share: float) -> LayerChoice:
    """The smallest first layer whose pictures have :data:`PICTURE_DB`.

    If none has within :data:`LARGEST_SHARE` of the bits, the best within `share`.

    Args:
        costs: of layers.
        look: draws a layer.
        quality: of the last layer, dB: the first stays well below.
        share: of the bits.
    """
    wanted, total = min(PICTURE_DB, quality - BELOW_DB), costs.bits(costs.final)
    found: LayerChoice | None = None
    for shown in range(1, costs.final.shown + 1):
        better = _smaller(costs, look, shown, 1.0, wanted, costs.bits(found) if found else LARGEST_SHARE * total)
        if found is not None and better is None:
            break
        found = better or found
    if found is None:
        return _best(costs, look, share * total)
    for part in PARTS:
        better = _smaller(costs, look, found.shown, part, wanted, costs.bits(found))
        if better is None:
            break
        found = better
    return found


def _smaller(costs: LayerCosts, look: Look, shown: int, part: float, wanted: float, most: float) -> LayerChoice | None:
    """About the smallest layer of so much that looks good enough; None if that takes more than `most` bits."""
    choice = costs.affordable(shown, most, part)
    if choice is None:
        return None
    reached = look(costs.entries(choice), part)
    if reached < wanted:
        return None
    coarser, stride = costs.coarser(choice), int((reached - wanted) / DB_A_LAMBDA)
    for _ in range(LOOKS):
        stride = min(stride, len(coarser))
        if stride < 1:
            break
        found = look(costs.entries(coarser[stride - 1]), part)
        if found < wanted:
            coarser, stride = coarser[: stride - 1], stride // 2
        else:
            choice, coarser, stride = coarser[stride - 1], coarser[stride:], int((found - wanted) / DB_A_LAMBDA)
    return choice


def _best(costs: LayerCosts, look: Look, budget: float) -> LayerChoice:
    """The best looking layer of at most `budget` bits."""
    affordable = (costs.affordable(shown, budget) for shown in range(1, costs.final.shown + 1))
    choices = [choice for choice in affordable if choice] or [costs.least]
    return max(choices, key=lambda choice: look(costs.entries(choice), 1.0))


def best_looking(costs: LayerCosts, look: Look, first: LayerChoice, layers: int) -> list[LayerChoice]:
    """Choices for at most `layers` layers, after the `first` each the best looking of like many bits."""
    choices, reached = [first], look(costs.entries(first), 1.0)
    for budget in _budgets(costs.bits(first), costs.bits(costs.final), layers)[1:-1]:
        rated = list(_rated(costs, look, choices[-1], budget))
        rating, choice = max(rated, key=lambda pair: pair[0], default=(reached, first))
        if rating >= reached + WORTH_DB:
            choices.append(choice)
            reached = rating
    return [*choices, costs.final]


def _rated(costs: LayerCosts, look: Look, before: LayerChoice, budget: float) -> Iterator[tuple[float, LayerChoice]]:
    """(dB, choice) for growing numbers of classes, as long as that looks better; nothing is taken back."""
    best = float("-inf")
    for shown in range(before.shown, costs.final.shown + 1):
        choice = costs.affordable(shown, budget)
        if choice is None or choice.lambda_ > before.lambda_:
            return
        rating = look(costs.entries(choice), 1.0)
        yield rating, choice
        if rating < best:
            return
        best = rating


def _budgets(first: float, last: float, layers: int) -> list[float]:
    """Bits up to each layer, growing by like factors."""
    return [float(bits) for bits in np.geomspace(max(first, 1.0), max(last, 1.0), layers)]
