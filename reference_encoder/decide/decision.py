"""The decision both profiles share: plans, layers and final integers of one scene (encoder side)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from reference_encoder.decide.allocate import ChannelPlan, LatentChain, aligned_steps, plan_channel
from reference_encoder.decide.assemble import anchor_order, build_model, latent_chain, model_bits, tile_contents
from reference_encoder.decide.lattice import Placement
from reference_encoder.decide.layering import LayerChoice, LayerCosts
from reference_encoder.decide.targets import Targets
from reference_encoder.latent.linear import Latent
from reference_encoder.latent.rvq import RvqResult
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.coding.tile import TileContent
from scarfmt.container.file import HeaderFields
from scarfmt.container.schema import ColourSpace, CoordinateFrame, Profile, Stream
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.model import LayerRow, SceneModel

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
        base_share: share of the bits that the first layer takes.
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
        classes: (N,) classes.
        rates: lambda of each layer that is kept.
    """

    model: SceneModel
    finals: dict[Stream, I64]
    classes: I64
    rates: list[float]


def best_step(sensitivity: F64, rate: float) -> F64:
    """Quantiser step whose last bit pays exactly: sqrt(6 * rate / (ln 2 * S)), the high-rate optimum."""
    return np.asarray(np.sqrt(6 * rate / np.log(2) / np.maximum(sensitivity, 1e-300)))


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
    p = problem
    plans = [
        plan_channel(
            stream,
            p.values[stream],
            aligned_steps(caps, p.weights[stream], p.classes, p.count, p.rate),
            p.weights[stream],
            p.classes,
            p.count,
        )
        for stream, caps in p.coarsest.items()
    ]
    chain, latent, left = latent_chain(p.latent, p.rvq, p.classes, p.count, p.rate)
    return Plans(plans, latent, chain, left)


def split(problem: Problem, kind: int, part: float) -> Problem:
    """The problem with class `kind` made two: the most important `part` of its anchors, and the others."""
    late = problem.classes > kind
    late |= (problem.classes == kind) & ~leading(problem, kind, part)

    def presence(rate: float) -> F64:
        bits = problem.presence_bits(rate)
        parts = np.insert(bits, kind + 1, (1 - part) * bits[kind])
        parts[kind] = part * bits[kind]
        return parts

    return replace(problem, classes=problem.classes + late, count=problem.count + 1, presence_bits=presence)


def leading(problem: Problem, kind: int, part: float) -> NDArray[np.bool_]:
    """(N,) whether an anchor is among the most important `part` of class `kind`; of equals, the first are."""
    members = np.flatnonzero(problem.classes == kind)
    ranked = members[np.argsort(-problem.importance[members], kind="stable")]
    found = np.zeros(len(problem.classes), bool)
    found[ranked[: max(1, round(part * len(ranked)))]] = True
    return found


def layer_costs(problem: Problem, plans: Plans) -> LayerCosts:
    """What layers cost and gain."""
    absence = COARSE_ABSENCE * np.bincount(problem.classes, problem.importance, problem.count)
    bits = model_bits(problem.rvq, problem.latent)
    return LayerCosts(
        plans.channels, plans.chain, problem.presence_bits, absence.astype(np.float64), problem.lost, bits, problem.rate
    )


def decide(problem: Problem, plans: Plans, choices: Sequence[LayerChoice]) -> Decision:
    """Steps, stages and classes of every layer, and the integers of the last.

    Args:
        problem, plans: what there is to decide, and what it costs.
        choices: what each layer shows, whole classes (:func:`split`); layers that add nothing are left out.
    """
    p = problem
    values, weights = dict(p.values), dict(p.weights)
    values[Stream.LATENT] = plans.left
    if p.latent is not None:
        weights[Stream.LATENT] = np.repeat(p.latent.weight[:, None].astype(np.float64), plans.left.shape[1], axis=1)
    costs = layer_costs(problem, plans)
    rows: dict[LayerRow, float] = {}
    for choice in choices:
        entries = costs.entries(choice)
        rows.setdefault(LayerRow(tuple(e[0] for e in entries), tuple(e[1:] for e in entries)), choice.rate)
    model, finals = build_model(
        p.profile, p.slots, [*plans.channels, plans.latent], list(rows), values, weights, p.classes, p.rate
    )
    return Decision(model, finals, p.classes, [*list(rows.values())[:-1], p.rate])


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


def decoder(problem: Problem, model: SceneModel) -> QuantisedMlp | None:
    """The latent's decoder, if `model` uses a stage or the latent channel."""
    used = bool(model.max_stages) or any(channel.stream == Stream.LATENT for channel in model.channels)
    return problem.latent.decoder if problem.latent is not None and used else None


def targets(problem: Problem, decision: Decision) -> Targets | None:
    """What the codewords are to reproduce, anchors as :func:`contents` has them; None without a latent."""
    if problem.latent is None:
        return None
    order = anchor_order(decision.model, problem.placement, decision.classes)
    return Targets(problem.latent.values[order], problem.latent.weight[order], problem.rate)
