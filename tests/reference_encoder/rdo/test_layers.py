"""Layers: rows that are valid, a first picture as small as it can be, and layers that each look better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from reference_encoder.rdo.curves import RdCurve, measure_curve
from reference_encoder.rdo.layers import (
    LayerChoice,
    LayerCosts,
    Steps,
    find_first_layer,
    find_later_layers,
    predict_first_layer,
    predict_later_layers,
    show_whole,
)
from reference_encoder.tuning import FRONT_LAMBDA, LARGEST_SHARE, PICTURE_DB, WORTH_DB
from scarfmt.container.schema import Profile, Stream
from scarfmt.scene.model import Channel, LayerRow, SceneModel

CLASSES = 4
QUALITY = 41.0


def layer_costs(seed: int) -> LayerCosts:
    """Four classes of a thousand anchors each, one channel, absence as the classes suggest."""
    draw = np.random.default_rng(seed)
    classes = draw.integers(0, CLASSES, 4000)
    weight = (9.0**-classes)[:, None] * np.ones((1, 3))
    plan = measure_curve(Stream.SCALE, draw.normal(size=(4000, 3)), (0.9,) * 3, weight, classes, CLASSES)
    fixed, absence = np.full(CLASSES, 500.0), np.bincount(classes, weight.sum(axis=1) * 20, CLASSES)
    sizes = np.bincount(classes, minlength=CLASSES)
    return LayerCosts([plan], lambda _: fixed, sizes, absence, 500.0, 1e-6)


@pytest.fixture(scope="module")
def costs() -> LayerCosts:
    """One set of costs for all tests that need just one."""
    return layer_costs(3)


def checked(costs: LayerCosts, choices: Sequence[LayerChoice]) -> None:
    """Fails unless the choices make a layer table that SPEC §6.5 allows, ending with everything."""
    rows: dict[LayerRow, None] = {}
    for choice in choices:
        steps = costs.steps(choice)
        rows.setdefault(LayerRow((0,) * len(steps), tuple(steps)))
    channel = Channel(Stream.SCALE, costs.curves[0].step)
    SceneModel(Profile.EXPLICIT, 1, (channel,), tuple(rows)).check()
    assert choices[-1] == costs.final


def decibels(entries: Sequence[Steps], parts: Sequence[float]) -> float:
    """A stand-in for pictures: 6 dB for each class that is there, 2 dB for each step of each, half of it for half."""
    return sum(part * (6.0 + 2.0 * entry[0]) for entry, part in zip(entries, parts, strict=True))


def seen(costs: LayerCosts, choice: LayerChoice) -> float:
    """The stand-in's picture of a layer."""
    return decibels(costs.steps(choice), choice.parts)


@settings(max_examples=20)
@given(seed=st.integers(0, 50), layers=st.integers(2, 8))
def test_layers_by_rule_are_a_valid_table(seed: int, layers: int) -> None:
    """Falling lambdas never take anything back; there are no more layers than asked for, and bits grow."""
    costs = replace(layer_costs(seed), sizes=np.zeros(CLASSES, np.int64))
    choices = predict_later_layers(predict_first_layer(costs, 0.3), costs, layers)
    checked(costs, choices)
    assert len(choices) <= layers
    bits = [costs.bits(choice) for choice in choices]
    assert bits == sorted(bits)
    assert bits[0] <= 0.3 * bits[-1]


def test_first_picture_is_good_enough_and_no_smaller_one_is(costs: LayerCosts) -> None:
    """The first picture reaches the PSNR that it needs. Among all lambdas and fronts, none much smaller does."""
    found = find_first_layer(costs, decibels, QUALITY, 0.3)
    assert seen(costs, found) >= PICTURE_DB
    every = [LayerChoice(float(lambda_), parts, False) for parts in costs.fronts() for lambda_ in costs.lambdas]
    good = [costs.bits(choice) for choice in every if seen(costs, choice) >= PICTURE_DB]
    assert costs.bits(found) <= 1.1 * min(good)


def test_first_picture_takes_few_looks_and_none_twice(costs: LayerCosts) -> None:
    """Of a thousand layers that there are. Many lambdas lead to the same steps."""
    looked: list[tuple[tuple[Steps, ...], tuple[float, ...]]] = []

    def look(entries: Sequence[Steps], parts: Sequence[float]) -> float:
        looked.append((tuple(entries), tuple(parts)))
        return decibels(entries, parts)

    find_first_layer(costs, look, QUALITY, 0.3)
    assert len(looked) == len(set(looked)) <= 12


def test_first_picture_takes_parts_of_classes_if_they_will_do(costs: LayerCosts) -> None:
    """Classes that are more than needed are shown in part, and the parts cost their share."""

    def look(_entries: Sequence[Steps], parts: Sequence[float]) -> float:
        return 40.0 if sum(parts) > 1.5 else 20.0

    found = find_first_layer(costs, look, QUALITY, 0.3)
    assert 1.5 < sum(found.parts) <= 2.5
    assert found.shown > 2
    assert costs.bits(found) < costs.bits(replace(found, parts=(1.0,) * found.shown))


