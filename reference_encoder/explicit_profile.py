"""The explicit profile: any trained 3D Gaussian scene to a :class:`QuantisedScene` (encoder side)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_encoder.allocate import classify
from reference_encoder.assemble import BASE_SHARE, final_rate, position_bits
from reference_encoder.attributes import Attributes, from_scene
from reference_encoder.decide import Problem, best_step, codebooks, contents, decide, decoder, header_fields, targets
from reference_encoder.fit_latent import fit_latent
from reference_encoder.lattice import place
from reference_encoder.options import EncodeOptions
from reference_encoder.sensitivity import Sensitivity, measure, survey
from reference_encoder.targets import Targets
from scarfmt.scene import GaussianScene
from scarfmt.schema import Profile, Stream
from scarfmt.writer import QuantisedScene, Report, silent

I64 = NDArray[np.int64]

CHANNELS = (Stream.SCALE, Stream.ROTATION, Stream.OPACITY, Stream.COLOUR)
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


def encode_explicit(
    scene: GaussianScene, options: EncodeOptions, report: Report = silent
) -> tuple[QuantisedScene, Targets | None]:
    """Decide everything about a file for `scene`, and tell what its codewords are to reproduce."""
    report("visibility", 0.0)
    attributes = from_scene(scene)
    sensitivity = measure(scene, attributes, survey(scene, options))
    rate = final_rate(options, len(scene))
    classes, count = classify(sensitivity.absence, rate, _CHEAPEST_BITS, _MOST_CLASSES)
    kept = np.flatnonzero(classes >= 0)
    lost = float(sensitivity.absence[classes < 0].sum())
    report("visibility", 1.0)
    seen = _Seen(attributes.take(kept), sensitivity.take(kept), classes[kept], count, rate, lost)
    problem = _problem(seen, scene.sh_degree, options, report)
    report("allocate", 0.0)
    decision = decide(problem, options.layers)
    report("allocate", 1.0)
    quantised = QuantisedScene(
        header_fields(problem, scene.sh_degree, len(scene)),
        decision.model,
        problem.placement.tiles,
        contents(problem, decision),
        codebooks(problem, decision.model),
        decoder(problem, decision.model),
        (),
        dict(options.metadata),
    )
    return quantised, targets(problem, decision)


@dataclass(frozen=True)
class _Seen:
    """What is left to encode after the invisible is gone."""

    attributes: Attributes
    sensitivity: Sensitivity
    classes: I64
    count: int
    rate: float
    lost: float


def _problem(seen: _Seen, degree: int, options: EncodeOptions, report: Report) -> Problem:
    attributes, classes, rate = seen.attributes, seen.classes, seen.rate
    weights = dict(seen.sensitivity.channels)
    wanted = best_step(weights[Stream.POSITION_RESIDUAL][:, 0], rate)
    placement = place(attributes.positions, wanted, options.tile_anchors)
    weights[Stream.POSITION_RESIDUAL] = weights[Stream.POSITION_RESIDUAL] * (placement.cell**2)[:, None]
    latent, rvq = None, None
    if degree:
        weight = seen.sensitivity.colour * _REST_SHARE
        latent, rvq = fit_latent(attributes.rest, weight, classes, rate, 0, options, report)
    values = {Stream.POSITION_RESIDUAL: placement.residual}
    for stream in CHANNELS:
        values[stream] = attributes.channel(stream)
    fixed = position_bits(classes, seen.count)
    return Problem(
        Profile.EXPLICIT,
        1,
        placement,
        values,
        weights,
        COARSEST_STEP,
        latent,
        rvq,
        classes,
        seen.count,
        rate,
        seen.sensitivity.absence,
        lambda _: fixed,
        seen.lost,
        BASE_SHARE,
    )
