"""Adam over rows that come and go, and means of what is learnt."""

from __future__ import annotations

from itertools import pairwise

import pytest
import torch

from reference_encoder.training.optimizer import AnchorOptimizer, WeightAverage, rate_at
from reference_encoder.training.presets import PRESETS, moment
from tests.reference_encoder.training.test_presets import EVERY


def _pulled(descent: AnchorOptimizer, steps: int) -> None:
    for _ in range(steps):
        (descent.parameters["x"] ** 2).sum().backward()
        descent.step(0.5)


def test_rows_keep_their_moments() -> None:
    """Taking away other rows and adding new ones changes nothing for a row that stays."""
    start = torch.linspace(1, 2, 6)[:, None]
    alone, moved = (AnchorOptimizer({"x": start.clone()}, {"x": (0.1, 0.01)}) for _ in range(2))
    _pulled(alone, 5)
    _pulled(moved, 5)
    rows = torch.tensor([4, 1])
    moved.rearrange("x", rows, torch.full((1, 1), 9.0))
    _pulled(alone, 5)
    _pulled(moved, 5)
    assert torch.equal(moved.parameters["x"][:2], alone.parameters["x"][rows])


def test_rates_fall_log_linearly() -> None:
    """Half way the rate is the geometric mean."""
    assert rate_at((1e-2, 1e-4), 0.5) == pytest.approx(1e-3)
    assert rate_at((1e-2, 1e-4), 2.0) == pytest.approx(1e-4)


def test_a_share_of_nothing_stands_still() -> None:
    """A part that is settled stays as it is."""
    descent = AnchorOptimizer({"x": torch.ones(2), "y": torch.ones(2)}, {"x": (0.1, 0.1), "y": (0.1, 0.1)})
    (descent.parameters["x"].sum() + descent.parameters["y"].sum()).backward()
    descent.step(0.0, lambda name: float(name == "x"))
    assert descent.parameters["y"].tolist() == [1.0, 1.0]
    assert descent.parameters["x"].tolist() != [1.0, 1.0]


def test_where_nothing_was_taken_nothing_changes() -> None:
    """Also the second time that means settle."""
    weight = torch.ones(2, requires_grad=True)
    averages = WeightAverage()
    averages.apply({"weight": weight})
    averages.update({"weight": weight})
    averages.apply({"weight": weight})
    weight.data.fill_(5.0)
    averages.apply({"weight": weight})
    assert weight.tolist() == [5.0, 5.0]


@pytest.mark.parametrize("name", ["default", "paper"])
def test_no_anchor_comes_or_goes_while_means_are_taken(name: str) -> None:
    """Masks and growth change shapes; values must be settled before only networks learn."""
    found = [moment(PRESETS[name].curriculum, done) for done in EVERY]
    assert not any(one.averages and (one.decides or one.grows) for one in found)
    assert not any(
        before.averages and one.averages and before.fine_tunes != one.fine_tunes for before, one in pairwise(found)
    )
