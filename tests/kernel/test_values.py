"""Channel values by the compiled library: the bits of the definition (SPEC §9.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.codecs.channels import width_table
from scarfmt.kernel.values import kernel_values
from scarfmt.scene.model import MAX_STEPS
from tests.kernel.samples import EXTREME, SEEDS, both, library, needs_kernel, same

pytestmark = needs_kernel


@settings(deadline=None, max_examples=80)
@given(SEEDS, st.integers(0, 60), st.integers(1, 64))
def test_values(seed: int, count: int, components: int) -> None:
    """Values of any number of steps agree up to the ends of 32 bits; some widths bring them to 0, some to infinity."""
    rng = np.random.default_rng(seed)
    values = (rng.integers(-EXTREME, EXTREME + 1, (count, components)) >> rng.integers(0, 32)).astype(np.int32)
    width = tuple(np.exp2(rng.uniform(-160, 130, components)).tolist())
    steps = rng.integers(0, MAX_STEPS + 1, count)
    compiled, plain = both(lambda engine: engine.channel_values(values, width, steps))
    assert same(compiled, plain)
    assert compiled.dtype == np.float32


@settings(deadline=None, max_examples=20)
@given(SEEDS)
def test_values_that_lie_in_any_order(seed: int) -> None:
    """Rows, planes and what is turned round are the same values."""
    rng = np.random.default_rng(seed)
    values, steps = rng.integers(-99, 100, (7, 3)).astype(np.int32), rng.integers(0, 4, 7)
    table = width_table((1.0, 2.0, 3.0))
    rows = kernel_values(library(), values, steps, table)
    assert same(kernel_values(library(), np.asfortranarray(values), steps, table), rows)
    assert same(kernel_values(library(), values[:, ::-1], steps, np.ascontiguousarray(table[:, ::-1])), rows[:, ::-1])


def test_arrays_that_do_not_fit_are_refused() -> None:
    """Memory is never read as what it is not, or past its end."""
    values, steps, table = np.zeros((4, 2), np.int32), np.zeros(4, np.int64), width_table((1.0, 2.0))
    others: list[tuple[Any, Any, Any]] = [
        (values.astype(np.int64), steps, table),
        (values, steps[1:], table),
        (values, steps.astype(np.int32), table),
        (values, steps, table[:, :1]),
        (values, steps, table.astype(np.float32)),
    ]
    for given_values, given_steps, widths in others:
        with pytest.raises(TypeError):
            kernel_values(library(), given_values, given_steps, widths)
    for step in (-1, MAX_STEPS + 1):
        with pytest.raises(IndexError):
            kernel_values(library(), values, np.full(4, step), table)
