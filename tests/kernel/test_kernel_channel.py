"""Channel steps read by the compiled library: values, counts and refusals of the definition (SPEC §7.5, §10.3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kernel.samples import SEEDS, both, library, needs_kernel, outcome, random_stream, same
from scarfmt.codecs.channels import get_channel
from scarfmt.counters import Counters
from scarfmt.directory import TileFrame
from scarfmt.kernel.channel import KernelChannel
from scarfmt.kernel.rans import KernelRansDecoder
from scarfmt.model import (
    MAX_CLASSES,
    MAX_DEPTHS,
    MAX_STEPS,
    NO_SOURCE,
    Channel,
    ContextRule,
    DecodedContext,
    LayerRow,
    SceneModel,
)
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.layer_context import LayerContext
from scarfmt.neural.predicted import PredictedChannel, PredictorSet
from scarfmt.neural.predictors import AMAX, MAX_HIDDEN, Predictor, input_width
from scarfmt.schema import Profile, Stream
from scarfmt.symbols import SymbolReader, SymbolTable, TableKey
from scarfmt.tile import TileContent

pytestmark = needs_kernel

I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
EXTREME = (1 << 31) - 1
BITS = 6


class Case:
    """The colours of a tile-layer, with scales before them, under any tables, rules and predictors.

    Args:
        components: of the colours; more than files may have.
        depths: of the decoded context.
        share: of components with a predictor, in each step.
        spoilt: of tables that are missing or hold values that are none.
        crowd: anchors.
    """

    def __init__(
        self, seed: int, components: int, depths: int, share: float, spoilt: float, crowd: int = 60, units: int = 5
    ) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.count, self.share, self.spoilt, self.units = int(rng.integers(0, crowd)), share, spoilt, units
        rules = tuple(self._rule(component) for component in range(components))
        channels = (
            Channel(Stream.SCALE, (1.0,) * 3, (ContextRule(),) * 3),
            Channel(Stream.COLOUR, (1.0,) * components, rules),
        )
        occupancies = tuple(sorted(rng.choice([1, 2, 3, 8, 300], depths, replace=False).tolist(), reverse=True))
        context = DecodedContext(int(rng.integers(0, 4)), occupancies)
        self.model = SceneModel(Profile.EXPLICIT, 1, channels, (LayerRow((0,), ((1, 1),)),), context)
        self.codes = rng.integers(0, 1 << 3 * BITS, self.count, np.uint64) >> rng.integers(0, 19, self.count, np.uint64)
        self.classes = rng.integers(0, MAX_CLASSES, self.count)
        lowest = int(rng.choice([0, 0, 1, 7, MAX_STEPS - 3]))
        self.before = lowest + rng.integers(0, 3, self.count)
        self.after = np.minimum(self.before + rng.integers(0, 3, self.count), MAX_STEPS)
        self.steps = range(lowest + 1, min(lowest + 4, MAX_STEPS) + 1)
        self.scales = self._spread((self.count, 3), EXTREME).astype(np.int32)
        reach = int(rng.choice([3, 3000, EXTREME // 30, EXTREME]))
        self.values = (self._spread((self.count, components), reach) * (self.before > 0)[:, None]).astype(np.int32)
        self.predictors = self._predictors()
        self.tables = self._tables()
        words = int(rng.choice([0, 1, 2, 40, 4 * self.count * components]))
        self.data = random_stream(rng, words)

    def _spread(self, shape: tuple[int, ...], top: int) -> I64:
        out = np.rint(np.exp2(self.rng.uniform(0, np.log2(top), shape))).astype(np.int64)
        out[self.rng.random(shape) < 0.1] = top
        return np.minimum(out, top) * self.rng.integers(-1, 2, shape)

    def _rule(self, component: int) -> ContextRule:
        by_class = bool(self.rng.integers(2))
        sources = [(0, int(self.rng.integers(3))), *([(1, int(self.rng.integers(component)))] if component else [])]
        if self.rng.random() < 0.3:
            return ContextRule(by_class)
        channel, source = sources[int(self.rng.integers(len(sources)))]
        low = int(self.rng.choice([-7, 0, 3, -(2**32), 2**32 - 1, EXTREME, -EXTREME]))
        return ContextRule(by_class, channel, source, low, int(self.rng.choice([0, 1, 4, 28, 31])))

    def _linear(self, rows: int, columns: int) -> Linear:
        top = int(self.rng.choice([1, 20, (1 << 23) // AMAX // columns]))
        weights = self.rng.integers(-top, top + 1, (rows, columns)).astype(np.int32)
        shift = int(self.rng.integers(0, 20))
        return Linear(weights, self.rng.integers(-(1 << 22), 1 << 22, rows) >> self.rng.integers(0, 22, rows), shift)

    def _predictors(self) -> dict[tuple[int, int, int], Predictor]:
        found, inputs = {}, input_width(self.model, 1)
        for step in self.steps:
            share = self.share if self.rng.random() < 0.7 else 0
            for component in range(self.model.channels[1].components):
                if self.rng.random() < share:
                    units = int(self.rng.choice([0, 1, 2, 3, self.units]))
                    hidden = self._linear(units, inputs) if units else None
                    buckets = ((16, 16), (256, 1), (1, 256), (1, 1), (7, 5))[int(self.rng.integers(5))]
                    made = Predictor(Stream.COLOUR, component, step, hidden, self._linear(2, inputs + units), buckets)
                    made.check()
                    found[made.key] = made
        return found

    def _tables(self) -> Mapping[TableKey, SymbolTable]:
        tables = {}
        for step in self.steps:
            pool = [self._table(step) for _ in range(12)]
            for component in range(self.model.channels[1].components):
                chosen = self.rng.integers(0, len(pool), 256)
                there = self.rng.random(256) >= self.spoilt / 8
                for context in np.flatnonzero(there).tolist():
                    tables[TableKey(Stream.COLOUR, component, step, context)] = pool[chosen[context]]
        return tables

    def _table(self, step: int) -> SymbolTable:
        alphabet = np.array([-1, 0, 1])
        if step == 1:
            alphabet = np.unique(self._spread((int(self.rng.integers(1, 40)),), int(self.rng.choice([5, EXTREME]))))
        elif self.rng.random() < self.spoilt / 4:
            alphabet = np.unique([*alphabet, self.rng.choice([-2, 2, EXTREME, -EXTREME])])
        elif self.rng.random() < 0.2:
            alphabet = alphabet[:1]
        return SymbolTable(alphabet, self.rng.integers(1, 1 << 24, len(alphabet)))

    def read(self) -> Any:
        """All that a layer's reading changes."""
        counters, values = Counters(), self.values.copy()
        first = [(self.scales >> 3).copy(), (self.values >> 5).copy()]
        context = LayerContext(self.model, TileFrame(BITS), self.codes, self.classes, counters=counters)
        context.settle(0, self.scales, np.full(self.count, 3))
        reader = SymbolReader(self.data, self.tables)
        predicted = None
        if self.predictors:
            predicted = PredictedChannel(context, 1, PredictorSet(self.predictors), values, self.before)
        given = self.before.copy(), self.after.copy()
        get_channel(reader, self.model.channels[1], self.classes, *given, values, first, predicted)
        assert np.array_equal(given[0], self.before)
        # What the stream has left: a few symbols more.
        return values, first, reader.static, counters, reader.read_uniform(4096, 6)


COMPONENTS = st.one_of(st.integers(1, 6), st.sampled_from([1, 64]))


@settings(deadline=None, max_examples=50)
@given(SEEDS, st.integers(1, 6), st.sampled_from([0.0, 0.2]))
@example(0, 64, 0.0)
def test_static_contexts(seed: int, components: int, spoilt: float) -> None:
    """By class, by a source of any size, by the value refined; first steps and refinements."""
    assert same(*both(Case(seed, components, 0, 0.0, spoilt).read))


@settings(deadline=None, max_examples=80)
@given(SEEDS, st.integers(1, 6), st.integers(0, MAX_DEPTHS), st.sampled_from([0.0, 0.0, 0.2]))
@example(0, 64, 4, 0.0)
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
    reader = SymbolReader(case.data, case.tables)
    given = case.classes, case.before, case.after, head.values[1], head.first
    outcome(lambda: get_channel(reader, case.model.channels[1], *given))
    assert case.count > 9
    assert (head.values[1] != case.values).any()
    assert all((array[case.count :] == 77).all() for array in (*whole.values, *whole.first))
    assert (whole.values[0] == 77).all()


def test_arrays_of_another_kind_are_refused() -> None:
    """They would be written as what they are not."""
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
