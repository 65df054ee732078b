"""Channels: nested rounding, and refinement from any step to any later one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.arrays import I32, I64
from scarfmt.codecs.channels import check_reach, coarsen, contexts, get_channel, put_channel, trit_contexts
from scarfmt.container.schema import Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.errors import Malformed
from scarfmt.scene.model import NO_SOURCE, Channel, ContextRule
from tests.samples.codec_samples import Recorder, emitting, reader_of, refuses

EDGE = 2**31 - 1
VALUES = st.one_of(st.integers(-40, 40), st.integers(-EDGE, EDGE), st.sampled_from([EDGE, -EDGE, 0]))


# ------------------------------------------------------------------------------------------------ rounding


@given(VALUES, st.integers(0, 19))
def test_coarsening_is_rounding_to_nearest(value: int, steps: int) -> None:
    """The result is the cell whose centre is nearest; an odd number of subcells leaves no tie."""
    cell = int(coarsen(np.array([value]), steps)[0])
    assert 2 * abs(value - cell * 3**steps) < 3**steps or (steps == 0 and cell == value)


@given(VALUES, st.integers(0, 10), st.integers(0, 9))
def test_coarsening_in_steps_is_coarsening_at_once(value: int, first: int, then: int) -> None:
    """Cells nest: that is what makes any prefix of refinements a rounding of its own."""
    values = np.array([value])
    assert coarsen(coarsen(values, first), then).tolist() == coarsen(values, first + then).tolist()


@given(VALUES)
def test_a_refinement_is_always_a_trit(value: int) -> None:
    """v - 3 * coarsen(v) is -1, 0 or 1, for negative values too."""
    values = np.array([value], np.int32)
    assert abs(value - 3 * int(coarsen(values, 1)[0])) <= 1


def test_steps_may_differ_by_anchor() -> None:
    """The broadcast form agrees with the scalar one."""
    values = np.arange(-20, 20)
    steps = np.arange(40) % 4
    alone = [int(coarsen(values[i : i + 1], int(steps[i]))[0]) for i in range(40)]
    assert coarsen(values, steps).tolist() == alone


# ------------------------------------------------------------------------------------------------ contexts


@given(
    st.lists(st.tuples(st.integers(0, 14), st.integers(-EDGE, EDGE)), max_size=20),
    st.booleans(),
    st.one_of(st.integers(-40, 40), st.integers(-(2**32), 2**32 - 1)),
    st.integers(0, 31),
)
def test_contexts_are_the_formula(anchors: list[tuple[int, int]], by_class: bool, low: int, shift: int) -> None:
    """SPEC §8.4 in unbounded integers; `low` has 33 bits, and nothing wraps."""
    classes, source = np.array([a[0] for a in anchors], np.int64), np.array([a[1] for a in anchors], np.int32)
    rule = ContextRule(by_class, 0, 1, low, shift)
    first = [np.stack([np.zeros_like(source), source], axis=1).reshape(-1, 2)]
    wanted = [(16 * c if by_class else 0) + min(max((s - low) >> shift, 0), 15) for c, s in anchors]
    assert contexts(rule, classes, first).tolist() == wanted
    plain = ContextRule(by_class)
    assert contexts(plain, classes, first).tolist() == [16 * c if by_class else 0 for c, _ in anchors]
    clamped = [(16 * c if by_class else 0) + min(max(s, -2), 2) + 2 for c, s in anchors]
    assert trit_contexts(plain, classes, source.astype(np.int64)).tolist() == clamped
    assert max([0, *wanted]) < 256


# ------------------------------------------------------------------------------------------------ coding


@dataclass
class Case:
    """One tile's channel, refined from `before` to `after`; final values are at `at` >= `after` steps."""

    channel: Channel
    classes: I64
    before: I64
    after: I64
    values: I32
    at: I64
    source: I32

    @property
    def start(self) -> I32:
        """The values that a decoder holds on entry."""
        return self._at(self.before)

    @property
    def first(self) -> list[I32]:
        """First-step values of a source channel and of this one."""
        return [self.source, self._at(np.minimum(self.at, 1))]

    def _at(self, steps: I64) -> I32:
        coarse = coarsen(self.values, (self.at - steps)[:, None])
        return np.where(steps[:, None] > 0, coarse, 0).astype(np.int32)

    def check(self) -> None:
        first, final = self.first, (self.values, self.at)
        reader = reader_of(
            lambda emitter: put_channel(emitter, self.channel, self.classes, self.before, self.after, final, first)
        )
        values = self.start
        known = [self.source, np.where(self.before[:, None] > 0, first[1], 0).astype(np.int32)]
        get_channel(reader, self.channel, self.classes, self.before, self.after, values, known)
        reader.finish()
        assert np.array_equal(values, self._at(self.after))
        assert np.array_equal(known[1], np.where(self.after[:, None] > 0, first[1], 0))


def channel(components: int = 3) -> Channel:
    """Contexts by class, by a source channel, by an earlier component of the same channel."""
    rules = [ContextRule(True), ContextRule(True, 0, 0, -5, 1), ContextRule(False, 1, 0, -3, 0)]
    return Channel(Stream.COLOUR, (0.1,) * components, tuple(rules[:components]))


