"""The allocation of bits, shared by both profiles: layers, channels and final integers of one scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from reference_encoder.rdo.curves import RdCurve
from reference_encoder.rdo.layers import LayerChoice, price_layers
from reference_encoder.rdo.rdo_input import RdoInput
from reference_encoder.rdo.rounding import round_values
from scarfmt.arrays import F64, I32, I64, Floats
from scarfmt.codecs.channels import cell_widths
from scarfmt.container.schema import Stream
from scarfmt.scene.model import Channel, LayerRow, SceneModel

_ALWAYS = (Stream.SCALE, Stream.COLOUR)
"""SPEC §6.4 wants scales; with a colour channel, even an empty one, the decoder gives no degree 0 (SPEC §9.4)."""


@dataclass(frozen=True)
class Allocation:
    """The content of a file.

    Attributes:
        model: channels, classes and layers.
        integers: (N, components) int32 quantised values per channel.
        lambdas: of each layer that is kept.
    """

    model: SceneModel
    integers: Mapping[Stream, I32]
    lambdas: list[float]


def allocate(problem: RdoInput, curves: Sequence[RdCurve], choices: Sequence[LayerChoice]) -> Allocation:
    """Steps and classes of every layer, and the integers of the last.

    Args:
        problem, curves: what there is to decide, and what it costs.
        choices: what each layer shows, whole classes (`RdoInput.split`); layers that add nothing are left out.
    """
    costs = price_layers(problem, curves)
    rows: dict[LayerRow, float] = {}
    for choice in choices:
        steps = tuple(costs.steps(choice))
        rows.setdefault(LayerRow((0,) * len(steps), steps), choice.lambda_)
    model, integers = _quantise(problem, curves, list(rows))
    return Allocation(model, integers, [*list(rows.values())[:-1], problem.lambda_])


def _quantise(
    problem: RdoInput, curves: Sequence[RdCurve], rows: Sequence[LayerRow]
) -> tuple[SceneModel, dict[Stream, I32]]:
    """The model of `rows`, and the final integers of every channel that any class receives."""
    classes = problem.classes.of
    integers: dict[Stream, I32] = {}
    used: list[int] = []
    for index, curve in enumerate(curves):
        steps = np.array([row[index] for row in rows[-1].steps])
        if not steps.any() and curve.stream not in _ALWAYS:
            continue
        used.append(index)
        values, weight = problem.values[curve.stream], problem.weights[curve.stream]
        final = quantise_channel(values, weight, classes, (curve.step, steps), problem.lambda_)
        integers[curve.stream] = final
    channels = tuple(Channel(curves[i].stream, curves[i].step) for i in used)
    kept = tuple(LayerRow(row.stages, tuple(tuple(s[i] for i in used) for s in row.steps)) for row in rows)
    return SceneModel(problem.profile, problem.slots, channels, kept), integers


def quantise_channel(
    values: Floats, weight: F64, classes: I64, received: tuple[Sequence[float], I64], lambda_: float
) -> I32:
    """(N, components) int32 integers of the last layer; 0 for classes that receive none.

    Args:
        values, weight: (N, components), true ones, and squared picture error per squared unit.
        classes: (N,).
        received: first width per component, and (classes,) steps.
        lambda_: of the last layer, squared picture error per bit.
    """
    step, steps = received
    final = round_values(values, weight, classes, lambda_, cell_widths(step, np.maximum(steps, 1)))
    if not steps.all():
        final *= (steps > 0)[classes, None]
    return final
