"""The decision both profiles share: plans, layers and final integers of one scene (encoder side)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_encoder.allocate import aligned_steps, allocate, base_layer, plan_channel
from reference_encoder.assemble import (
    anchor_order,
    build_model,
    latent_chain,
    layer_rates,
    model_bits,
    tile_contents,
)
from reference_encoder.latent import Latent
from reference_encoder.lattice import Placement
from reference_encoder.rvq import RvqResult
from reference_encoder.targets import Targets
from scarfmt.codecs.codebooks import Codebooks
from scarfmt.codecs.mlp import Network
from scarfmt.container import HeaderFields
from scarfmt.model import SceneModel
from scarfmt.schema import ColourSpace, CoordinateFrame, Profile, Stream
from scarfmt.tile import TileContent

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

COARSE_ABSENCE = 3.0
"""How much worse than predicted leaving out a whole class is in early layers: holes, where one Gaussian leaves none."""


@dataclass(frozen=True)
class Problem:
    """What there is to decide about.

    Attributes:
        profile, slots: of the file.
        placement: where the N anchors lie.
        values, weights: (N, components) attributes and their sensitivities, per channel in coding order.
        coarsest: coarsest useful first step per channel.
        latent, rvq: latent and codewords, or None.
        classes: (N,) class of each anchor, most important first.
        count: how many classes.
        rate: lambda of the last layer.
        importance: (N,) squared picture error of leaving an anchor out.
        presence_bits: lambda -> (count,) bits that being there costs a class.
        lost: squared picture error of what was dropped for good.
        base_share: share of the bits that the first layer may take.
    """

    profile: Profile
    slots: int
    placement: Placement
    values: dict[Stream, F64]
    weights: dict[Stream, F64]
    coarsest: dict[Stream, tuple[float, ...]]
    latent: Latent | None
    rvq: RvqResult | None
    classes: I64
    count: int
    rate: float
    importance: F64
    presence_bits: Callable[[float], F64]
    lost: float
    base_share: float


@dataclass(frozen=True)
class Decision:
    """What a file will hold.

    Attributes:
        model: channels, classes and layers.
        finals: quantised values per channel.
        classes: (N,) classes, numbered by first appearance.
        rates: lambda of each layer that is kept.
    """

    model: SceneModel
    finals: dict[Stream, I64]
    classes: I64
    rates: list[float]


def best_step(sensitivity: F64, rate: float) -> F64:
    """Quantiser step whose last bit pays exactly: sqrt(6 * rate / (ln 2 * S)), the high-rate optimum."""
    return np.asarray(np.sqrt(6 * rate / np.log(2) / np.maximum(sensitivity, 1e-300)))


def decide(problem: Problem, layers: int) -> Decision:
    """Steps, stages and classes of every layer, and the integers of the last."""
    p = problem
    values, weights = dict(p.values), dict(p.weights)
    plans = [
        plan_channel(
            stream,
            values[stream],
            aligned_steps(caps, weights[stream], p.classes, p.count, p.rate),
            weights[stream],
            p.classes,
            p.count,
        )
        for stream, caps in p.coarsest.items()
    ]
    chain, latent_plan, left = latent_chain(p.latent, p.rvq, p.classes, p.count, p.rate)
    values[Stream.LATENT] = left
    if p.latent is not None:
        weights[Stream.LATENT] = np.repeat(p.latent.weight[:, None].astype(np.float64), left.shape[1], axis=1)
    absence = np.asarray(COARSE_ABSENCE * np.bincount(p.classes, p.importance, p.count), np.float64)
    bits = model_bits(p.rvq, p.latent)
    first, shown = base_layer(plans, chain, p.presence_bits, absence, bits, p.rate, p.base_share)
    rates = layer_rates(p.rate, first, layers)
    allocation = allocate(plans, chain, p.presence_bits, absence, p.lost, rates, shown)
    classes = allocation.order[p.classes]
    model, finals = build_model(
        p.profile, p.slots, [*plans, latent_plan], allocation.rows, values, weights, classes, p.rate
    )
    return Decision(model, finals, classes, rates[-len(model.layers) :])


def header_fields(problem: Problem, sh_degree: int, source_count: int) -> HeaderFields:
    """The header of a file for `problem`."""
    lattice = problem.placement.lattice
    return HeaderFields(
        problem.profile,
        sh_degree,
        problem.slots,
        lattice.bits,
        lattice.origin,
        lattice.voxel,
        source_count,
        CoordinateFrame.RDF,
        ColourSpace.SRGB,
    )


def contents(problem: Problem, decision: Decision, slot_layers: I64 | None = None) -> tuple[TileContent, ...]:
    """Tile contents in normative order (SPEC §6.3)."""
    return tile_contents(decision.model, problem.placement, decision.classes, decision.finals, problem.rvq, slot_layers)


def codebooks(problem: Problem, model: SceneModel) -> Codebooks | None:
    """The codebooks, if `model` uses a stage."""
    rvq = problem.rvq
    return Codebooks(rvq.coarse, rvq.residual) if rvq is not None and model.max_stages else None


def decoder(problem: Problem, model: SceneModel) -> Network | None:
    """The latent's decoder, if `model` uses a stage or the latent channel."""
    used = bool(model.max_stages) or any(channel.stream == Stream.LATENT for channel in model.channels)
    return problem.latent.decoder if problem.latent is not None and used else None


def targets(problem: Problem, decision: Decision) -> Targets | None:
    """What the codewords are to reproduce, anchors as :func:`contents` has them; None without a latent."""
    if problem.latent is None:
        return None
    order = anchor_order(decision.model, problem.placement, decision.classes)
    return Targets(problem.latent.values[order], problem.latent.weight[order], problem.rate)
