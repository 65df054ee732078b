"""The anchor profile: a Scaffold-GS style model to a :class:`QuantisedScene` (encoder side; paper §3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from reference_encoder.decide.allocate import classify
from reference_encoder.decide.assemble import final_rate, position_bits
from reference_encoder.decide.decision import (
    Problem,
    best_step,
    codebooks,
    contents,
    decide,
    decoder,
    header_fields,
    layer_costs,
    planned,
    targets,
)
from reference_encoder.decide.lattice import place
from reference_encoder.decide.layering import predicted
from reference_encoder.decide.rdo import choose_values
from reference_encoder.decide.targets import Targets
from reference_encoder.latent.fit import fit_latent
from reference_encoder.measure.anchor_sensitivity import ABSENCE_FACTOR, AnchorSensitivity, measure_anchors
from reference_encoder.measure.sensitivity import survey
from reference_encoder.options import EncodeOptions
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.writer import QuantisedScene, Report
from scarfmt.container.schema import Profile, Stream
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import Camera
from scarfmt.scene.gaussians import AnchorModel, GaussianScene, Mlp
from scarfmt.scene.model import Channel, ContextRule, LayerRow, SceneModel

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Mask = NDArray[np.bool_]

_NETWORKS = ("opacity", "cov", "color")
_MLP_BITS = 10
_COARSEST_STEP: dict[Stream, tuple[float, ...]] = {
    Stream.POSITION_RESIDUAL: (1 / 3,) * 3,
    Stream.SCALE: (0.9,) * 6,
}
_ANCHOR_BITS = 60.0
_SLOT_BITS = 14.0
_MOST_CLASSES = 7
# The networks travel in the first layer and are not in its estimate.
_BASE_SHARE = 0.28


def encode_anchors(model: AnchorModel, options: EncodeOptions, report: Report) -> tuple[QuantisedScene, Targets | None]:
    """Decide everything about a file for `model`, and tell what its codewords are to reproduce.

    Raises:
        InvalidInput: ``input-anchors`` when its networks are missing.
    """
    if set(model.mlps) != set(_NETWORKS):
        raise InvalidInput("input-anchors", f"networks {sorted(model.mlps)}: opacity, cov and color are needed")
    source_count = len(model)
    seen = measure_anchors(model, _cameras(model, options), options.seed, lambda f: report("visibility", f))
    rate = final_rate(options.quality, source_count)
    slots = seen.shape * ABSENCE_FACTOR > rate * _SLOT_BITS
    importance = (seen.shape * slots).sum(axis=1) * ABSENCE_FACTOR
    classes, count = classify(importance, rate, _ANCHOR_BITS, _MOST_CLASSES)
    kept = np.flatnonzero(classes >= 0)
    job = _Job(_taken(model, kept), _seen(seen, kept), slots[kept], classes[kept], count, rate, options)
    lost = float((seen.shape.sum() - (seen.shape * slots)[kept].sum()) * ABSENCE_FACTOR)
    return _encode(job, lost, importance[kept], source_count, report)


@dataclass(frozen=True)
class _Job:
    """What is left to encode after the invisible is gone."""

    model: AnchorModel
    seen: AnchorSensitivity
    slots: Mask
    classes: I64
    count: int
    rate: float
    options: EncodeOptions


def _cameras(model: AnchorModel, options: EncodeOptions) -> list[Camera]:
    """The views to judge by; where none are given, as for a scene with a Gaussian on every anchor."""
    n = len(model)
    shell = GaussianScene(
        model.anchors,
        np.zeros((n, 3), np.float32),
        np.zeros((n, 4), np.float32),
        np.zeros(n, np.float32),
        np.zeros((n, 1, 3), np.float32),
    )
    return survey(shell, options)


def _taken(model: AnchorModel, index: I64) -> AnchorModel:
    return AnchorModel(
        model.anchors[index], model.features[index], model.offsets[index], model.log_scaling[index], model.mlps
    )


def _seen(seen: AnchorSensitivity, index: I64) -> AnchorSensitivity:
    return AnchorSensitivity(seen.shape[index], seen.colour[index], seen.inverse_variance[index], seen.metric)


def _encode(
    job: _Job, lost: float, importance: F64, source_count: int, report: Report
) -> tuple[QuantisedScene, Targets | None]:
    problem = _problem(job, lost, importance, report)
    report("allocate", 0.0)
    plans = planned(problem)
    choices = predicted(layer_costs(problem, plans), problem.base_share, job.options.layers)
    decision = decide(problem, plans, choices)
    model, offsets = _with_offsets(job, decision.model, decision.classes)
    slot_layers = _slot_layers(job, model, decision.classes, decision.rates)
    finals = {**decision.finals, Stream.OFFSETS: offsets * (slot_layers > 0)[:, :, None]}
    decision = replace(decision, model=model, finals=finals)
    report("allocate", 1.0)
    quantised = QuantisedScene(
        header_fields(problem, 0, source_count),
        model,
        problem.placement.tiles,
        contents(problem, decision, slot_layers),
        codebooks(problem, model),
        decoder(problem, model),
        tuple(_network(job.model.mlps[name]) for name in _NETWORKS),
        dict(job.options.metadata),
    )
    return quantised, targets(problem, decision)


def _problem(job: _Job, lost: float, importance: F64, report: Report) -> Problem:
    model, seen, classes, rate = job.model, job.seen, job.classes, job.rate
    weight = (seen.shape * seen.inverse_variance).sum(axis=1)
    placement = place(model.anchors, best_step(weight, rate), job.options.tile_anchors)
    latent, rvq = fit_latent(model.features, seen.feature, classes, rate, 1, job.options, report, seen.metric)
    if latent is None:
        raise InvalidInput("input-anchors", "no feature of this model is visible from the given cameras")
    fixed = position_bits(classes, job.count)
    gain = seen.shape * ABSENCE_FACTOR * job.slots

    def presence_bits(at: float) -> F64:
        shown = (gain > at * _SLOT_BITS).sum(axis=1)
        return fixed + _SLOT_BITS * np.bincount(classes, shown, job.count)

    return Problem(
        Profile.ANCHOR,
        model.slots,
        placement,
        {Stream.POSITION_RESIDUAL: placement.residual, Stream.SCALE: model.log_scaling.astype(np.float64)},
        {
            Stream.POSITION_RESIDUAL: np.repeat((weight * placement.cell**2)[:, None], 3, axis=1),
            Stream.SCALE: _scale_weight(job),
        },
        _COARSEST_STEP,
        latent,
        rvq,
        classes,
        job.count,
        rate,
        importance,
        presence_bits,
        lost,
        _BASE_SHARE,
    )


def _scale_weight(job: _Job) -> F64:
    """(N, 6) squared picture error per squared unit of each log scaling: three move slots, three size them."""
    seen, model = job.seen, job.model
    moved = model.offsets.astype(np.float64) * np.exp(model.log_scaling[:, None, :3].astype(np.float64))
    moving = np.einsum("nk,nkc->nc", seen.shape * seen.inverse_variance, moved**2)
    sizing = np.repeat(0.7 * seen.shape.sum(axis=1)[:, None], 3, axis=1)
    return np.concatenate([moving, sizing], axis=1)


def _with_offsets(job: _Job, scene: SceneModel, classes: I64) -> tuple[SceneModel, I64]:
    """The model with the offsets channel added, and all (N, K, 3) quantised offsets.

    One step a component serves all slots: the one where the last bit of precision pays on average.
    """
    reach = np.exp(2 * job.model.log_scaling[:, :3].astype(np.float64))
    weight = (job.seen.shape * job.seen.inverse_variance)[:, :, None] * reach[:, None, :]
    active = np.broadcast_to(job.slots[:, :, None], weight.shape)
    total = np.maximum((weight * active).sum(axis=(0, 1)), 1e-300)
    largest = float(np.abs(job.model.offsets).max(initial=1e-6))
    step = np.clip(np.sqrt(6 * job.rate / np.log(2) * job.slots.sum() / total), largest * 1e-6, largest)
    anchor, slot = np.nonzero(job.slots)
    offsets = np.zeros(job.model.offsets.shape, np.int64)
    offsets[anchor, slot] = choose_values(
        job.model.offsets[anchor, slot] / step, weight[anchor, slot] * step**2, classes[anchor], job.rate
    )
    channel = Channel(Stream.OFFSETS, tuple(float(s) for s in step), (ContextRule(),) * 3)
    rows = tuple(LayerRow(row.stages, tuple((*steps, 1) for steps in row.steps)) for row in scene.layers)
    return SceneModel(scene.profile, scene.slots, (*scene.channels, channel), rows), offsets


def _slot_layers(job: _Job, scene: SceneModel, classes: I64, rates: list[float]) -> I64:
    """(N, K) layer that turns each slot on, 0 for never: the first in which it pays, once its anchor is there."""
    appears = 1 + np.searchsorted([row.class_count for row in scene.layers], classes, side="right")
    gain = job.seen.shape * ABSENCE_FACTOR
    pays = np.stack([gain > rate * _SLOT_BITS for rate in rates])
    first = 1 + pays.argmax(axis=0)
    layers = np.maximum(first, appears[:, None])
    return np.where(job.slots & pays.any(axis=0), np.minimum(layers, len(rates)), 0)


def _network(mlp: Mlp) -> QuantisedMlp:
    layers = zip(mlp.weights, mlp.biases, strict=True)
    return QuantisedMlp(tuple(Linear.quantised(weights, biases, bits=_MLP_BITS) for weights, biases in layers))
