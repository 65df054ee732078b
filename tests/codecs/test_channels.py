"""Channels: refinement from any step to any later one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.arrays import I32, I64
from scarfmt.codecs.channels import check_reach, coarsen, get_channel, put_channel
from scarfmt.container.schema import Stream
from scarfmt.errors import Malformed
from scarfmt.scene.model import Channel
from tests.samples.codec_samples import Recorder, reader_of

EDGE = 2**31 - 1


@dataclass
class Case:
    """One tile's channel, refined from `before` to `after`; final values are at `at` >= `after` steps."""

    channel: Channel
    before: I64
    after: I64
    values: I32
    at: I64

    @property
    def start(self) -> I32:
        """The values that a decoder holds on entry."""
        return self._at(self.before)

    def _at(self, steps: I64) -> I32:
        coarse = coarsen(self.values, (self.at - steps)[:, None])
        return np.where(steps[:, None] > 0, coarse, 0).astype(np.int32)

    def check(self) -> None:
        final = self.values, self.at
        reader = reader_of(lambda emitter: put_channel(emitter, self.channel, self.before, self.after, final))
        values = self.start
        get_channel(reader, self.channel, self.before, self.after, values)
        reader.finish()
        assert np.array_equal(values, self._at(self.after))


def channel(components: int = 3) -> Channel:
    return Channel(Stream.COLOUR, (0.1,) * components)


@st.composite
def cases(draw: st.DrawFn) -> Case:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count, deepest = draw(st.integers(0, 25)), draw(st.sampled_from([1, 3, 6, 20]))
    at = np.sort(rng.integers(0, deepest + 1, (3, count)), axis=0)
    scale = draw(st.sampled_from([1, 30, EDGE]))
    values = rng.integers(-scale, scale + 1, (count, 3))
    values[rng.random((count, 3)) < 0.1] = EDGE
    final: I32 = np.where(at[2][:, None] > 0, values, 0).astype(np.int32)
    return Case(channel(), at[0], at[1], final, at[2])


@settings(deadline=None, max_examples=150)
@given(cases())
def test_steps_come_back_from_anywhere_to_anywhere(case: Case) -> None:
    """Anchors at different steps, in one layer; values up to the ends of 32 bits, at up to 20 steps."""
    case.check()


def test_a_layer_that_refines_nothing_emits_nothing() -> None:
    """A layer without refinements emits nothing, even if anchors already have different steps."""
    recorder, steps = Recorder(), np.array([0, 2, 5])
    put_channel(recorder, channel(), steps, steps, (np.zeros((3, 3), np.int32), steps))
    assert recorder.groups == []


@pytest.mark.parametrize("sign", [1, -1])
def test_a_residual_of_exactly_one_cell_is_the_farthest(sign: int) -> None:
    """A step of a quarter: 4 of them reach 1, 5 go beyond; after another step a cell is a third."""
    step = (0.25, 0.25, 0.25)
    check_reach(np.array([[sign * 4, 0, 0]]), step, np.array([1]))
    check_reach(np.array([[0, sign * 12, 0]]), step, np.array([2]))
    for values, steps in (([[0, 0, sign * 5]], [1]), ([[0, sign * 13, 0]], [2])):
        with pytest.raises(Malformed, match="value-range"):
            check_reach(np.array(values), step, np.array(steps))
