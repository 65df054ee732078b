"""Cells wide enough for tables: integers of a component take at most 4096 different values (SPEC §8.1, §8.3).

Only a run that hardly prices bytes makes cells so narrow that no file can have them. Training goes on with wider ones,
so that its pictures stay those of the file.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from reference_encoder.training.layers import coarse
from reference_encoder.training.state import State
from scarfmt.entropy.rans import MAX_ALPHABET

_WIDER = math.log(1.25)


@torch.no_grad()
def fit_alphabets(state: State) -> int:
    """Widen cells, by steps of a quarter, until the first-step integers of each component fit a table.

    Args:
        state: its `log_widths` and `log_offset_widths` change.

    Returns:
        How many components have wider cells than before.
    """
    a = state.anchors
    opened = a.first < state.plan.count
    rows = opened.any(dim=1).nonzero()[:, 0]
    values = [a.scaling[rows]] + ([] if state.vectors else [a.latent[rows]])
    widened = _widen(torch.cat(values, dim=1), state.log_widths, state.plan.steps[-1] - 1)
    return widened + _widen(a.offsets[opened], state.log_offset_widths, 0)


def _widen(values: Tensor, log_widths: Tensor, steps: int) -> int:
    """(n, d) values in (d,) cells that are finer than those of the first step by so many ternary `steps`."""
    widened = 0
    for component, column in enumerate(values.T):
        before = float(log_widths[component])
        while _different(column, log_widths[component], steps) > MAX_ALPHABET:
            log_widths[component] += _WIDER
        widened += float(log_widths[component]) > before
    return widened


def _different(column: Tensor, log_width: Tensor, steps: int) -> int:
    """How many different integers the first step has."""
    finest = torch.round(column / torch.exp(log_width))[:, None]
    return len(torch.unique(coarse(finest, torch.full_like(column, steps, dtype=torch.long))))
