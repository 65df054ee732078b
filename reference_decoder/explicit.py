"""Explicit profile: from exact channel values and latents to Gaussians (SPEC §9.3-9.5).

These are activated outputs: within a tolerance of the float64 reference, not bit-exact. Work goes in chunks, so
that scratch memory does not grow with the scene.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_decoder.dequantise import latents
from scarfmt.arrays import F32, F64, I16, I64, Floats
from scarfmt.coding.checks_of_models import network_coefficients
from scarfmt.coding.engine import Activation
from scarfmt.coding.models import SceneModels
from scarfmt.container.schema import Stream
from scarfmt.counters import Counters, Part
from scarfmt.scene.activation import activated
from scarfmt.scene.gaussians import GaussianScene

_ACTIVATED = (Stream.ROTATION, Stream.OPACITY, Stream.COLOUR)
CHUNK = 1 << 14
"""Rows at a time; the networks' hidden layers of so many rows fit in the caches."""


def gaussians(
    positions: F64,
    values: Mapping[Stream, F32],
    models: SceneModels,
    sh_degree: int,
    indices: I16,
    stages: I64,
    dtype: type = np.float32,
    counters: Counters | None = None,
    activation: Activation | None = None,
) -> GaussianScene:
    """The Gaussians of n anchors.

    Args:
        positions: (n, 3) float64, used as they are.
        values: exact channel values, (n, components) float32; SCALE is needed, the others count as 0.
        models: codebooks and latent decoder.
        sh_degree: of the file, 0..3.
        indices: (n, M) int16 codeword numbers.
        stages: (n,) int64 stages received.
        dtype: float32, or float64 for the reference the tolerances are relative to (SPEC §9.5).
        counters: of the latent decoder's multiply-adds.
        activation: what does it in float32; None for NumPy.
    """
    count = len(positions)
    if activation is not None:
        out = empty_scene(count, sh_degree)
        out.positions[:], out.log_scales[:] = positions, values[Stream.SCALE]
        activation.fill(out, values, indices, stages)
        count_decoder(models, count, counters)
        return out
    rotations: NDArray[Any] = np.zeros((count, 4), dtype)
    logits: NDArray[Any] = np.zeros(count, dtype)
    sh: NDArray[Any] = np.zeros((count, (sh_degree + 1) ** 2, 3), dtype)
    given = network_coefficients(sh_degree, models.model) if models.decoder else 0
    for first in range(0, count, CHUNK):
        rows = slice(first, first + CHUNK)
        part = {stream: values[stream][rows] for stream in _ACTIVATED if stream in values}
        rotations[rows], logits[rows], sh[rows, 0] = activated(part, len(logits[rows]), dtype)
        if given:
            rest = network_outputs(models, values.get(Stream.LATENT), indices, stages, rows, dtype, counters)
            sh[rows, sh.shape[1] - given :] = rest.reshape(-1, given, 3)
    return GaussianScene(positions, values[Stream.SCALE].astype(dtype, copy=False), rotations, logits, sh)


def empty_scene(count: int, sh_degree: int) -> GaussianScene:
    """Room for `count` Gaussians."""
    coefficients = (sh_degree + 1) ** 2
    rows = [np.empty((count, *shape), np.float32) for shape in ((3,), (4,), (), (coefficients, 3))]
    return GaussianScene(np.empty((count, 3)), *rows)


def count_decoder(models: SceneModels, count: int, counters: Counters | None) -> None:
    """Count the multiply-adds of the latent decoder for `count` anchors."""
    if counters is not None and models.decoder is not None:
        counters.multiply(Part.LATENT_DECODER, count, sum(layer.weights.size for layer in models.decoder.layers))


def network_outputs(
    models: SceneModels,
    refinements: F32 | None,
    indices: I16,
    stages: I64,
    rows: slice,
    dtype: type,
    counters: Counters | None = None,
) -> Floats:
    """(n, outputs) of the latent decoder for `rows`, computed in `dtype`; the latents themselves are exact."""
    assert models.decoder is not None
    count_decoder(models, len(indices[rows]), counters)
    refined = None if refinements is None else refinements[rows]
    z = latents(models.codebooks, indices[rows], stages[rows], refined, models.decoder.inputs)
    with np.errstate(over="ignore", invalid="ignore"):  # weights may be any finite number: not a reason to warn
        return models.decoder.apply(z, dtype)
