"""Growth on nested grids and pruning: where anchors are missing, and which anchors nobody sees (Scaffold-GS §3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from reference_encoder.training.anchors import SLOTS, distinct, within_reach

GRADIENT_LIMIT = 2e-4
"""Mean norm of the gradient of a slot's place on the screen, loss a half picture, from which it asks for an anchor."""
PASSES = 3
_COARSEST, _NESTED = 16, 4
"""Voxels of the cells of the first pass, and how many times finer those of each next are."""
_LEAST_OPACITY = 0.005


@dataclass
class AnchorStatistics:
    """Statistics of N anchors since their counters were last cleared.

    Attributes:
        gradient: (N, K) sum of the norms of screen gradients.
        drawn: (N, K) pictures in which a slot was drawn.
        opacity: (N,) sum of the positive opacities of all slots.
        seen: (N,) pictures in which the anchor was in view.
        weight: (N, K) sum of blended weights, pixels; never cleared, but fading.
        energy: (N, K) what leaving a slot out would do, mean squares of pixels, summed over the photos that masks were
            decided by; never cleared, but fading.
        looked: (N,) how many photos these were, fading alike.
    """

    gradient: Tensor
    drawn: Tensor
    opacity: Tensor
    seen: Tensor
    weight: Tensor
    energy: Tensor
    looked: Tensor

    @classmethod
    def of(cls, count: int, device: torch.device | None = None) -> AnchorStatistics:
        """Nothing seen of `count` anchors; on the processor unless said."""
        slots, anchors = (count, SLOTS), (count,)
        shapes = (slots, slots, anchors, anchors, slots, slots, anchors)
        return cls(*(torch.zeros(shape, device=device) for shape in shapes))

    def to(self, device: torch.device) -> AnchorStatistics:
        """A copy on another device."""
        return AnchorStatistics(*(values.to(device) for values in vars(self).values()))

    def add(
        self,
        visible: Tensor,
        anchors: Tensor,
        slots: Tensor,
        norms: Tensor,
        shown: Tensor,
        opacity: Tensor,
        weights: Tensor,
    ) -> None:
        """Take in a picture.

        Args:
            visible: (V,) anchors in view.
            anchors, slots: (M,) of each Gaussian.
            norms: (M,) of its gradient on the screen, in halves of the picture.
            shown: (M,) whether it touched a pixel.
            opacity, weights: (M,) its opacity, and the sum of its blended weights.
        """
        self.seen.index_add_(0, visible, torch.ones_like(self.seen[:1]).expand(len(visible)))
        self.opacity.index_add_(0, anchors, opacity)
        flat = anchors * SLOTS + slots
        for counter, seen in ((self.gradient, norms), (self.drawn, 1.0), (self.weight, weights)):
            counter.view(-1).index_add_(0, flat, shown * seen)

    def select(self, rows: Tensor, fresh: int = 0) -> AnchorStatistics:
        """A copy with anchors `rows`, followed by `fresh` new ones."""
        new = AnchorStatistics.of(fresh, rows.device)
        pairs = zip(vars(self).values(), vars(new).values(), strict=True)
        return AnchorStatistics(*(torch.cat([old[rows], zeros]) for old, zeros in pairs))

    def clear(self, judged: Tensor) -> None:
        """Start counting again for slots (N, K) that were judged."""
        self.gradient[judged] = 0
        self.drawn[judged] = 0

    def unseen(self, least_views: int) -> Tensor:
        """(N,) anchors seen often enough that hardly show; the counters of those judged start again."""
        judged = self.seen > least_views
        faint = judged & (self.opacity < _LEAST_OPACITY * self.seen)
        self.opacity[judged] = 0
        self.seen[judged] = 0
        return faint


@dataclass(frozen=True)
class NewAnchors:
    """New anchors.

    Attributes:
        lattice: (n, 3) int64.
        size: (n,) int64 voxels of the cell each was made for.
        asking, parents: of each slot that asks, the row of `lattice`, and the anchor that it is of.
    """

    lattice: Tensor
    size: Tensor
    asking: Tensor
    parents: Tensor


def densify(
    lattice: Tensor,
    places: Tensor,
    statistics: AnchorStatistics,
    limit: float,
    least_drawn: int,
    generator: torch.Generator,
) -> NewAnchors:
    """Anchors to add where slots pull on the picture without getting there.

    Args:
        lattice: (N, 3) int64 points that are taken.
        places: (N, K, 3) float64 centres of slots, in voxels.
        statistics: of the N anchors; slots drawn more than `least_drawn` times are judged and start again.
        limit: gradient of the first pass; each next pass wants twice as much.
        generator: who of those that ask is heard; on the processor, so that it is the same on every device.
    """
    judged, device = statistics.drawn > least_drawn, lattice.device
    mean = torch.where(judged, statistics.gradient / statistics.drawn.clamp_min(1), 0.0)
    taken, new, sizes, asking, parents = lattice, [], [], [], []
    count = 0
    for number in range(PASSES):
        cell = _COARSEST // _NESTED**number
        selected = (torch.rand(mean.shape, generator=generator) < 1 - 0.5 ** (number + 1)).to(device)
        anchor, slot = ((mean >= limit * 2.0**number) & selected).nonzero(as_tuple=True)
        points = torch.round(places[anchor, slot] / cell).long() * cell
        near = within_reach(points)
        anchor, points = anchor[near], points[near]
        if not len(anchor):
            continue
        unique, which, _ = distinct(points)
        there = distinct(torch.round(taken.double() / cell).long() * cell)[0]
        both = torch.cat([there, unique])
        _, group, counts = distinct(both)
        free = counts[group[len(there) :]] == 1
        renumbered = torch.cumsum(free.long(), 0) - 1
        asks_free = free[which]
        new.append(unique[free])
        sizes.append(torch.full((int(free.sum()),), cell, device=device))
        asking.append(count + renumbered[which[asks_free]])
        parents.append(anchor[asks_free])
        count += len(new[-1])
        taken = torch.cat([taken, new[-1]])
    statistics.clear(judged)
    if not new:
        empty = torch.zeros(0, dtype=torch.long, device=device)
        return NewAnchors(torch.zeros(0, 3, dtype=torch.long, device=device), empty, empty, empty)
    return NewAnchors(torch.cat(new), torch.cat(sizes), torch.cat(asking), torch.cat(parents))


def inherit_latents(latent: Tensor, growth: NewAnchors) -> Tensor:
    """(n, d) latents of new anchors: of each component the largest of those that asked."""
    new = torch.full((len(growth.lattice), latent.shape[1]), -torch.inf, device=latent.device)
    index = growth.asking[:, None].expand(-1, latent.shape[1])
    return new.scatter_reduce(0, index, latent[growth.parents], "amax")
