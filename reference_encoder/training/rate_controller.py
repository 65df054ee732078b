"""The price of a bit in each layer: fixed, or steered so that prefixes of the file get their sizes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import accumulate

from torch import Tensor

from reference_encoder.training.slot_importance import SlotImportance

_MEMORY = 0.95
_STEP = 1.5
"""Times that a price changes at most in one of them: values take a while to follow."""
LEAST_PRICE = 0.002
"""Where sizes are wanted, the least price, times lambda: bits that do not lower the loss by as much are not sent,
however large the file may be."""
_STEER = 1.1
"""Factor of a price correction once masks are settled, when prices are corrected more often."""


@dataclass
class RateController:
    """Prices of bits, one a layer; a unit is the whole loss for a bit a pixel of all photos.

    Attributes:
        price: by layer.
        pixels: of all training photos.
        wanted: bytes of each prefix, None where the price is fixed.
        floor: least price that these lead to.
        estimate: bytes that each prefix is thought to take, 0 before it was drawn.
        real: bytes that the writer took for a byte of the estimate.
    """

    price: list[float]
    pixels: int
    wanted: list[float] | None
    floor: float = 0.0
    estimate: list[float] = field(default_factory=list)
    real: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.estimate = self.estimate or [0.0] * len(self.price)
        self.real = self.real or [1.0] * len(self.price)

    def a_bit(self, layer: int) -> float:
        """Loss that a bit of a layer costs now."""
        return self.price[layer] / self.pixels

    def record_estimate(self, layer: int, bits: float) -> None:
        """Take in an estimate of a layer's bits."""
        before = self.estimate[layer] or bits / 8
        self.estimate[layer] = _MEMORY * before + (1 - _MEMORY) * bits / 8

    def record_sizes(self, sizes: list[int]) -> None:
        """Take in what the writer made of each prefix, bytes."""
        for layer, size in enumerate(sizes):
            if self.estimate[layer]:
                self.real[layer] = size / self.estimate[layer]

    def adjust(self) -> None:
        """Move prices by what prefixes take above or below the sizes wanted, if any are."""
        if self.wanted is not None:
            for layer, wanted in enumerate(self.wanted):
                off = self.estimate[layer] * self.real[layer] / wanted
                if off > 0:
                    self._move(layer, min(max(off, 1 / _STEER), _STEER))

    def mask_prices(self, importance: SlotImportance, allowed: Tensor, weight: float, keeps: float) -> list[float]:
        """Loss a bit by layer at which masks are decided now; prices follow where sizes are wanted.

        Args:
            allowed: (N, K) slots that may be shown.
            weight: how much rate counts already, 0..1.
            keeps: least share of its bits that the last layer keeps: a slot closed there never opens again.
        """
        if self.wanted is not None:
            for layer, wanted in enumerate(self.wanted):
                price = importance.price_of(layer, 8 * wanted / self.real[layer], allowed) * self.pixels
                moved = math.sqrt(self.price[layer] * price) / self.price[layer]
                self._move(layer, min(max(moved, 1 / _STEP), _STEP))
        last = len(self.price) - 1
        most = importance.price_of(last, keeps * importance.bits(last, allowed), allowed)
        if self.wanted is not None:
            # The price may still be on its way down from what was too much.
            enough = importance.price_of(last, 8 * self.wanted[last] / self.real[last], allowed)
            most = min(most, max(enough, weight * self.floor / self.pixels))
        chosen = [weight * self.a_bit(layer) for layer in range(last)] + [min(weight * self.a_bit(last), most)]
        # What an earlier layer shows, later ones show.
        return list(accumulate(reversed(chosen), max))[::-1]

    def _move(self, layer: int, factor: float) -> None:
        """Change a price, but not to less than the floor."""
        self.price[layer] = max(self.price[layer] * factor, self.floor)
