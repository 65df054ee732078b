"""The anchor profile: a Scaffold-GS style model to a :class:`QuantisedScene` (encoder side; paper §3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_encoder.allocate import aligned_steps, allocate, base_rate, classify, plan_channel
from reference_encoder.anchor_sensitivity import AnchorSensitivity, measure_anchors
from reference_encoder.assemble import (
    build_model,
    final_rate,
    latent_chain,
    layer_rates,
    model_bits,
    position_bits,
    tile_contents,
)
from reference_encoder.fit_latent import fit_latent
from reference_encoder.lattice import place
from reference_encoder.options import EncodeOptions
from reference_encoder.rdo import choose_values
from reference_encoder.sensitivity import ABSENCE_FACTOR, survey_cameras
from scarfmt.codecs.codebooks import Codebooks
from scarfmt.codecs.mlp import Linear, Network
from scarfmt.container import HeaderFields
from scarfmt.errors import InvalidInput
from scarfmt.model import Channel, ContextRule, LayerRow, SceneModel
from scarfmt.render.camera import Camera
from scarfmt.scene import AnchorModel, GaussianScene, Mlp
from scarfmt.schema import ColourSpace, CoordinateFrame, Profile, Stream
from scarfmt.writer import QuantisedScene, Report

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
_MOST_VIEWS = 24
# Masks, offsets and networks make the first layer hard to predict: this gives it about a quarter of the bytes.
_BASE_SHARE = 0.36


def encode_anchors(model: AnchorModel, options: EncodeOptions, report: Report) -> QuantisedScene:
    """Decide everything about a file for `model`.

    Raises:
        InvalidInput: ``input-anchors`` when its networks are missing.
    """
    if set(model.mlps) != set(_NETWORKS):
        raise InvalidInput("input-anchors", f"networks {sorted(model.mlps)}: opacity, cov and color are needed")
    source_count = len(model)
    seen = measure_anchors(model, _cameras(model, options), options.seed, lambda f: report("visibility", f))
    rate = final_rate(options, source_count)
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
    """The views to judge by: those given, thinned, or rings round the anchors."""
    if options.cameras is None:
        n = len(model)
        shell = GaussianScene(
            model.anchors,
            np.zeros((n, 3), np.float32),
            np.zeros((n, 4), np.float32),
            np.zeros(n, np.float32),
            np.zeros((n, 1, 3), np.float32),
        )
        return survey_cameras(shell, options.frame, thorough=False)
    cameras = [camera for camera in options.cameras if camera.split != "test"] or list(options.cameras)
    return cameras[:: max(1, -(-len(cameras) // _MOST_VIEWS))]


def _taken(model: AnchorModel, index: I64) -> AnchorModel:
    return AnchorModel(
        model.anchors[index], model.features[index], model.offsets[index], model.log_scaling[index], model.mlps
    )


def _seen(seen: AnchorSensitivity, index: I64) -> AnchorSensitivity:
    return AnchorSensitivity(seen.shape[index], seen.colour[index], seen.inverse_variance[index], seen.metric)


def _encode(job: _Job, lost: float, importance: F64, source_count: int, report: Report) -> QuantisedScene:
    model, seen, classes, count, rate = job.model, job.seen, job.classes, job.count, job.rate
    place_weight = (seen.shape * seen.inverse_variance).sum(axis=1)
    wanted = np.sqrt(6 * rate / np.log(2) / np.maximum(place_weight, 1e-300))
    placement = place(model.anchors, wanted)
    latent, rvq = fit_latent(model.features, seen.feature, classes, rate, 1, job.options, report, seen.metric)
    if latent is None or rvq is None:
        raise InvalidInput("input-anchors", "no feature of this model is visible from the given cameras")
    report("allocate", 0.0)
    values = {Stream.POSITION_RESIDUAL: placement.residual, Stream.SCALE: model.log_scaling.astype(np.float64)}
    weights = {
        Stream.POSITION_RESIDUAL: np.repeat((place_weight * placement.cell**2)[:, None], 3, axis=1),
        Stream.SCALE: _scale_weight(job),
    }
    plans = [
        plan_channel(s, values[s], aligned_steps(caps, weights[s], classes, count, rate), weights[s], classes, count)
        for s, caps in _COARSEST_STEP.items()
    ]
    chain, latent_plan, left = latent_chain(latent, rvq, classes, count, rate)
    fixed = position_bits(classes, count)
    gain = seen.shape * ABSENCE_FACTOR * job.slots

    def base(at: float) -> F64:
        return fixed + _SLOT_BITS * np.bincount(classes, (gain > at * _SLOT_BITS).sum(axis=1), count)

    absence = np.bincount(classes, importance, count).astype(np.float64)
    first = base_rate(plans, chain, base, absence, model_bits(rvq, latent), rate, _BASE_SHARE)
    rates = layer_rates(rate, first, job.options.layers)
    allocation = allocate(plans, chain, base, absence, lost, rates)
    values[Stream.LATENT] = left
    weights[Stream.LATENT] = np.repeat(latent.weight[:, None].astype(np.float64), left.shape[1], axis=1)
    classes = allocation.order[classes]
    scene_model, finals = build_model(
        Profile.ANCHOR, model.slots, [*plans, latent_plan], allocation.rows, values, weights, classes, rate
    )
    scene_model, offsets = _with_offsets(job, scene_model, classes)
    slot_layers = _slot_layers(job, scene_model, classes, rates)
    finals[Stream.OFFSETS] = offsets * (slot_layers > 0)[:, :, None]
    report("allocate", 1.0)
    fields = HeaderFields(
        Profile.ANCHOR,
        0,
        model.slots,
        placement.lattice.bits,
        placement.lattice.origin,
        placement.lattice.voxel,
        source_count,
        CoordinateFrame.RDF,
        ColourSpace.SRGB,
    )
    return QuantisedScene(
        fields,
        scene_model,
        placement.tiles,
        tile_contents(scene_model, placement, classes, finals, rvq, slot_layers),
        Codebooks(rvq.coarse, rvq.residual) if scene_model.max_stages else None,
        latent.decoder,
        tuple(_network(model.mlps[name]) for name in _NETWORKS),
        dict(job.options.metadata),
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
    rates = rates[-len(scene.layers) :]
    pays = np.stack([gain > rate * _SLOT_BITS for rate in rates])
    first = 1 + pays.argmax(axis=0)
    layers = np.maximum(first, appears[:, None])
    return np.where(job.slots & pays.any(axis=0), np.minimum(layers, len(rates)), 0)


def _network(mlp: Mlp) -> Network:
    return Network(tuple(Linear.quantised(w, b, bits=_MLP_BITS) for w, b in zip(mlp.weights, mlp.biases, strict=True)))
