"""The bits that a scene will take, differentiable: the rate term of the loss (paper §3.5).

The file codes values with tables that predictors choose from what is decoded already (SPEC §10.3). Its stand-in here is
a logistic distribution a component. Its mean and width depend linearly on what comes before in an anchor, scalings,
then latents one after another, and by a small network on what neighbours have (:func:`neighbour_means`). Bits of a
prefix are those of its values at its steps: ternary steps nest, so a value at step n costs what the step n cell has in
probability, however many steps it came in.

The file has two cells about each anchor, of a few and of many anchors, and codes each anchor after some of the others
in it (SPEC §10.2). Training sees all others: gradients do not run through them, so that it only matters what they are
like.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from reference_encoder.training.anchors import SLOTS, distinct
from reference_encoder.training.fixed_order import Linear, linear, sum_over_rows, total
from reference_encoder.tuning import CONTEXT

OCCUPANCIES = CONTEXT.occupancies
"""Anchors that a cell shall hold on average, by depth."""


def neighbour_means(lattice: Tensor, values: Tensor) -> Tensor:
    """(N, depths * (c + 1)) means of (N, c) values of the others in each anchor's cells, and how full these are.

    Means are taken towards that of all anchors, as if one more of that kind lay in each cell.

    Args:
        lattice: (N, 3) int64 lattice points of the anchors.
    """
    parts = []
    overall = sum_over_rows(values) / len(values)
    for occupancy in OCCUPANCIES:
        cells = find_cells(lattice, occupancy)
        counts = torch.bincount(cells).float()
        sums = torch.zeros(len(counts), values.shape[1], device=values.device).index_add_(0, cells, values)
        others = counts[cells] - 1
        means = (sums[cells] - values + overall) / (others + 1)[:, None]
        parts += [means, torch.log1p(others)[:, None]]
    return torch.cat(parts, dim=1)


def columns(components: int) -> int:
    """Width of :func:`neighbour_means` of so many components."""
    return len(OCCUPANCIES) * (components + 1)


def find_cells(lattice: Tensor, occupancy: float) -> Tensor:
    """(N,) numbers of the cells at the first size at which they hold `occupancy` anchors on average.

    One cell where they are too few at any: cubes that double never join what lies on two sides of 0.
    """
    for shift in range(int(lattice.max() - lattice.min() + 1).bit_length() + 1):
        points, numbers, _ = distinct(lattice >> shift)
        if len(lattice) >= occupancy * len(points):
            return numbers
    return torch.zeros(len(lattice), dtype=torch.long, device=lattice.device)


POSITION_BITS = 15.0
"""Bits of an anchor's place on its lattice, with its class."""
MASK_BITS = 3.0
"""Bits of the mask of a slot that is on."""
CLOSED_BITS = 0.25
"""Bits of every slot of a visible anchor."""
_LEAST_WIDTH = 1e-3
_MOST_BITS = 40.0
_UNITS = 24


def cell_bits(values: Tensor, width: Tensor, mean: Tensor, log_spread: Tensor) -> Tensor:
    """Bits of the cell of `width` about each value, under a logistic distribution; everything broadcasts.

    sigmoid(b) - sigmoid(a) = sigmoid(b) sigmoid(-a) (1 - e^(a - b)) keeps the tails exact, where a difference is 0.
    """
    inverse = torch.exp(-log_spread)
    high, low = (values - mean + width / 2) * inverse, (values - mean - width / 2) * inverse
    mass = functional.logsigmoid(high) + functional.logsigmoid(-low) + torch.log(-torch.expm1(low - high))
    return torch.clamp(-mass / math.log(2), max=_MOST_BITS)


