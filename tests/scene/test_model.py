"""The rules of channels and layer rows (SPEC §6.4, §6.5), each broken once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from fuzz.testing.strategies import quantised_scenes
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Profile, Stream
from scarfmt.scene.model import (
    MAX_CLASSES,
    MAX_COMPONENTS,
    MAX_STAGES,
    MAX_STEPS,
    Channel,
    LayerRow,
    SceneModel,
    check_channels,
    check_row,
)
from tests.samples.codec_samples import refuses


def channel(stream: Stream = Stream.SCALE, components: int = 3, step: float = 0.5) -> Channel:
    return Channel(stream, (step,) * components)


SCALE = channel()
ANCHOR_SCALE = channel(Stream.SCALE, 6)
OFFSETS = channel(Stream.OFFSETS)


@settings(deadline=None, max_examples=30)
@given(quantised_scenes(max_anchors=0))
def test_models_that_keep_the_rules_pass(scene: QuantisedScene) -> None:
    """Random channel tables and rows."""
    scene.model.check()


@pytest.mark.parametrize(
    ("channels", "profile"),
    [
        ((SCALE, SCALE), Profile.EXPLICIT),
        ((channel(Stream.COLOUR), SCALE), Profile.EXPLICIT),
        ((channel(Stream.INDICES),), Profile.EXPLICIT),
        ((channel(step=0.0),), Profile.EXPLICIT),
        ((channel(step=-1.0),), Profile.EXPLICIT),
        ((channel(step=float("inf")),), Profile.EXPLICIT),
        ((channel(step=float("nan")),), Profile.EXPLICIT),
        ((Channel(Stream.SCALE, ()),), Profile.EXPLICIT),
        ((Channel(Stream.SCALE, (0.5, 0.5)),), Profile.EXPLICIT),
        ((channel(Stream.SCALE, MAX_COMPONENTS + 1),), Profile.EXPLICIT),
        ((SCALE, OFFSETS), Profile.EXPLICIT),
        ((ANCHOR_SCALE,), Profile.ANCHOR),
        ((channel(step=2.0**97),), Profile.EXPLICIT),
        ((), Profile.EXPLICIT),
        ((channel(Stream.COLOUR),), Profile.EXPLICIT),
        ((channel(Stream.SCALE, 1),), Profile.EXPLICIT),
        ((ANCHOR_SCALE,), Profile.EXPLICIT),
        ((SCALE, channel(Stream.OPACITY)), Profile.EXPLICIT),
        ((SCALE, OFFSETS), Profile.ANCHOR),
        ((OFFSETS,), Profile.ANCHOR),
        ((ANCHOR_SCALE, channel(Stream.OFFSETS, 64)), Profile.ANCHOR),
        ((ANCHOR_SCALE, channel(Stream.OPACITY, 1), OFFSETS), Profile.ANCHOR),
    ],
)
def test_channel_tables_that_break_the_rule_are_refused(channels: tuple[Channel, ...], profile: Profile) -> None:
    """Streams, steps, sizes, and offsets in the right profile."""
    refuses("bad-channel", lambda: check_channels(channels, profile))


def test_channel_tables_that_keep_the_rule_pass() -> None:
    check_channels((SCALE, channel(Stream.COLOUR)), Profile.EXPLICIT)
    check_channels((ANCHOR_SCALE, OFFSETS), Profile.ANCHOR)


BEFORE = LayerRow((1, 2), ((1, 3), (0, 0)))


@pytest.mark.parametrize(
    ("row", "before"),
    [
        (LayerRow((), ()), None),
        (LayerRow((0,) * (MAX_CLASSES + 1), ((0, 0),) * (MAX_CLASSES + 1)), None),
        (LayerRow((0,), ()), None),
        (LayerRow((MAX_STAGES + 1,), ((0, 0),)), None),
        (LayerRow((-1,), ((0, 0),)), None),
        (LayerRow((0,), ((0, MAX_STEPS + 1),)), None),
        (LayerRow((0,), ((0,),)), None),
        (LayerRow((0,), ((0, 0, 0),)), None),
        (LayerRow((1,), ((1, 3),)), BEFORE),
        (LayerRow((0, 2), ((1, 3), (0, 0))), BEFORE),
        (LayerRow((1, 2), ((1, 2), (0, 0))), BEFORE),
        (LayerRow((1, 2, 0), ((0, 3), (5, 5), (0, 0))), BEFORE),
    ],
    ids=range(12),
)
def test_rows_out_of_range_or_taking_back_are_refused(row: LayerRow, before: LayerRow | None) -> None:
    """Counts, ranges, and everything only ever growing."""
    refuses("bad-layer-table", lambda: check_row(row, before, 2))


def test_rows_may_stand_still_or_grow() -> None:
    """A layer that changes nothing is legal, and so are the maxima."""
    check_row(BEFORE, BEFORE, 2)
    check_row(LayerRow((1, 2, MAX_STAGES), ((1, 3), (0, 1), (MAX_STEPS, 0))), BEFORE, 2)


def test_lookups_follow_the_table_and_are_0_before_a_class_appears() -> None:
    """Per anchor, by class; layer 0 is before the file."""
    later = LayerRow((1, 4, 3), ((1, 3), (2, 1), (5, 6)))
    model = SceneModel(Profile.EXPLICIT, 1, (SCALE, channel(Stream.COLOUR)), (BEFORE, later))
    model.check()
    classes = np.array([2, 0, 1, 1])
    assert model.stages(0, classes).tolist() == [0, 0, 0, 0]
    assert model.stages(1, classes).tolist() == [0, 1, 2, 2]
    assert model.stages(2, classes).tolist() == [3, 1, 4, 4]
    assert model.steps(0, 1, classes).tolist() == [0, 0, 0, 0]
    assert model.steps(1, 1, classes).tolist() == [0, 3, 0, 0]
    assert model.steps(2, 1, classes).tolist() == [6, 3, 1, 1]
    assert [model.first_new_class(layer) for layer in (1, 2)] == [0, 2]
    assert model.max_stages == 4
    broken = replace(model, layers=(later, BEFORE))
    refuses("bad-layer-table", broken.check)


def anchor_model(rows: tuple[LayerRow, ...]) -> SceneModel:
    """SCALE, LATENT and OFFSETS, in this order."""
    return SceneModel(Profile.ANCHOR, 2, (ANCHOR_SCALE, channel(Stream.LATENT), OFFSETS), rows)


@pytest.mark.parametrize(
    "rows",
    [
        (LayerRow((1,), ((1, 0, 0),)),),
        (LayerRow((1,), ((1, 0, 2),)),),
        (LayerRow((1,), ((1, 0, 1),)), LayerRow((1, 0), ((1, 0, 1), (1, 0, 0)))),
        (LayerRow((0,), ((1, 0, 1),)),),
        (LayerRow((0,), ((1, 0, 1),)), LayerRow((1,), ((1, 1, 1),))),
    ],
    ids=range(5),
)
def test_the_anchor_profile_has_offsets_in_one_step_and_a_feature_from_the_start(rows: tuple[LayerRow, ...]) -> None:
    """Without a stage or a latent step there is no decoder, and without a decoder nothing to draw."""
    refuses("bad-layer-table", anchor_model(rows).check)


def test_one_class_with_a_feature_is_enough() -> None:
    """By a stage or by a latent step."""
    for first in (LayerRow((0, 1), ((1, 0, 1), (0, 0, 1))), LayerRow((0, 0), ((1, 0, 1), (0, 1, 1)))):
        anchor_model((first,)).check()