def test_fronts_grow_from_one_class_to_all(costs: LayerCosts) -> None:
    """Each shows no less of any class than the one before, and more of some; small classes are never cut."""
    fronts = replace(costs, sizes=np.array([1, 1000, 1000, 10])).fronts()
    padded = np.array([(*front, *[0.0] * (CLASSES - len(front))) for front in fronts])
    assert (np.diff(padded, axis=0) >= 0).all()
    assert (np.diff(padded, axis=0).sum(axis=1) > 0).all()
    assert set(np.unique(padded[:, [0, 3]])) <= {0.0, 1.0}
    assert padded[-1].min() > 0


@pytest.mark.parametrize(("model_bits", "latent"), [(500.0, True), (15_000.0, False)])
def test_first_picture_has_latents_where_it_affords_their_models(
    costs: LayerCosts, model_bits: float, latent: bool
) -> None:
    """Models that would take much of a first layer come later, and latents with them."""
    bits, error = np.tile([0.0, 50.0], (CLASSES, 1)), np.tile([9.0, 0.0], (CLASSES, 1))
    curves = [*costs.curves, RdCurve(Stream.LATENT, (1.0,), bits, error)]
    costs = replace(costs, curves=curves, model_bits=model_bits)
    found = find_first_layer(costs, decibels, QUALITY, 0.3)
    assert found.latent == predict_first_layer(costs, 0.3).latent == latent
    assert all(each[1] == 0 for each in costs.steps(replace(found, latent=False)))


def test_first_picture_out_of_reach_is_the_best_of_the_share(costs: LayerCosts) -> None:
    """If nothing affordable is good enough, the first picture is the best one within the share."""
    found = find_first_layer(costs, lambda _, parts: sum(parts), QUALITY, 0.3)
    assert costs.bits(found) <= 0.3 * costs.bits(costs.final) < LARGEST_SHARE * costs.bits(costs.final)
    kinds = (LayerChoice(costs.last, parts) for parts in costs.fronts())
    affordable = [costs.affordable(kind, 0.3 * costs.bits(costs.final)) for kind in kinds]
    assert sum(found.parts) == max(sum(choice.parts) for choice in affordable if choice)


def test_likely_first_layer_keeps_to_its_share_at_a_good_lambda(costs: LayerCosts) -> None:
    """Unseen, it is the one of all fronts in its share whose lambda is nearest to what is best as a rule."""
    found = predict_first_layer(costs, 0.3)
    budget = 0.3 * costs.bits(costs.final)
    assert costs.bits(found) <= budget
    others = (costs.affordable(replace(found, parts=parts), budget) for parts in costs.fronts())
    off = [abs(np.log(choice.lambda_ / (FRONT_LAMBDA * costs.last))) for choice in others if choice]
    assert abs(np.log(found.lambda_ / (FRONT_LAMBDA * costs.last))) == min(off)
    assert predict_first_layer(costs, 1e-9) == costs.least


def test_low_quality_wants_less_of_its_first_picture(costs: LayerCosts) -> None:
    """A file of 25 dB does not spend all of it on the first layer."""
    low = find_first_layer(costs, decibels, 25.0, 0.3)
    assert costs.bits(low) < costs.bits(find_first_layer(costs, decibels, QUALITY, 0.3))


@settings(max_examples=20)
@given(seed=st.integers(0, 50), layers=st.integers(2, 8))
def test_every_layer_looks_better(seed: int, layers: int) -> None:
    """Layers chosen by looks are a valid table, grow in bits, and each gains a dB, the last included."""
    costs = layer_costs(seed)
    first = show_whole(find_first_layer(costs, decibels, QUALITY, 0.3).lambda_, 1)
    checked(costs, find_later_layers(costs, decibels, show_whole(float(costs.lambdas[8]), 1), layers))
    choices = find_later_layers(costs, decibels, first, layers)
    checked(costs, choices)
    assert 2 <= len(choices) <= layers
    shown = [seen(costs, choice) for choice in choices]
    assert all(b - a >= WORTH_DB for a, b in pairwise(shown))


def test_layers_that_show_nothing_new_are_left_out(costs: LayerCosts) -> None:
    """Pictures that do not change make two layers of any number asked for."""
    first = show_whole(float(costs.lambdas[20]), 2)
    assert find_later_layers(costs, lambda _entries, _parts: 30.0, first, 6) == [first, costs.final]


def test_a_layer_that_leaves_nothing_to_the_last_is_left_out(costs: LayerCosts) -> None:
    """The last layer, which takes most bytes, gains as much as any."""
    first = show_whole(float(costs.lambdas[20]), 2)

    def look(entries: Sequence[Steps], _parts: Sequence[float]) -> float:
        return 20.0 if entries == costs.steps(first) else 35.0

    assert find_later_layers(costs, look, first, 6) == [first, costs.final]