class Context(nn.Module):
    """Mean and spread of the components of scalings and latents, from those before in the anchor and from neighbours.

    Args:
        width: components, 6 of them scalings.
        seed: of the first weights.
    """

    def __init__(self, width: int, seed: int = 0) -> None:
        super().__init__()
        # Layers draw their first weights from torch's global generator.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.hidden = Linear(columns(width), _UNITS)
        self.output = Linear(_UNITS, 2 * width)
        nn.init.zeros_(self.output.weight)
        nn.init.zeros_(self.output.bias)
        self.mean = nn.Parameter(torch.zeros(width, width))
        self.mean_bias = nn.Parameter(torch.zeros(width))
        self.spread = nn.Parameter(torch.zeros(width, width))
        self.spread_bias = nn.Parameter(torch.zeros(width))
        self.offset_spread = nn.Parameter(torch.zeros(3))
        self.register_buffer("earlier", torch.tril(torch.ones(width, width), -1))
        self.register_buffer("centre", torch.zeros(width))
        self.register_buffer("scale", torch.ones(width))
        self.earlier: Tensor
        self.centre: Tensor
        self.scale: Tensor

    @torch.no_grad()
    def start(self, values: Tensor, offsets: Tensor) -> None:
        """From (n, 6 + d) values and (m, 3) offsets that are on: independent components of these moments."""
        self.centre.copy_(sum_over_rows(values) / len(values))
        self.scale.copy_(values.std(dim=0).clamp_min(_LEAST_WIDTH))
        for parameter in (self.mean, self.mean_bias, self.spread, self.output.weight, self.output.bias):
            parameter.zero_()
        # The standard deviation of a logistic distribution of spread 1 is pi / sqrt(3).
        self.spread_bias.fill_(math.log(math.sqrt(3) / math.pi))
        self.offset_spread.copy_((offsets.std(dim=0).clamp_min(_LEAST_WIDTH) * math.sqrt(3) / math.pi).log())

    def normalise(self, values: Tensor) -> Tensor:
        """(n, 6 + d) values in the units in which neighbours are looked at."""
        return (values - self.centre) / self.scale

    def bits(self, values: Tensor, widths: Tensor, around: Tensor | None = None) -> Tensor:
        """(n, 6 + d) bits of values in cells of (6 + d,) or (n, 6 + d) widths.

        Args:
            values: (n, 6 + d).
            around: (n, columns) :func:`neighbour_means` of values that :meth:`normalise` gives; None: not known.
        """
        x, w = self.normalise(values), widths / self.scale
        known = x.detach()
        mean = linear(known, self.mean * self.earlier, self.mean_bias)
        spread = linear(known.abs(), self.spread * self.earlier, self.spread_bias)
        if around is not None:
            by_mean, by_spread = self.output(torch.relu(self.hidden(around))).chunk(2, dim=1)
            mean, spread = mean + by_mean, spread + by_spread
        return cell_bits(x, w, mean, spread.clamp(-8.0, 4.0))

    def offset_bits(self, offsets: Tensor, widths: Tensor) -> Tensor:
        """(..., 3) bits of offsets in cells of (3,) widths."""
        return cell_bits(offsets, widths, torch.zeros_like(widths), self.offset_spread)


@dataclass(frozen=True)
class Priced:
    """The values on which the bits of n anchors depend.

    Attributes:
        values: (n, 6 + d) scalings and latents; d = 0 where codewords carry features.
        offsets: (n, K, 3).
        shown: (n, K) bool, slots that are on.
        widths, offset_widths: (n, 6 + d) and (3,) of cells.
        around: (n, columns) what neighbours have, None if nobody looks.
    """

    values: Tensor
    offsets: Tensor
    shown: Tensor
    widths: Tensor
    offset_widths: Tensor
    around: Tensor | None = None


def layer_bits(context: Context, priced: Priced, index_bits: float = 0.0) -> Tensor:
    """Bits of n anchors in a layer, a differentiable sum.

    Args:
        priced: values, slots and cells; what is off costs nothing.
        index_bits: of the codewords of an anchor.
    """
    present = priced.shown.any(dim=1)
    bits = context.bits(priced.values, priced.widths, priced.around) * present[:, None]
    on = priced.shown.flatten().nonzero()[:, 0]
    slot_bits = total(context.offset_bits(priced.offsets.reshape(-1, 3).index_select(0, on), priced.offset_widths))
    positions = (POSITION_BITS + CLOSED_BITS * SLOTS) * present.sum()
    latent = total(bits[:, 6:]) + index_bits * present.sum()
    return positions + MASK_BITS * priced.shown.sum() + total(bits[:, :6]) + latent + slot_bits
