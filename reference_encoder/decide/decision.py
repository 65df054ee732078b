"""The decision both profiles share: layers, channels and final integers of one scene (encoder side)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from reference_encoder.decide.contexts import choose_rules, enough_anchors
from reference_encoder.decide.layering import LayerChoice
from reference_encoder.decide.plans import Plans, layer_costs
from reference_encoder.decide.problem import Problem
from reference_encoder.decide.rdo import choose_values
from scarfmt.arrays import F64, I64
from scarfmt.codecs.channels import cell_widths, coarsen
from scarfmt.container.schema import Stream
from scarfmt.scene.model import Channel, LayerRow, SceneModel

_ALWAYS = (Stream.SCALE, Stream.COLOUR)
"""SPEC §6.4 wants scales; with a colour channel, even an empty one, the decoder gives no degree 0 (SPEC §9.4)."""


@dataclass(frozen=True)
class Decision:
    """The decision about the content of a file.

    Attributes:
        model: channels, classes and layers.
        finals: (N, components) quantised values per channel.
        classes: (N,) classes.
        lambdas: of each layer that is kept.
    """

    model: SceneModel
    finals: Mapping[Stream, I64]
    classes: I64
    lambdas: list[float]


def decide(problem: Problem, plans: Plans, choices: Sequence[LayerChoice]) -> Decision:
    """Steps, stages and classes of every layer, and the integers of the last.

    Args:
        problem, plans: what there is to decide, and what it costs.
        choices: what each layer shows, whole classes (`Problem.split`); layers that add nothing are left out.
    """
    costs = layer_costs(problem, plans)
    rows: dict[LayerRow, float] = {}
    for choice in choices:
        entries = costs.entries(choice)
        rows.setdefault(LayerRow(tuple(e[0] for e in entries), tuple(e[1:] for e in entries)), choice.lambda_)
    model, finals = _modelled(problem, plans, list(rows))
    return Decision(model, finals, problem.classes.of, [*list(rows.values())[:-1], problem.budget.lambda_])


def _modelled(problem: Problem, plans: Plans, rows: Sequence[LayerRow]) -> tuple[SceneModel, dict[Stream, I64]]:
    """The model of `rows`, and the final integers of every channel that any class receives."""
    classes = problem.classes.of
    finals: dict[Stream, I64] = {}
    firsts: list[I64] = []
    some = enough_anchors(len(classes))
    used: dict[int, Stream] = {}
    every = [*plans.channels, plans.latent]
    for index, plan in enumerate(every):
        steps = np.array([row[index] for row in rows[-1].steps])
        if not steps.any() and plan.stream not in _ALWAYS:
            continue
        used[index] = plan.stream
        values, weight = _goal(problem, plans, plan.stream)
        final = final_values(values, weight, classes, (plan.step, steps), problem.budget.lambda_)
        finals[plan.stream] = final
        firsts.append(coarsen(final[some], np.maximum(steps - 1, 0)[classes[some], None]))
    rules = choose_rules(list(used.values()), firsts, classes[some], problem.repeat * len(classes))
    channels = tuple(Channel(every[i].stream, every[i].step, rule) for i, rule in zip(used, rules, strict=True))
    kept = tuple(LayerRow(row.stages, tuple(tuple(s[i] for i in used) for s in row.steps)) for row in rows)
    return SceneModel(problem.geometry.profile, problem.geometry.slots, channels, kept), finals


def final_values(
    values: F64, weight: F64, classes: I64, received: tuple[Sequence[float], I64], lambda_: float
) -> I64:
    """(N, components) integers of the last layer; 0 for classes that receive none.

    Args:
        values, weight: (N, components), true ones, and squared picture error per squared unit.
        classes: (N,).
        received: first width per component, and (classes,) steps.
        lambda_: of the last layer, squared picture error per bit.
    """
    step, steps = received
    final = choose_values(values, weight, classes, lambda_, cell_widths(step, np.maximum(steps, 1)))
    if not steps.all():
        final *= (steps > 0)[classes, None]
    return final


def _goal(problem: Problem, plans: Plans, stream: Stream) -> tuple[F64, F64]:
    """(N, components) true values of a channel, and weights or (N, 1); of LATENT, what the codewords leave."""
    if stream != Stream.LATENT:
        return problem.channels.values[stream], problem.channels.weights[stream]
    assert problem.fitted is not None
    return plans.left, problem.fitted.latent.weight[:, None].astype(np.float64)
