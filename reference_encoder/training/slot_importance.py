"""The slots that each layer shows: those whose absence would cost more than their bits (paper §3.7).

A picture is linear in the opacity of a slot, so that leaving it out alone changes pixels by v = opacity * d(picture) /
d(opacity), exactly. The energy |v|^2 comes from one backward pass with random signs in place of a gradient: the square
of what arrives at a slot is an unbiased estimate of it (Hutchinson). Decision 0036 has why gates are not descended.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from reference_encoder.training.anchors import SLOTS
from reference_encoder.training.exposure import expose
from reference_encoder.training.fixed_order import mean, total
from reference_encoder.training.neural_gaussians import expand
from reference_encoder.training.photo_store import View
from reference_encoder.training.raster import rasterise
from reference_encoder.training.rate import CLOSED_BITS, MASK_BITS, POSITION_BITS
from reference_encoder.training.similarity import dissimilarity, intensities
from reference_encoder.training.state import WEIGHT_BITS, State

_BISECTIONS = 60
_LEAST, _MOST = 1e-12, 1e6
"""Prices between which one is looked for."""
_REMEMBERED = 0.7
"""Share of earlier statistics that each look keeps. In a large capture one look misses most photos of a rare slot."""


@dataclass(frozen=True)
class SlotImportance:
    """The worth and the cost of slots.

    Attributes:
        benefit: (N, K) loss that leaving a slot out alone would add, a mean over photos.
        slot_bits: (N, K) of offset and mask.
        anchor_bits: by layer, (N,) of position, scaling and features.
    """

    benefit: Tensor
    slot_bits: Tensor
    anchor_bits: tuple[Tensor, ...]

    def choose_slots(self, layer: int, price: float) -> Tensor:
        """(N, K) bool, slots that pay in a layer at a price, loss a bit: each its own bits, together the anchor's."""
        gain = self.benefit - price * self.slot_bits
        pays = gain > 0
        whole = (gain * pays).sum(dim=1) > price * self.anchor_bits[layer]
        return pays & whole[:, None]

    def bits(self, layer: int, shown: Tensor) -> float:
        """Bits of a layer that shows these (N, K) slots."""
        slots = total((self.slot_bits * shown).double())
        return float(slots + total((self.anchor_bits[layer] * shown.any(dim=1)).double()))

    def price_of(self, layer: int, bits: float, allowed: Tensor) -> float:
        """The price at which a layer takes so many bits, if only (N, K) `allowed` slots are shown."""
        low, high = math.log(_LEAST), math.log(_MOST)
        scale = float(mean(self.benefit)) / float(mean(self.slot_bits)) + 1e-30
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            taken = self.bits(layer, self.choose_slots(layer, math.exp(middle) * scale) & allowed)
            low, high = (middle, high) if taken > bits else (low, middle)
        return math.exp((low + high) / 2) * scale


def measure_importance(state: State, views: Sequence[View], background: Tensor) -> SlotImportance:
    """How much pictures of the last layer miss each slot, from these photos and, with falling weight, earlier ones.

    Args:
        views: to look from; what is seen is added to `state.statistics`.
        background: (3,) colour behind everything.
    """
    seen = state.statistics
    seen.energy *= _REMEMBERED
    seen.looked *= _REMEMBERED
    losses, errors = 0.0, 0.0
    for view in views:
        camera, photo = view.camera, view.photo(state.device)
        rows = state.in_view(camera, state.plan.count - 1)
        with torch.no_grad():
            values = state.of_layer(rows, state.plan.count - 1, None)
            gaussians, owners, slots = expand(values, state.networks, torch.from_numpy(camera.centre), WEIGHT_BITS)
        opacities = gaussians.opacities.detach().requires_grad_()
        image = rasterise(replace(gaussians, opacities=opacities), camera, background).image
        signs = torch.randint(0, 2, image.shape, generator=state.generator).to(image.device) * 2.0 - 1.0
        image.backward(signs)  # type: ignore[no-untyped-call]
        if opacities.grad is not None:
            flat = rows[owners] * SLOTS + slots
            seen.energy.view(-1)[flat] += (opacities.grad * opacities.detach()) ** 2 / image.numel()
        exposed = expose(state.exposures, view.number, image.detach())
        losses += float(dissimilarity(exposed, photo))
        errors += float(mean((exposed - intensities(photo)) ** 2))
    # L1 and 1 - SSIM grow like the root of the squared error.
    slope = losses / (2 * max(errors, 1e-12))
    seen.looked += len(views)
    return SlotImportance(slope * seen.energy / seen.looked.clamp_min(1)[:, None], *_bits(state))


@torch.no_grad()
def _bits(state: State) -> tuple[Tensor, tuple[Tensor, ...]]:
    """(N, K) bits of slots, and by layer (N,) bits of anchors."""
    rows = torch.arange(len(state.anchors), device=state.device)
    by_layer, slots = [], torch.zeros(0, device=state.device)
    for layer in range(state.plan.count):
        priced = state.price(rows, layer, True)
        slots = MASK_BITS + state.context.offset_bits(priced.offsets, priced.offset_widths).sum(dim=2)
        index_bits = 0.0 if state.vectors is None else state.vectors.index_bits(layer)
        values = state.context.bits(priced.values, priced.widths, priced.around).sum(dim=1)
        by_layer.append(values + (POSITION_BITS + CLOSED_BITS * SLOTS + index_bits))
    return slots, tuple(by_layer)


def first_layers(importance: SlotImportance, prices: Sequence[float], allowed: Tensor) -> Tensor:
    """(N, K) int64 first layer that shows each slot, the number of layers for none.

    Args:
        prices: by layer, loss a bit, not rising: what an earlier layer shows, later ones show too.
        allowed: (N, K) bool, slots that may be shown at all.
    """
    first = torch.full(importance.benefit.shape, len(prices), device=allowed.device)
    for layer in reversed(range(len(prices))):
        first[importance.choose_slots(layer, prices[layer]) & allowed] = layer
    return first
