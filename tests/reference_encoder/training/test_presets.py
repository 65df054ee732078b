"""The curriculum: what is on when."""

from __future__ import annotations

import numpy as np
import pytest

from reference_encoder.training.presets import PRESETS, Curriculum, moment

PAPER = PRESETS["paper"].curriculum
EVERY = np.linspace(0, 1, 401).tolist()


def test_the_papers_phases_are_those_of_its_iterations() -> None:
    """10k continuous with noise, 20k of linear injection, 10k hard with the rate, of 40k (paper §3.6)."""
    warm, begins, half, hard = (moment(PAPER, step / 40_000) for step in (9_999, 10_000, 20_000, 30_000))
    assert (warm.noisy, warm.quantises, warm.beta, warm.rate) == (True, False, 0.0, 0.0)
    assert (begins.noisy, begins.quantises, begins.beta) == (False, True, 0.0)
    assert (half.beta, half.hard, half.entropy, half.rate) == (0.5, False, False, 0.0)
    assert (hard.beta, hard.hard, hard.entropy, hard.rate) == (1.0, True, True, 1.0)


def test_the_papers_formula_starves_the_feature() -> None:
    """The gradient is 1 - beta in the paper's formula. By default the feature keeps all of it until the quantiser
    passes it on."""
    assert moment(PAPER, 0.5).feature_gradient == pytest.approx(0.5)
    assert moment(Curriculum(), 0.5).feature_gradient == 1.0
    assert moment(Curriculum(), 0.8).feature_gradient == 0.0


@pytest.mark.parametrize("name", ["default", "paper"])
def test_beta_and_rate_never_fall(name: str) -> None:
    """Each from 0 or more to 1, and a picture is never drawn with codes before there are books."""
    found = [moment(PRESETS[name].curriculum, done) for done in EVERY]
    for values in ([one.beta for one in found], [one.rate for one in found]):
        assert values == sorted(values)
        assert values[-1] == 1.0
    assert all(one.quantises for one in found if one.beta > 0)
    assert all(one.quantises for one in found if one.hard or one.entropy)
    assert not any(one.noisy and one.rounded for one in found)


def test_growth_is_over_before_pictures_are_hard() -> None:
    """Growth pauses while noise begins, and never continues without statistics."""
    found = [moment(Curriculum(), done) for done in EVERY]
    assert not any(one.grows and not one.gathers for one in found)
    assert not any(one.grows and one.hard for one in found)
    grows = [moment(Curriculum(), done).grows for done in (0.0, 0.05, 0.0875, 0.2, 0.375)]
    assert grows == [False, True, False, True, False]


@pytest.mark.parametrize("name", ["default", "paper"])
def test_masks_are_decided_while_rate_counts_and_values_can_still_answer(name: str) -> None:
    """Under every curriculum for a twelfth of the run at least, and never once only networks learn."""
    found = [moment(PRESETS[name].curriculum, done) for done in EVERY]
    assert sum(one.decides for one in found) >= len(found) / 12
    assert all(one.rate > 0 for one in found if one.decides)
    assert not any(one.decides and one.fine_tunes for one in found)


def test_integers_alone_come_last() -> None:
    assert [moment(Curriculum(), done).fine_tunes for done in (0.94, 0.95, 1.0)] == [False, True, True]
    assert not moment(PAPER, 0.99).fine_tunes
