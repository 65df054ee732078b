"""Plans of channels, latent and layers: the cost and gain of every increment of every class (encoder side)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference_encoder.decide.allocate import ChannelPlan, LatentChain, aligned_steps, plan_channel
from reference_encoder.decide.layering import LayerCosts
from reference_encoder.decide.problem import Problem
from reference_encoder.latent.fit import FittedLatent
from reference_encoder.tuning import (
    COARSE_ABSENCE,
    COARSEST_LATENT,
    CODEWORD_BITS,
    DECODER_WEIGHT_BITS,
    POSITION_BITS,
)
from scarfmt.arrays import F64, I64
from scarfmt.container.schema import Stream


@dataclass(frozen=True)
class Plans:
    """The costs and gains of all refinements.

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
    for stream, caps in channels.coarsest.items():
        weight = channels.weights[stream]
        step = aligned_steps(caps, weight, classes, count, problem.budget.lambda_)
        plans.append(plan_channel(stream, channels.values[stream], step, weight, classes, count, problem.repeat))
    if problem.fitted is None:
        none = np.zeros((count, 1))
        unused = ChannelPlan(Stream.LATENT, (1.0,), none, none)
        return Plans(plans, unused, LatentChain(0, none, none), np.zeros((len(classes), 1)))
    return Plans(plans, *_latent_plans(problem.fitted, classes, count, problem.budget.lambda_, problem.repeat))


def _latent_plans(
    fitted: FittedLatent, classes: I64, count: int, lambda_: float, repeat: float
) -> tuple[ChannelPlan, LatentChain, F64]:
    """The plan of the LATENT channel, what the latent can receive, and what the RVQ leaves for that channel."""
    latent, rvq = fitted.latent, fitted.rvq
    error = repeat * np.stack([np.bincount(classes, row, count) for row in rvq.distortion], axis=1)
    bits = np.concatenate([np.zeros((1, len(classes))), np.cumsum(rvq.bits, axis=0)])
    bits = repeat * np.stack([np.bincount(classes, row, count) for row in bits], axis=1)
    stages = len(rvq.bits)
    left = latent.values.astype(np.float64) - fitted.books.latents(rvq.indices, np.full(len(classes), stages))
    weight = latent.weight[:, None].astype(np.float64)
    step = aligned_steps((COARSEST_LATENT,), weight, classes, count, lambda_) * left.shape[1]
    plan = plan_channel(Stream.LATENT, left, step, weight, classes, count, repeat)
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
    """The costs and gains of layers."""
    classes = problem.classes
    absence = problem.repeat * COARSE_ABSENCE * np.bincount(classes.of, classes.importance, classes.count)
    sizes = np.rint(problem.repeat * np.bincount(classes.of, minlength=classes.count)).astype(np.int64)
    return LayerCosts(
        plans=plans.channels,
        latent=plans.chain,
        position_bits=classes.presence_bits,
        sizes=sizes,
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
