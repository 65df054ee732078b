"""What every increment of every class costs and gains: plans of channels, latent and layers (encoder side)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.decide.allocate import ChannelPlan, LatentChain, aligned_steps, least_steps, plan_channel
from reference_encoder.decide.layering import LayerCosts
from reference_encoder.decide.problem import Problem
from reference_encoder.latent.fit import FittedLatent
from reference_encoder.tuning import (
    COARSE_ABSENCE,
    COARSEST_LATENT,
    CODEWORD_BITS,
    DECODER_WEIGHT_BITS,
    MOST_MERGED,
    POSITION_BITS,
)
from scarfmt.arrays import F64, I64
from scarfmt.container.schema import Stream


@dataclass(frozen=True)
class Plans:
    """What everything costs and gains.

    Attributes:
        channels: plans of all channels but LATENT, in coding order.
        latent: plan of the LATENT channel.
        chain: what the latent can receive.
        left: (N, d) float64 what the codewords leave to LATENT.
    """

    channels: list[ChannelPlan]
    latent: ChannelPlan
    chain: LatentChain
    left: F64


def planned(problem: Problem) -> Plans:
    """Costs and gains of every step of every class."""
    channels, classes, count = problem.channels, problem.classes.of, problem.classes.count
    plans = []
    price = Price.of(problem)
    for stream, caps in channels.coarsest.items():
        weight = channels.weights[stream]
        step = aligned_steps(caps, weight, classes, count, problem.budget.lambda_)
        plans.append(price.timed(plan_channel(stream, channels.values[stream], step, weight, classes, count)))
    if problem.fitted is None:
        none = np.zeros((count, 1))
        unused = ChannelPlan(Stream.LATENT, (1.0,), none, none)
        return Plans(plans, unused, LatentChain(0, none, none), np.zeros((len(classes), 1)))
    return Plans(plans, *_latent_plans(problem.fitted, classes, count, price))


@dataclass(frozen=True)
class Price:
    """What symbols cost beside their bits.

    Attributes:
        lambda_: of the last layer, squared picture error per bit.
        symbol_bits: what decoding one is worth.
        sizes: (classes,) anchors of each class.
    """

    lambda_: float
    symbol_bits: float
    sizes: I64

    @classmethod
    def of(cls, problem: Problem) -> Price:
        """Of a problem."""
        sizes = np.bincount(problem.classes.of, minlength=problem.classes.count)
        return cls(problem.budget.lambda_, problem.budget.symbol_bits, sizes)

    def timed(self, plan: ChannelPlan) -> ChannelPlan:
        """The plan with the bits that its symbols are worth, of as fine a first step as is worth most.

        A finer one is a symbol less for each value. Of LATENT it may be so much finer that no class gets less: few
        values leave the middle of wide cells. Of other channels as much as is sent of every Gaussian: previews need
        the rest.
        """
        if not self.symbol_bits:
            return plan
        most = MOST_MERGED if plan.stream == Stream.LATENT else max(least_steps(plan) - 1, 0)
        return min((self._priced(plan, merged) for merged in range(most + 1)), key=self._cost)

    def _priced(self, plan: ChannelPlan, merged: int) -> ChannelPlan:
        """The plan whose first step is the first `merged` + 1 of `plan`, symbols priced."""
        kept = [0, *range(merged + 1, plan.bits.shape[1])]
        symbols = len(plan.step) * self.sizes[:, None] * np.arange(len(kept))
        step = tuple(width / 3.0**merged for width in plan.step)
        return replace(plan, step=step, bits=plan.bits[:, kept] + self.symbol_bits * symbols, error=plan.error[:, kept])

    def _cost(self, plan: ChannelPlan) -> float:
        """Error, and bits at lambda, of the best number of steps of every class."""
        least = 0 if plan.stream == Stream.LATENT else least_steps(plan)
        return float((plan.error + self.lambda_ * plan.bits)[:, least:].min(axis=1).sum())


def _latent_plans(fitted: FittedLatent, classes: I64, count: int, price: Price) -> tuple[ChannelPlan, LatentChain, F64]:
    """The plan of the LATENT channel, what the latent can receive, and what the RVQ leaves for that channel."""
    latent, rvq = fitted.latent, fitted.rvq
    error = np.stack([np.bincount(classes, row, count) for row in rvq.distortion], axis=1)
    bits = np.concatenate([np.zeros((1, len(classes))), np.cumsum(rvq.bits, axis=0)])
    bits = np.stack([np.bincount(classes, row, count) for row in bits], axis=1)
    stages = len(rvq.bits)
    left = latent.values.astype(np.float64) - fitted.books.latents(rvq.indices, np.full(len(classes), stages))
    weight = latent.weight[:, None].astype(np.float64)
    step = aligned_steps((COARSEST_LATENT,), weight, classes, count, price.lambda_) * left.shape[1]
    plan = price.timed(plan_channel(Stream.LATENT, left, step, weight, classes, count))
    bits = bits + price.symbol_bits * price.sizes[:, None] * np.arange(stages + 1)
    chain = LatentChain(
        stages,
        np.concatenate([bits, bits[:, -1:] + plan.bits[:, 1:]], axis=1),
        np.concatenate([error, plan.error[:, 1:]], axis=1),
    )
    return plan, chain, left


def position_bits(classes: I64, count: int) -> F64:
    """(count,) bits of base positions and labels of the anchors of each class."""
    return POSITION_BITS * np.bincount(classes, minlength=count).astype(np.float64)


def layer_costs(problem: Problem, plans: Plans) -> LayerCosts:
    """What layers cost and gain."""
    classes = problem.classes
    absence = COARSE_ABSENCE * np.bincount(classes.of, classes.importance, classes.count)
    return LayerCosts(
        plans=plans.channels,
        latent=plans.chain,
        position_bits=classes.presence_bits,
        sizes=np.bincount(classes.of, minlength=classes.count),
        absence=absence.astype(np.float64),
        lost=problem.budget.lost,
        model_bits=_model_bits(problem.fitted),
        last=problem.budget.lambda_,
    )


def _model_bits(fitted: FittedLatent | None) -> float:
    """About what codebooks and decoder cost."""
    if fitted is None:
        return 0.0
    words = (len(fitted.rvq.coarse) + len(fitted.rvq.residual)) * int(fitted.rvq.coarse.shape[1])
    weights = sum(int(layer.weights.size) for layer in fitted.latent.decoder.layers)
    return CODEWORD_BITS * words + DECODER_WEIGHT_BITS * weights
