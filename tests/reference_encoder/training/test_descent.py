"""Adam over rows that come and go."""

import pytest
import torch

from reference_encoder.training.descent import Descent, Rates


def _pulled(descent: Descent, steps: int) -> None:
    for _ in range(steps):
        (descent.parameters["x"] ** 2).sum().backward()
        descent.step(0.5)


def test_rows_keep_their_moments() -> None:
    """Taking away other rows and adding new ones changes nothing for a row that stays."""
    start = torch.linspace(1, 2, 6)[:, None]
    alone, moved = (Descent({"x": start.clone()}, {"x": Rates(0.1, 0.01)}) for _ in range(2))
    _pulled(alone, 5)
    _pulled(moved, 5)
    rows = torch.tensor([4, 1])
    moved.rearrange("x", rows, torch.full((1, 1), 9.0))
    _pulled(alone, 5)
    _pulled(moved, 5)
    assert torch.equal(moved.parameters["x"][:2], alone.parameters["x"][rows])


def test_rates_fall_log_linearly() -> None:
    """Half way the rate is the geometric mean."""
    assert Rates(1e-2, 1e-4).at(0.5) == pytest.approx(1e-3)
    assert Rates(1e-2, 1e-4).at(2.0) == pytest.approx(1e-4)


def test_a_share_of_nothing_stands_still() -> None:
    """A part that is settled stays as it is."""
    descent = Descent({"x": torch.ones(2), "y": torch.ones(2)}, {"x": Rates(0.1, 0.1), "y": Rates(0.1, 0.1)})
    (descent.parameters["x"].sum() + descent.parameters["y"].sum()).backward()
    descent.step(0.0, lambda name: float(name == "x"))
    assert descent.parameters["y"].tolist() == [1.0, 1.0]
    assert descent.parameters["x"].tolist() != [1.0, 1.0]


def test_moments_survive_a_checkpoint() -> None:
    """A descent that was kept goes on as if nothing had happened."""
    whole = Descent({"x": torch.ones(3)}, {"x": Rates(0.1, 0.1)})
    _pulled(whole, 4)
    again = Descent({"x": whole.parameters["x"].detach().clone()}, {"x": Rates(0.1, 0.1)})
    again.load(whole.state())
    _pulled(whole, 3)
    _pulled(again, 3)
    assert torch.equal(whole.parameters["x"], again.parameters["x"])
