"""Prices of bits: fixed, or such that prefixes get their sizes."""

import pytest
import torch

from reference_encoder.training.rate_controller import RateController
from reference_encoder.training.slot_importance import SlotImportance, first_layers


def found(count: int = 500) -> SlotImportance:
    """Slots of very different worth."""
    generator = torch.Generator().manual_seed(0)
    benefit = torch.exp(4 * torch.randn(count, 10, generator=generator))
    anchor_bits = torch.full((count,), 60.0), torch.full((count,), 80.0)
    return SlotImportance(benefit, torch.full((count, 10), 15.0), anchor_bits)


def test_a_fixed_price_stays() -> None:
    """Without sizes wanted, what is seen changes nothing, and rate comes in by its weight."""
    rate_controller, worth = RateController([0.2, 0.1], 1000, None), found()
    rate_controller.record_estimate(0, 1e6)
    assert rate_controller.mask_prices(worth, worth.benefit > 0, 0.5, 0.85) == pytest.approx([1e-4, 5e-5])
    assert rate_controller.a_bit(0) == pytest.approx(0.2 / 1000)


def test_prefixes_get_their_sizes() -> None:
    """Decision after decision prices go to where each layer takes the bytes wanted, as the writer counts them."""
    worth = found()
    allowed = worth.benefit > 0
    whole = worth.bits(1, allowed) / 8
    rate_controller = RateController([1.0, 1.0], 1, [0.2 * whole, 0.6 * whole])
    rate_controller.estimate = [100.0, 100.0]
    rate_controller.record_sizes([200, 100])
    for _ in range(40):
        first = first_layers(worth, rate_controller.mask_prices(worth, allowed, 1.0, 0.85), allowed)
    assert worth.bits(0, first == 0) / 8 == pytest.approx(0.1 * whole, rel=0.03)
    for _ in range(20):
        allowed = first < 2
        first = first_layers(worth, rate_controller.mask_prices(worth, allowed, 1.0, 0.85), allowed)
    assert worth.bits(1, first <= 1) / 8 == pytest.approx(0.6 * whole, rel=0.03)


@pytest.mark.parametrize(("wanted", "left"), [(0.1, 0.85), (0.95, 0.95)])
def test_the_last_layer_shrinks_slowly_and_never_below_its_size(wanted: float, left: float) -> None:
    """A closed slot never opens again: no decision closes more than a part, or goes below the requested size."""
    worth = found()
    allowed = worth.benefit > 0
    whole = worth.bits(1, allowed) / 8
    rate_controller = RateController([1e3, 1e3], 1, [0.01 * whole, wanted * whole])
    first = first_layers(worth, rate_controller.mask_prices(worth, allowed, 1.0, 0.85), allowed)
    assert worth.bits(1, first <= 1) / 8 == pytest.approx(left * whole, rel=0.01)
    assert 1e3 / 1.5 <= rate_controller.price[0] <= 1.5e3


def test_an_earlier_layer_is_never_cheaper() -> None:
    """Prices of a prefix are at least those of what follows: its slots are among theirs."""
    worth = found()
    chosen = RateController([0.1, 0.4], 10, None).mask_prices(worth, worth.benefit > 0, 1.0, 0.85)
    assert chosen[0] >= chosen[1]


def test_once_masks_are_settled_prices_answer_to_sizes() -> None:
    """A prefix above its size gets dearer, one below cheaper, each by a little; without sizes nothing moves."""
    rate_controller = RateController([1.0, 1.0, 1.0], 1, [100.0, 200.0, 300.0])
    rate_controller.estimate = [105.0, 100.0, 0.0]
    rate_controller.record_sizes([105, 180, 300])
    rate_controller.adjust()
    assert rate_controller.price == pytest.approx([1.05, 1 / 1.1, 1.0])
    fixed = RateController([1.0], 1, None, estimate=[100.0])
    fixed.adjust()
    assert fixed.price == [1.0]


def test_bytes_that_buy_nothing_are_not_sent() -> None:
    """A size beyond what pays: the price falls to the floor and no lower, in pictures' masks and in the rate."""
    worth = found()
    allowed = worth.benefit > 0
    whole = worth.bits(1, allowed) / 8
    floor = worth.price_of(1, 8 * 0.7 * whole, allowed)
    rate_controller = RateController([100 * floor, 50 * floor], 1, [0.2 * whole, 10 * whole], floor)
    for _ in range(40):
        first = first_layers(worth, rate_controller.mask_prices(worth, allowed, 1.0, 0.85), allowed)
        allowed = first < 2
    assert rate_controller.price[1] == floor < rate_controller.price[0]
    assert worth.bits(1, first <= 1) / 8 == pytest.approx(0.7 * whole, rel=0.03)
    rate_controller.estimate = [1.0, 1.0]
    rate_controller.adjust()
    assert rate_controller.price[1] == floor
