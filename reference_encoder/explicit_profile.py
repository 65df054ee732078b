"""The explicit profile: any trained 3D Gaussian scene to a :class:`QuantisedScene` (encoder side)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_encoder.allocate import aligned_steps, allocate, base_rate, classify, plan_channel
from reference_encoder.assemble import (
    BASE_SHARE,
    build_model,
    final_rate,
    latent_chain,
    layer_rates,
    model_bits,
    position_bits,
    tile_contents,
)
from reference_encoder.attributes import from_scene
from reference_encoder.fit_latent import fit_latent
from reference_encoder.lattice import place
from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.sensitivity import measure, survey_cameras
from scarfmt.codecs.codebooks import Codebooks
from scarfmt.container import HeaderFields
from scarfmt.scene import GaussianScene
from scarfmt.schema import ColourSpace, CoordinateFrame, Profile, Stream
from scarfmt.writer import QuantisedScene, Report, silent

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

CHANNELS = (Stream.POSITION_RESIDUAL, Stream.SCALE, Stream.ROTATION, Stream.OPACITY, Stream.COLOUR)
COARSEST_STEP: dict[Stream, tuple[float, ...]] = {
    Stream.POSITION_RESIDUAL: (1 / 3, 1 / 3, 1 / 3),
    Stream.SCALE: (0.9, 1.0, 1.6),
    Stream.ROTATION: (0.6, 0.6, 0.9),
    Stream.OPACITY: (1.0,),
    Stream.COLOUR: (1.5, 1.5, 1.8),
}
# The cheapest anchor: a position, a class and first steps.
_CHEAPEST_BITS = 40.0
_MOST_CLASSES = 8
# Errors of view-dependent colour agree between neighbours more than others do: they count for more.
_REST_SHARE = 1.3


def encode_explicit(scene: GaussianScene, options: EncodeOptions, report: Report = silent) -> QuantisedScene:
    """Decide everything about a file for `scene`."""
    effort = EFFORTS[options.effort]
    source_count, degree = len(scene), scene.sh_degree
    attributes = from_scene(scene)
    report("visibility", 0.0)
    cameras = options.cameras or survey_cameras(scene, options.frame, effort.thorough_views)
    sensitivity = measure(scene, attributes, list(cameras))
    rate = final_rate(options, source_count)
    classes, count = classify(sensitivity.absence, rate, _CHEAPEST_BITS, _MOST_CLASSES)
    kept = np.flatnonzero(classes >= 0)
    lost = float(sensitivity.absence[classes < 0].sum())
    attributes, sensitivity, classes = attributes.take(kept), sensitivity.take(kept), classes[kept]
    report("visibility", 1.0)
    wanted = np.sqrt(6 * rate / np.log(2) / np.maximum(sensitivity.channels[Stream.POSITION_RESIDUAL][:, 0], 1e-300))
    placement = place(attributes.positions, wanted)
    latent, rvq = None, None
    if degree:
        weight = sensitivity.colour * _REST_SHARE
        latent, rvq = fit_latent(attributes.rest, weight, classes, rate, 0, options, report)
    values = {stream: attributes.channel(stream) for stream in CHANNELS[1:]}
    values[Stream.POSITION_RESIDUAL] = placement.residual
    weights = dict(sensitivity.channels)
    weights[Stream.POSITION_RESIDUAL] = weights[Stream.POSITION_RESIDUAL] * (placement.cell**2)[:, None]
    report("allocate", 0.0)
    plans = [
        plan_channel(s, values[s], aligned_steps(caps, weights[s], classes, count, rate), weights[s], classes, count)
        for s, caps in COARSEST_STEP.items()
    ]
    chain, latent_plan, latent_left = latent_chain(latent, rvq, classes, count, rate)
    fixed = position_bits(classes, count)
    absence = np.bincount(classes, sensitivity.absence, count).astype(np.float64)
    first = base_rate(plans, chain, lambda _: fixed, absence, model_bits(rvq, latent), rate, BASE_SHARE)
    allocation = allocate(plans, chain, lambda _: fixed, absence, lost, layer_rates(rate, first, options.layers))
    classes = allocation.order[classes]
    values[Stream.LATENT] = latent_left
    if latent is not None:
        weights[Stream.LATENT] = np.repeat(latent.weight[:, None].astype(np.float64), latent_left.shape[1], axis=1)
    model, finals = build_model(
        Profile.EXPLICIT, 1, [*plans, latent_plan], allocation.rows, values, weights, classes, rate
    )
    report("allocate", 1.0)
    fields = HeaderFields(
        Profile.EXPLICIT,
        degree,
        1,
        placement.lattice.bits,
        placement.lattice.origin,
        placement.lattice.voxel,
        source_count,
        CoordinateFrame.RDF,
        ColourSpace.SRGB,
    )
    contents = tile_contents(model, placement, classes, finals, rvq)
    books = Codebooks(rvq.coarse, rvq.residual) if rvq and model.max_stages else None
    has_latent = bool(model.max_stages) or any(c.stream == Stream.LATENT for c in model.channels)
    return QuantisedScene(
        fields,
        model,
        placement.tiles,
        contents,
        books,
        latent.decoder if latent and has_latent else None,
        (),
        dict(options.metadata),
    )
