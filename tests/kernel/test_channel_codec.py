"""Channel steps read by the compiled library: values, counts and refusals of the definition (SPEC §7.5, §10.3)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from scarfmt.arrays import I32, I64
from scarfmt.coding.tile import TileContent
from scarfmt.container.schema import Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.kernel.channel import KernelChannel
from scarfmt.kernel.engine import KernelEngine
from scarfmt.kernel.stream_decoder import KernelRansDecoder
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.predictors import MAX_HIDDEN, Predictor, input_width
from scarfmt.scene.model import MAX_DEPTHS, NO_SOURCE, Channel, ContextRule
from tests.kernel.channel_cases import Case
from tests.kernel.samples import EXTREME, SEEDS, both, library, needs_kernel, outcome, same

pytestmark = needs_kernel


@settings(deadline=None, max_examples=50)
@given(SEEDS, st.integers(1, 6), st.sampled_from([0.0, 0.2]))
@example(0, 64, 0.0)
def test_static_contexts(seed: int, components: int, spoilt: float) -> None:
    """By class, by a source of any size, by the value refined; first steps and refinements."""
    assert same(*both(Case(seed, components, 0, 0.0, spoilt).read))


@settings(deadline=None, max_examples=80)
@given(SEEDS, st.integers(1, 6), st.integers(0, MAX_DEPTHS), st.sampled_from([0.0, 0.0, 0.2]))
@example(0, 45, 4, 0.0)
@example(1, 64, 2, 0.2)
def test_predicted_contexts(seed: int, components: int, depths: int, spoilt: float) -> None:
    """Some components and steps predicted, others not; any passes and depths; hidden units or none."""
    assert same(*both(Case(seed, components, depths, 0.7, spoilt).read))


@settings(deadline=None, max_examples=12)
@given(SEEDS, st.integers(0, MAX_HIDDEN), st.integers(1, 3))
@example(3, MAX_HIDDEN, 3)
def test_wide_predictors_of_many_anchors(seed: int, units: int, components: int) -> None:
    """Up to 64 hidden units; passes of more than one block, the last of them not full."""
    assert same(*both(Case(seed, components, 3, 1.0, 0.0, crowd=900, units=units).read))


def test_every_outcome_occurs() -> None:
    """The cases above are refused for each fault, and read to the end, often enough to mean something."""
    found = [both(Case(seed, 2, 2, 0.5, 0.15, crowd=30).read)[0] for seed in range(60)]
    refusals = [outcome[1] for outcome in found if len(outcome) == 5 and isinstance(outcome[0], type)]
    assert {"bad-trit", "value-range", "missing-table"} <= set(refusals)
    assert 10 < len(refusals) < 50


def one_symbol(step: int, value: int, *, components: int = 1) -> dict[TableKey, SymbolTable]:
    """Tables that give `value`, whatever the context."""
    table = SymbolTable(np.array([value]), np.array([1]))
    return {TableKey(Stream.COLOUR, c, step, k): table for c in range(components) for k in range(256)}


@pytest.mark.parametrize("predicted", [False, True])
@pytest.mark.parametrize(
    ("step", "value", "symbol", "refusal"),
    [
        (1, 0, EXTREME, ""),
        (1, 0, -EXTREME, ""),
        (2, 5, 2, "bad-trit"),
        (2, 5, EXTREME, "bad-trit"),
        (2, EXTREME // 3, 1, ""),
        (2, EXTREME // 3 + 1, -1, "value-range"),
        (2, -EXTREME, 1, "value-range"),
        (2, -EXTREME // 3, 1, "value-range"),
        (2, -EXTREME // 3, 2, "bad-trit"),
        (2, -(EXTREME // 3), -1, ""),
        (20, EXTREME, 0, "value-range"),
        (2, EXTREME, 2, "bad-trit"),
        (3, 0, None, "missing-table"),
    ],
)
def test_faults_of_values(predicted: bool, step: int, value: int, symbol: int | None, refusal: str) -> None:
    """Symbols that are no refinement, values beyond 32 bits, tables that are not there; a fault in the last anchor."""
    case = Case(0, 1, 1, 0.0, 0.0)
    count = case.count = 40
    case.codes, case.classes = np.arange(count, dtype=np.uint64), np.zeros(count, np.int64)
    case.scales, case.data = np.zeros((count, 3), np.int32), b""
    case.values = np.zeros((count, 1), np.int32)
    case.values[-1] = value
    case.before, case.after = np.full(count, step - 1), np.full(count, step)
    case.tables = {} if symbol is None else one_symbol(step, symbol)
    if predicted:
        output = Linear(np.ones((2, input_width(case.model, 1)), np.int32), np.zeros(2, np.int64), 4)
        case.predictors = {(Stream.COLOUR, 0, step): Predictor(Stream.COLOUR, 0, step, None, output, (16, 16))}
    compiled, plain = both(case.read)
    assert same(compiled, plain)
    assert (compiled[1] if refusal else "") == refusal


def test_values_may_be_views_of_the_tile() -> None:
    """The first anchors of a tile are written where they lie, and no further."""
    case = Case(7, 3, 2, 0.7, 0.0)
    whole = TileContent.empty(case.model, case.count + 5)
    for array in (*whole.values, *whole.first):
        array[:] = 77
    head = whole.head(case.count)
    head.values[1][:] = case.values
    head.first[0][:] = case.scales >> 3
    engine = KernelEngine(library())
    reader = engine.symbol_reader(case.data, case.tables)
    given = case.classes, (case.before, case.after), head.values[1], head.first, None
    outcome(lambda: engine.get_channel(reader, case.model.channels[1], *given))
    assert case.count > 9
    assert (head.values[1] != case.values).any()
    assert all((array[case.count :] == 77).all() for array in (*whole.values, *whole.first))
    assert (whole.values[0] == 77).all()


def test_arrays_of_another_kind_are_refused() -> None:
    """The library would write such arrays as another type."""
    channel = Channel(Stream.COLOUR, (1.0,) * 2, (ContextRule(), ContextRule(True, 1, 0)))
    good: list[Any] = [np.zeros((4, 2), np.int32), np.zeros((4, 2), np.int32), np.zeros(4, np.int64)]
    rans = KernelRansDecoder(library(), b"")

    def make(values: I32, first: I32, steps: I64) -> None:
        KernelChannel(rans, channel, np.zeros(4, np.int64), values, [np.zeros((4, 1), np.int32), first], steps)

    make(*good)
    for place, bad in [
        (0, np.zeros((4, 2), np.int64)),
        (0, np.zeros((2, 4), np.int32).T),
        (1, np.zeros((4, 4), np.int32)[:, ::2]),
        (2, np.zeros(4, np.int32)),
    ]:
        with pytest.raises(TypeError):
            make(*[bad if at == place else array for at, array in enumerate(good)])
    assert channel.rules[0].source_channel == NO_SOURCE
