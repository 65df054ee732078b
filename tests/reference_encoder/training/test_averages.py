"""Means of what is learnt."""

from __future__ import annotations

from itertools import pairwise

import pytest
import torch

from reference_encoder.training.averages import Averages
from reference_encoder.training.curriculum import CURRICULA, Curriculum, moment
from reference_encoder.training.trainer import averaged
from tests.reference_encoder.training.small import state
from tests.reference_encoder.training.test_curriculum import EVERY

CPU = torch.device("cpu")


def test_a_parameter_settles_on_the_mean_of_what_it_was() -> None:
    """The leaf stays the same tensor: Adam and the anchors hold it."""
    weight = torch.zeros(3, requires_grad=True)
    averages = Averages()
    for value in (1.0, 2.0, 6.0):
        weight.data.fill_(value)
        averages.take({"weight": weight})
    averages.settle({"weight": weight})
    assert weight.tolist() == pytest.approx([3.0] * 3)
    assert averages.count == 0


def test_where_nothing_was_taken_nothing_changes() -> None:
    """Also the second time that means settle."""
    weight = torch.ones(2, requires_grad=True)
    averages = Averages()
    averages.settle({"weight": weight})
    averages.take({"weight": weight})
    averages.settle({"weight": weight})
    weight.data.fill_(5.0)
    averages.settle({"weight": weight})
    assert weight.tolist() == [5.0, 5.0]


def test_a_checkpoint_goes_on_to_the_same_mean() -> None:
    whole, first = Averages(), Averages()
    values = [torch.randn(4, generator=torch.Generator().manual_seed(each)) for each in range(6)]
    for value in values:
        whole.take({"a": value})
    for value in values[:3]:
        first.take({"a": value})
    second = Averages()
    second.restore(first.state(), CPU)
    for value in values[3:]:
        second.take({"a": value})
    one, other = torch.zeros(4), torch.zeros(4)
    whole.settle({"a": one})
    second.settle({"a": other})
    assert torch.equal(one, other)


def test_means_leave_what_a_checkpoint_holds() -> None:
    """A checkpoint is not changed by the iterations after it."""
    averages = Averages()
    averages.take({"a": torch.ones(2)})
    kept = averages.state()
    averages.take({"a": torch.zeros(2)})
    assert kept["means"]["a"].tolist() == [1.0, 1.0]


@pytest.mark.parametrize("name", CURRICULA)
def test_no_anchor_comes_or_goes_while_means_are_taken(name: str) -> None:
    """Masks and growth change shapes; values must be settled before only networks learn."""
    found = [moment(CURRICULA[name], done) for done in EVERY]
    assert not any(one.averages and (one.decides or one.grows) for one in found)
    assert not any(before.averages and one.averages and before.fine_tunes != one.fine_tunes
                   for before, one in pairwise(found))


def test_a_run_averages_values_first_and_networks_last() -> None:
    """By default; the paper knows nothing of it."""
    found = [moment(Curriculum(), done).averages for done in (0.86, 0.9, 0.96, 0.98)]
    assert found == [False, True, False, True]
    assert not any(moment(CURRICULA["paper"], done).averages for done in EVERY)


def test_all_that_a_picture_is_made_of_is_averaged() -> None:
    """Values of anchors and networks of the scene; not widths of cells, by which values were rounded."""
    names = set(state().descent.parameters)
    chosen = averaged(state().descent.parameters)
    assert {"latent", "scaling", "offsets", "networks.decoder.weight"} <= set(chosen)
    assert names - set(chosen) >= {"log_widths", "log_offset_widths"}
    assert not any(name.startswith("context.") for name in chosen)
