"""What a symbol costs beside its bits: fewer are planned where time counts, and none otherwise."""

from __future__ import annotations

import numpy as np

from reference_encoder.decide.allocate import ChannelPlan
from reference_encoder.decide.plans import Price
from scarfmt.container.schema import Stream

SIZES = np.array([100, 1000])
"""Anchors of two classes."""


def plan(stream: Stream, width: float) -> ChannelPlan:
    """Two components; a first step tells almost nothing, the second is what one class needs, the third the other."""
    bits = SIZES[:, None] * np.array([0.0, 0.01, 3.0, 6.0, 9.0])
    error = SIZES[:, None] * np.array([[1000.0, 999.0, 100.0, 10.0, 9.0], [10.0, 9.9, 1.0, 0.9, 0.8]])
    return ChannelPlan(stream, (width, width), bits, error)


def test_an_archive_is_planned_by_bits_alone() -> None:
    """The very same plan, whatever decoding takes."""
    given = plan(Stream.LATENT, 81.0)
    assert Price(1.0, 0.0, SIZES).timed(given) is given


def test_a_latent_begins_where_values_leave_the_middle() -> None:
    """The step that says nothing goes into the one after it; every symbol left is priced."""
    given = plan(Stream.LATENT, 81.0)
    timed = Price(1.0, 0.5, SIZES).timed(given)
    assert timed.step == (27.0, 27.0)
    assert np.array_equal(timed.error, given.error[:, [0, 2, 3, 4]])
    assert np.allclose(timed.bits, given.bits[:, [0, 2, 3, 4]] + 0.5 * 2 * SIZES[:, None] * np.arange(4))


def test_other_channels_keep_the_steps_that_previews_need() -> None:
    """Of a colour three steps are of every Gaussian, and are one symbol; a scale's first step stays by itself."""
    price = Price(1.0, 0.5, SIZES)
    assert price.timed(plan(Stream.COLOUR, 2.0)).step == (2.0 / 9, 2.0 / 9)
    assert price.timed(plan(Stream.SCALE, 0.6)).step == (0.6, 0.6)
