"""What a bit may cost the picture in each layer, so that prefixes get the sizes that were asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

_GAIN = 0.004
"""Of the logarithm of a price, a draw of its layer, for a prefix twice too large over ln 2."""
_MEMORY = 0.95
_LEAST, _MOST = 1e-4, 30.0
_FAR = 3.0


@dataclass
class Prices:
    """Prices of bits, one a layer; a unit is the whole loss for a bit a pixel of all photos.

    Attributes:
        price: by layer.
        pixels: of all training photos.
        wanted: bytes of each prefix, None where the price is fixed.
        estimate: bytes that each prefix is thought to take, 0 before it was drawn.
        real: bytes that the writer took for a byte of the estimate.
    """

    price: list[float]
    pixels: int
    wanted: list[float] | None
    estimate: list[float] = field(default_factory=list)
    real: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.estimate = self.estimate or [0.0] * len(self.price)
        self.real = self.real or [1.0] * len(self.price)

    def a_bit(self, layer: int) -> float:
        """Loss a bit of a layer costs now."""
        return self.price[layer] * self._excess(layer) / self.pixels

    def _excess(self, layer: int) -> float:
        """How many times too large a prefix is, within reason."""
        if self.wanted is None or not self.estimate[layer]:
            return 1.0
        excess = self.estimate[layer] * self.real[layer] / self.wanted[layer]
        return min(max(excess, 1 / _FAR), _FAR)

    def saw(self, layer: int, bits: float) -> None:
        """Take in an estimate of a layer's bits."""
        before = self.estimate[layer] or bits / 8
        self.estimate[layer] = _MEMORY * before + (1 - _MEMORY) * bits / 8
        if self.wanted is not None:
            moved = math.log(self.price[layer]) + _GAIN * math.log(self._excess(layer))
            self.price[layer] = min(max(math.exp(moved), _LEAST), _MOST)

    def wrote(self, sizes: list[int]) -> None:
        """Take in what the writer made of each prefix, bytes."""
        for layer, size in enumerate(sizes):
            if self.estimate[layer]:
                self.real[layer] = size / self.estimate[layer]
