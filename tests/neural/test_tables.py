"""The literal tables are those of their formulas."""

from __future__ import annotations

import math

import pytest

from scarfmt.neural.tables import EXP2, SIGMOID, TANH, exp2_table, state_table


def test_the_tables_are_the_rounded_functions() -> None:
    """Every entry lies within a half of its function (and a hair, for the function's own rounding)."""
    assert (len(TANH), len(SIGMOID), len(EXP2)) == (256, 256, 32)
    for u in range(256):
        assert abs(TANH[u] - 2047 * math.tanh(u / 32)) < 0.5 + 1e-9
        assert abs(SIGMOID[u] - 4096 / (1 + math.exp(-u / 32))) < 0.5 + 1e-9
    for f in range(32):
        assert abs(EXP2[f] - 65536 * 2 ** (-f / 32)) < 0.5 + 1e-9


@pytest.mark.parametrize("bits", range(8, 13))
def test_states_are_odd_and_fill_the_activations(bits: int) -> None:
    """tanh12 brought to each activation width, by the rule of SPEC §10.1, from -255 to 255."""
    top = (1 << (bits - 1)) - 1
    found = state_table(bits).tolist()
    for u, value in zip(range(-255, 256), found, strict=True):
        fine = TANH[u] if u >= 0 else -TANH[-u]
        shifted = fine if bits == 12 else (fine + (1 << (11 - bits))) >> (12 - bits)
        assert value == max(-top, min(top, shifted))
    assert (min(found), max(found)) == (-top, top)


def test_weights_halve_every_32_steps_and_end_in_0() -> None:
    """exp2w(0..511), then 0 for all that is further."""
    found = exp2_table().tolist()
    assert found == [EXP2[d % 32] >> (d // 32) for d in range(512)] + [0]
    assert found[0] == 65536
    assert found[511] > 0