@st.composite
def cases(draw: st.DrawFn) -> Case:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count, deepest = draw(st.integers(0, 25)), draw(st.sampled_from([1, 3, 6, 20]))
    at = np.sort(rng.integers(0, deepest + 1, (3, count)), axis=0)
    scale = draw(st.sampled_from([1, 30, EDGE]))
    values = rng.integers(-scale, scale + 1, (count, 3))
    values[rng.random((count, 3)) < 0.1] = EDGE
    final: I32 = np.where(at[2][:, None] > 0, values, 0).astype(np.int32)
    source = rng.integers(-30, 30, (count, 1)).astype(np.int32)
    classes = rng.integers(0, 15, count)
    return Case(channel(), classes, at[0], at[1], final, at[2], source)


@settings(deadline=None, max_examples=150)
@given(cases())
def test_steps_come_back_from_anywhere_to_anywhere(case: Case) -> None:
    """Anchors at different steps, in one layer; values up to the ends of 32 bits, at up to 20 steps."""
    case.check()


@pytest.mark.parametrize("value", [EDGE, -EDGE])
@pytest.mark.parametrize("steps", [1, 20])
def test_the_extremes_of_32_bits_come_back(value: int, steps: int) -> None:
    """Extremes come back as a first value, and when nineteen refinements reach them."""
    count, none = np.array([steps]), np.zeros(1, np.int64)
    values = np.full((1, 3), value, np.int32)
    Case(channel(), none, none, count, values, count, np.zeros((1, 1), np.int32)).check()


def test_a_layer_that_refines_nothing_emits_nothing() -> None:
    """A layer without refinements emits nothing, even if anchors already have different steps."""
    recorder, steps = Recorder(), np.array([0, 2, 5])
    values, first = np.zeros((3, 3), np.int32), [np.zeros((3, 1), np.int32), np.zeros((3, 3), np.int32)]
    put_channel(recorder, channel(), np.zeros(3, np.int64), steps, steps, (values, steps), first)
    assert recorder.groups == []


def test_symbols_travel_step_by_step_then_component_by_component() -> None:
    """The order of SPEC §7.5, fixed for other implementations."""
    recorder, one = Recorder(), np.array([2, 2])
    values = np.array([[4, -4, 0], [-1, 1, 2]], np.int32)
    plain = Channel(Stream.SCALE, (0.1,) * 3, (ContextRule(False),) * 3)
    put_channel(recorder, plain, np.zeros(2, np.int64), one * 0, one, (values, one), [values])
    expected = [
        (TableKey(Stream.SCALE, 0, 1, 0), [1, 0]),
        (TableKey(Stream.SCALE, 1, 1, 0), [-1, 0]),
        (TableKey(Stream.SCALE, 2, 1, 0), [0, 1]),
        (TableKey(Stream.SCALE, 0, 2, 2), [-1]),
        (TableKey(Stream.SCALE, 0, 2, 3), [1]),
        (TableKey(Stream.SCALE, 1, 2, 1), [-1]),
        (TableKey(Stream.SCALE, 1, 2, 2), [1]),
        (TableKey(Stream.SCALE, 2, 2, 2), [0]),
        (TableKey(Stream.SCALE, 2, 2, 3), [-1]),
    ]
    assert recorder.groups == expected


def read_one(symbols: list[tuple[int, int, int]], before: int, start: int) -> I32:
    """Read steps of one anchor and component from crafted (step, context, symbol) groups."""
    plain = Channel(Stream.OPACITY, (0.1,), (ContextRule(False),))
    reader = emitting(*[(TableKey(Stream.OPACITY, 0, step, context), [symbol]) for step, context, symbol in symbols])
    values = np.array([[start]], np.int32)
    steps = np.array([before]), np.array([before + len(symbols)])
    get_channel(reader, plain, np.zeros(1, np.int64), *steps, values, [np.zeros((1, 1), np.int32)])
    return values


def test_crafted_steps_are_read() -> None:
    """The refusals below are for what was crafted."""
    assert read_one([(1, 0, -7), (2, 0, 1)], 0, 0).tolist() == [[-20]]


@pytest.mark.parametrize("symbol", [2, -2, EDGE, -EDGE])
def test_a_refinement_that_is_no_trit_is_refused(symbol: int) -> None:
    """Tables can hold any integer."""
    refuses("bad-trit", lambda: read_one([(2, 2, symbol)], 1, 0))


@pytest.mark.parametrize(("start", "trit"), [(EDGE // 3 + 1, -1), (-(EDGE // 3) - 1, 1), (EDGE, 0), (-EDGE, -1)])
def test_a_value_beyond_32_bits_is_refused(start: int, trit: int) -> None:
    """Before it could wrap; the largest that fits is read."""
    context = 4 if start > 0 else 0
    if abs(3 * start + trit) <= EDGE:
        assert read_one([(2, context, trit)], 1, start).tolist() == [[3 * start + trit]]
    else:
        refuses("value-range", lambda: read_one([(2, context, trit)], 1, start))


def test_no_source_is_not_a_channel_number() -> None:
    """The sentinel is outside every channel table."""
    assert NO_SOURCE == 255


@pytest.mark.parametrize("sign", [1, -1])
def test_a_residual_of_exactly_one_cell_is_the_farthest(sign: int) -> None:
    """A step of a quarter: 4 of them reach 1, 5 go beyond; after another step a cell is a third."""
    step = (0.25, 0.25, 0.25)
    check_reach(np.array([[sign * 4, 0, 0]]), step, np.array([1]))
    check_reach(np.array([[0, sign * 12, 0]]), step, np.array([2]))
    for values, steps in (([[0, 0, sign * 5]], [1]), ([[0, sign * 13, 0]], [2])):
        with pytest.raises(Malformed, match="value-range"):
            check_reach(np.array(values), step, np.array(steps))
