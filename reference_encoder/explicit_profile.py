"""The explicit profile: any trained 3D Gaussian scene to a :class:`QuantisedScene` (encoder side)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_encoder.allocate import ChannelPlan, LatentChain, allocate, classify, plan_channel
from reference_encoder.attributes import Attributes, from_scene
from reference_encoder.contexts import choose_rules
from reference_encoder.latent import Latent, linear_latent
from reference_encoder.lattice import Placement, place
from reference_encoder.rdo import choose_values
from reference_encoder.options import DEFAULT_LAYER_GAP_DB, EncodeOptions
from reference_encoder.rvq import RvqOptions, RvqResult, quantise
from reference_encoder.sensitivity import Sensitivity, measure, survey_cameras
from scarfmt.codecs.channels import coarsen
from scarfmt.codecs.codebooks import Codebooks
from scarfmt.container import HeaderFields
from scarfmt.model import Channel, LayerRow, SceneModel
from scarfmt.scene import GaussianScene
from scarfmt.schema import ColourSpace, CoordinateFrame, Profile, Stream
from scarfmt.tile import TileContent, first_values
from scarfmt.writer import QuantisedScene, Report, silent

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

CHANNELS = (Stream.POSITION_RESIDUAL, Stream.SCALE, Stream.ROTATION, Stream.OPACITY, Stream.COLOUR)
FIRST_STEP: dict[Stream, tuple[float, ...]] = {
    Stream.POSITION_RESIDUAL: (1 / 3, 1 / 3, 1 / 3),
    Stream.SCALE: (0.9, 1.0, 1.6),
    Stream.ROTATION: (0.6, 0.6, 0.9),
    Stream.OPACITY: (1.0,),
    Stream.COLOUR: (1.5, 1.5, 1.8),
}
_LATENT_STEP = 81.0
# Measured: picture error per Gaussian that one lambda buys (docs/decisions/0004).
_RATE_CONSTANT = 6.0
# The cheapest anchor: a position, a class and first steps.
_CHEAPEST_BITS = 40.0
_MOST_CLASSES = 8
# Errors of view-dependent colour agree between neighbours more than others do: they count for more.
_REST_SHARE = 1.3


@dataclass(frozen=True)
class _Effort:
    """What an effort level means."""

    sample: int
    epochs: int
    stages: int
    thorough_views: bool


_EFFORT = {1: _Effort(16384, 4, 1, False), 2: _Effort(65536, 7, 2, False), 3: _Effort(262144, 12, 3, True)}


def codebook_size(anchors: int) -> int:
    """Codewords that pay for themselves: about one per 150 anchors, 16..1024."""
    return int(2 ** np.clip(np.round(np.log2(max(anchors, 1) / 150)), 4, 10))


def encode_explicit(scene: GaussianScene, options: EncodeOptions, report: Report = silent) -> QuantisedScene:
    """Decide everything about a file for `scene`."""
    effort = _EFFORT[options.effort]
    source_count, degree = len(scene), scene.sh_degree
    attributes = from_scene(scene)
    report("visibility", 0.0)
    cameras = options.cameras or survey_cameras(scene, options.frame, effort.thorough_views)
    sensitivity = measure(scene, attributes, list(cameras))
    rate = 10 ** (-options.quality / 10) / (_RATE_CONSTANT * source_count)
    classes, count = classify(sensitivity.absence, rate, _CHEAPEST_BITS, _MOST_CLASSES)
    kept = np.flatnonzero(classes >= 0)
    lost = float(sensitivity.absence[classes < 0].sum())
    attributes, sensitivity, classes = attributes.take(kept), sensitivity.take(kept), classes[kept]
    report("visibility", 1.0)
    wanted = np.sqrt(6 * rate / np.log(2) / np.maximum(sensitivity.channels[Stream.POSITION_RESIDUAL][:, 0], 1e-300))
    placement = place(attributes.positions, wanted)
    latent = linear_latent(attributes.rest, sensitivity.colour * _REST_SHARE, rate * len(kept)) if degree else None
    rvq = _quantise_latent(latent, classes, rate, effort, options, report)
    values = {stream: attributes.channel(stream) for stream in CHANNELS[1:]}
    values[Stream.POSITION_RESIDUAL] = placement.residual
    weights = dict(sensitivity.channels)
    weights[Stream.POSITION_RESIDUAL] = weights[Stream.POSITION_RESIDUAL] * (placement.cell**2)[:, None]
    report("allocate", 0.0)
    plans = [plan_channel(s, values[s], FIRST_STEP[s], weights[s], classes, count) for s in CHANNELS]
    rates = [rate * 10 ** (DEFAULT_LAYER_GAP_DB / 10 * k) for k in range(options.layers - 1, -1, -1)]
    chain, latent_plan, latent_left = _latent_chain(latent, rvq, classes, count)
    allocation = allocate(plans, chain, _position_bits(classes, count),
                          np.bincount(classes, sensitivity.absence, count), lost, rates)
    classes = allocation.order[classes]
    values[Stream.LATENT] = latent_left
    if latent is not None:
        weights[Stream.LATENT] = np.repeat(latent.weight[:, None].astype(np.float64), latent_left.shape[1], axis=1)
    model, finals = _model([*plans, latent_plan], allocation.rows, values, weights, classes, rate)
    report("allocate", 1.0)
    fields = HeaderFields(
        Profile.EXPLICIT, degree, 1, placement.lattice.bits, placement.lattice.origin, placement.lattice.voxel,
        source_count, CoordinateFrame.RDF, ColourSpace.SRGB,
    )
    stages = max(allocation.rows[-1].stages)
    contents = _contents(model, placement, classes, finals, rvq, stages)
    books = Codebooks(rvq.coarse, rvq.residual) if rvq and stages else None
    has_latent = bool(stages) or any(c.stream == Stream.LATENT for c in model.channels)
    return QuantisedScene(fields, model, placement.tiles, contents, books,
                          latent.decoder if latent and has_latent else None, (), dict(options.metadata))


def _quantise_latent(
    latent: Latent | None, classes: I64, rate: float, effort: _Effort, options: EncodeOptions, report: Report
) -> RvqResult | None:
    if latent is None:
        return None
    rvq = RvqOptions(codebook_size(len(classes)), effort.stages, rate, effort.sample, effort.epochs, options.seed)
    return quantise(latent.values, latent.weight, classes, rvq, lambda fraction: report("codebooks", fraction))


def _latent_chain(
    latent: Latent | None, rvq: RvqResult | None, classes: I64, count: int
) -> tuple[LatentChain, ChannelPlan, F64]:
    """What the latent can receive, the plan of its channel, and what the RVQ leaves for that channel."""
    if latent is None or rvq is None:
        none = np.zeros((count, 1))
        return LatentChain(0, none, none), ChannelPlan(Stream.LATENT, (1.0,), none, none), np.zeros((len(classes), 1))
    error = np.stack([np.bincount(classes, row, count) for row in rvq.distortion], axis=1)
    bits = np.concatenate([np.zeros((1, len(classes))), np.cumsum(rvq.bits, axis=0)])
    bits = np.stack([np.bincount(classes, row, count) for row in bits], axis=1)
    stages = len(rvq.bits)
    received = np.full(len(classes), stages)
    left = latent.values.astype(np.float64) - Codebooks(rvq.coarse, rvq.residual).latents(rvq.indices, received)
    step = (_LATENT_STEP,) * left.shape[1]
    plan = plan_channel(Stream.LATENT, left, step, latent.weight[:, None].astype(np.float64), classes, count)
    chain = LatentChain(
        stages,
        np.concatenate([bits, bits[:, -1:] + plan.bits[:, 1:]], axis=1),
        np.concatenate([error, plan.error[:, 1:]], axis=1),
    )
    return chain, plan, left


def _position_bits(classes: I64, count: int) -> F64:
    """Bits of base positions and labels per class: about what the split coder spends on a dense surface."""
    return np.bincount(classes, minlength=count) * 10.0


def _model(
    plans: list[ChannelPlan], rows: tuple[LayerRow, ...], values: dict[Stream, F64], weights: dict[Stream, F64],
    classes: I64, rate: float,
) -> tuple[SceneModel, dict[Stream, I64]]:
    """Final integers of every channel, the context rules that code them best, and the model of both."""
    finals: dict[Stream, I64] = {}
    firsts: dict[Stream, I64] = {}
    used: list[int] = []
    for index, plan in enumerate(plans):
        steps = np.array([row[index] for row in rows[-1].steps])[classes]
        if not steps.any():
            continue
        used.append(index)
        unit = np.array(plan.step) / 3.0 ** np.maximum(steps - 1, 0)[:, None]
        final = choose_values(values[plan.stream] / unit, weights[plan.stream] * unit**2, classes, rate)
        final *= (steps > 0)[:, None]
        finals[plan.stream] = final
        firsts[plan.stream] = coarsen(final, np.maximum(steps - 1, 0)[:, None])
    streams = [plans[index].stream for index in used]
    rules = choose_rules(streams, [firsts[s] for s in streams], classes)
    channels = tuple(
        Channel(plans[index].stream, plans[index].step, rule) for index, rule in zip(used, rules, strict=True)
    )
    kept_rows = tuple(LayerRow(row.stages, tuple(tuple(s[i] for i in used) for s in row.steps)) for row in rows)
    return SceneModel(Profile.EXPLICIT, 1, channels, kept_rows), finals


def _contents(
    model: SceneModel,
    placement: Placement,
    classes: I64,
    finals: dict[Stream, I64],
    rvq: RvqResult | None,
    stages: int,
) -> tuple[TileContent, ...]:
    """Tile contents in normative order (SPEC §6.3)."""
    appears = np.searchsorted([row.class_count for row in model.layers], classes, side="right")
    order = np.lexsort((classes, placement.codes, appears, placement.tile))
    edges = np.cumsum(np.bincount(placement.tile, minlength=len(placement.tiles)))[:-1]
    last = len(model.layers)
    received = model.stages(last, classes)
    contents = []
    for here in np.split(order, edges):
        content = TileContent.empty(model, len(here))
        content.codes, content.classes = placement.codes[here], classes[here]
        content.values = [finals[channel.stream][here].astype(np.int32) for channel in model.channels]
        if rvq is not None and stages:
            chosen = rvq.indices[here, :stages]
            content.indices = np.where(np.arange(stages) < received[here, None], chosen, 0).astype(np.int16)
        content.first = first_values(model, content)
        contents.append(content)
    return tuple(contents)
