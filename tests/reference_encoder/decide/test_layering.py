"""Layers: rows that are valid, a first picture as small as it can be, and layers that each look better."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from reference_encoder.decide.allocate import LatentChain, plan_channel
from reference_encoder.decide.layering import (
    Entry,
    LayerChoice,
    LayerCosts,
    best_looking,
    first_picture,
    predicted,
)
from reference_encoder.tuning import LARGEST_SHARE, PICTURE_DB
from scarfmt.container.schema import Profile, Stream
from scarfmt.scene.model import Channel, ContextRule, LayerRow, SceneModel

CLASSES = 4
QUALITY = 41.0


def layer_costs(seed: int) -> LayerCosts:
    """Four classes of a thousand anchors each, one channel, absence as the classes suggest."""
    draw = np.random.default_rng(seed)
    classes = draw.integers(0, CLASSES, 4000)
    weight = (9.0**-classes)[:, None] * np.ones((1, 3))
    plan = plan_channel(Stream.SCALE, draw.normal(size=(4000, 3)), (0.9,) * 3, weight, classes, CLASSES)
    nothing = LatentChain(0, np.zeros((CLASSES, 1)), np.zeros((CLASSES, 1)))
    fixed, absence = np.full(CLASSES, 500.0), np.bincount(classes, weight.sum(axis=1) * 20, CLASSES)
    return LayerCosts([plan], nothing, lambda _: fixed, absence, 0.0, 500.0, 1e-6)


@pytest.fixture(scope="module")
def costs() -> LayerCosts:
    """One set of costs for all tests that need just one."""
    return layer_costs(3)


def checked(costs: LayerCosts, choices: Sequence[LayerChoice]) -> None:
    """Fails unless the choices make a layer table that SPEC §6.5 allows, ending with everything."""
    rows: dict[LayerRow, None] = {}
    for choice in choices:
        entries = costs.entries(choice)
        rows.setdefault(LayerRow(tuple(e[0] for e in entries), tuple(e[1:2] for e in entries)))
    channel = Channel(Stream.SCALE, costs.plans[0].step, (ContextRule(),) * 3)
    SceneModel(Profile.EXPLICIT, 1, (channel,), tuple(rows)).check()
    assert choices[-1] == costs.final


def decibels(entries: Sequence[Entry], part: float = 1.0) -> float:
    """A stand-in for pictures: 6 dB for each class that is there, 2 dB for each step of each, half of it for half."""
    worth = [6.0 + 2.0 * entry[1] for entry in entries]
    return sum(worth[:-1]) + part * worth[-1]


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 50), layers=st.integers(1, 8))
def test_predicted_layers_are_a_valid_table(seed: int, layers: int) -> None:
    """Falling lambdas never take anything back; there are no more layers than asked for, and errors fall."""
    costs = layer_costs(seed)
    choices = predicted(costs, 0.3, layers)
    checked(costs, choices)
    assert len(choices) <= layers
    errors = [costs.error(choice) for choice in choices]
    assert errors == sorted(errors, reverse=True)


def test_predicted_first_layer_keeps_to_its_share(costs: LayerCosts) -> None:
    """The first layer takes no more of the bits than it may, later ones grow by like factors."""
    choices = predicted(costs, 0.3, 4)
    bits = [costs.bits(choice) for choice in choices]
    assert bits[0] <= 0.3 * bits[-1]
    assert bits == sorted(bits)
    assert 3 <= len(choices) <= 4


def test_first_picture_is_good_enough_and_no_smaller_one_is(costs: LayerCosts) -> None:
    """It reaches what a picture needs; among all lambdas and classes, none much smaller does."""
    found = first_picture(costs, decibels, QUALITY, 0.3)
    assert decibels(costs.entries(found), found.part) >= PICTURE_DB
    every = [LayerChoice(float(lambda_), shown) for shown in range(1, CLASSES + 1) for lambda_ in costs.lambdas]
    good = [costs.bits(choice) for choice in every if decibels(costs.entries(choice)) >= PICTURE_DB]
    assert costs.bits(found) <= 1.1 * min(good)


def test_first_picture_takes_a_part_of_a_class_if_that_will_do(costs: LayerCosts) -> None:
    """A class that is more than needed is shown in part, and the part costs its share."""

    def look(entries: Sequence[Entry], part: float) -> float:
        return 20.0 if len(entries) < 3 or part < 0.5 else 40.0

    found = first_picture(costs, look, QUALITY, 0.3)
    assert (found.shown, found.part) == (3, 0.5)
    assert costs.bits(found) < costs.bits(LayerChoice(found.lambda_, 3))


def test_first_picture_out_of_reach_is_the_best_of_the_share(costs: LayerCosts) -> None:
    """Where nothing affordable is good enough, it is the best looking one within the share."""
    found = first_picture(costs, lambda entries, _: float(len(entries)), QUALITY, 0.3)
    assert costs.bits(found) <= 0.3 * costs.bits(costs.final) < LARGEST_SHARE * costs.bits(costs.final)
    affordable = [costs.affordable(shown, 0.3 * costs.bits(costs.final)) for shown in range(1, CLASSES + 1)]
    assert found.shown == max(choice.shown for choice in affordable if choice)


def test_low_quality_wants_less_of_its_first_picture(costs: LayerCosts) -> None:
    """A file of 25 dB does not spend all of it on the first layer."""
    low = first_picture(costs, decibels, 25.0, 0.3)
    assert costs.bits(low) < costs.bits(first_picture(costs, decibels, QUALITY, 0.3))


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 50), layers=st.integers(2, 8))
def test_every_layer_looks_better(seed: int, layers: int) -> None:
    """Layers chosen by looks are a valid table, grow in bits, and none is there that shows no more."""
    costs = layer_costs(seed)
    choices = best_looking(costs, decibels, first_picture(costs, decibels, QUALITY, 0.3), layers)
    choices = [LayerChoice(choice.lambda_, choice.shown) for choice in choices]
    checked(costs, choices)
    assert 2 <= len(choices) <= layers
    shown = [decibels(costs.entries(choice)) for choice in choices[:-1]]
    assert all(b - a >= 0.5 for a, b in pairwise(shown))


def test_layers_that_show_nothing_new_are_left_out(costs: LayerCosts) -> None:
    """Pictures that do not change make two layers of any number asked for."""
    first = first_picture(costs, decibels, QUALITY, 0.3)
    assert best_looking(costs, lambda _entries, _part: 30.0, first, 6) == [first, costs.final]
