"""Anchors of a scene in training: what is learnt of each, and the networks they share (Scaffold-GS; paper §3.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from reference_encoder.training.fixed_order import linear

SLOTS = 10
NETWORKS = ("opacity", "cov", "color")
_OUTPUTS = {"opacity": 1, "cov": 7, "color": 3}
ATTRIBUTES = ("latent", "scaling", "offsets")
"""The learnt attributes of each anchor, in the order of checkpoints."""

REACH = 1 << 20
"""Voxels across what training starts from, at most; half as much again may grow on each side. A tile has twice as many
(SPEC §13.1)."""


def within_reach(lattice: Tensor) -> Tensor:
    """(n,) bool, which of (n, 3) int64 lattice points a file can have."""
    return ((lattice >= -(REACH // 2)) & (lattice < REACH + REACH // 2)).all(dim=1)


def distinct(points: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The distinct ones of n >= 1 points, ascending by x, then y, then z.

    A number is sorted for each point, and not rows: that is a hundred times as fast.

    Args:
        points: (n, 3) int64, whose box has fewer than 2^63 points.

    Returns:
        (m, 3) int64 points, (n,) int64 the row there of each point, and (m,) int64 how often each is there.
    """
    least = points.min(dim=0).values
    _, height, depth = ((points - least).max(dim=0).values + 1).unbind()
    x, y, z = (points - least).unbind(1)
    numbers, which, counts = torch.unique((x * height + y) * depth + z, return_inverse=True, return_counts=True)
    rest = torch.div(numbers, depth, rounding_mode="floor")
    columns = torch.div(rest, height, rounding_mode="floor"), rest % height, numbers % depth
    return torch.stack(columns, dim=1) + least, which, counts


@dataclass(frozen=True)
class AnchorLattice:
    """The points on which anchors may lie: origin + voxel * integer.

    Attributes:
        origin: (3,) float64, world units.
        voxel: world units.
    """

    origin: Tensor
    voxel: float

    def to(self, device: torch.device) -> AnchorLattice:
        """A copy on another device."""
        return AnchorLattice(self.origin.to(device), self.voxel)

    @classmethod
    def round(cls, points: Tensor, voxel: float) -> AnchorLattice:
        """Round (P, 3) float64 points, with a coarser voxel where they are too far apart for that."""
        origin = points.min(dim=0).values
        return cls(origin, max(voxel, float((points.max(dim=0).values - origin).max()) / REACH))

    def world(self, lattice: Tensor) -> Tensor:
        """(n, 3) float32 world positions of (n, 3) int64 lattice points."""
        return (self.origin + self.voxel * lattice.double()).float()


@dataclass
class Anchors:
    """N anchors of K slots; a row of each tensor an anchor.

    Attributes:
        lattice: (N, 3) int64, not learnt: anchors never move.
        latent: (N, d) float32.
        scaling: (N, 6) float32, natural logs; [:3] multiply offsets, [3:] sizes.
        offsets: (N, K, 3) float32, in units of exp(scaling[:3]).
        first: (N, K) int64, not learnt by descent: the first layer, 0-based, that shows each slot; as many as there are
            layers for none.
        born: (N,) int64 iteration after which each was made.
    """

    lattice: Tensor
    latent: Tensor
    scaling: Tensor
    offsets: Tensor
    first: Tensor
    born: Tensor

    def __len__(self) -> int:
        return len(self.lattice)

    @classmethod
    def fresh(cls, lattice: Tensor, log_size: Tensor, latent: Tensor, born: int = 0) -> Anchors:
        """Anchors about which only (n,) `log_size` and (n, d) `latent` are known, shown by all layers."""
        n, device = len(lattice), lattice.device
        return cls(
            lattice,
            latent.clone(),
            log_size[:, None].repeat(1, 6).float(),
            torch.zeros(n, SLOTS, 3, device=device),
            torch.zeros(n, SLOTS, dtype=torch.long, device=device),
            torch.full((n,), born, device=device),
        )

    def to(self, device: torch.device) -> Anchors:
        """A copy on another device."""
        return Anchors(*(values.to(device) for values in vars(self).values()))

    def select(self, rows: Tensor) -> Anchors:
        """A copy with anchors `rows` alone."""
        return Anchors(*(values.detach()[rows] for values in vars(self).values()))

    def parameters(self) -> dict[str, Tensor]:
        """By name, what is learnt."""
        return {name: getattr(self, name) for name in ATTRIBUTES}


class SceneNetworks(nn.Module):
    """The decoder of latents, and the three networks that make Gaussians of features (SPEC §7.9, §9.6).

    The decoder is one linear layer: a hidden one before networks with a hidden layer of their own has nothing to add.
    """

    def __init__(self, features: int, seed: int) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(seed)
        inputs = features + 4
        self.decoder = nn.Linear(features, features)
        self.hidden = nn.ModuleDict({name: nn.Linear(inputs, features) for name in NETWORKS})
        self.output = nn.ModuleDict({name: nn.Linear(features, SLOTS * _OUTPUTS[name]) for name in NETWORKS})
        for module in self.modules():
            if isinstance(module, nn.Linear):
                bound = 1 / math.sqrt(module.in_features)
                for parameter in module.parameters():
                    with torch.no_grad():
                        parameter.uniform_(-bound, bound, generator=generator)
        with torch.no_grad():
            self.decoder.bias.zero_()
            self.decoder.weight.copy_(torch.eye(features))

    def features(self, latent: Tensor, bits: int | None = None) -> Tensor:
        """(n, D) features of (n, D) latents; with weights rounded as a file with `bits` a weight has them, or not."""
        return _linear(self.decoder, latent, bits)

    def run(self, name: str, inputs: Tensor, bits: int | None = None) -> Tensor:
        """(n, K * outputs) of (n, D + 4), before the last activation; `bits` as for :meth:`features`."""
        hidden = torch.relu(_linear(self.hidden[name], inputs, bits))
        return _linear(self.output[name], hidden, bits)


def _linear(layer: nn.Module, inputs: Tensor, bits: int | None) -> Tensor:
    assert isinstance(layer, nn.Linear)
    weight = layer.weight if bits is None else _round_weights(layer.weight, bits)
    return linear(inputs, weight, layer.bias)


def _round_weights(weight: Tensor, bits: int) -> Tensor:
    """(out, in) weights as a file has them, each row on a scale of its own (SPEC §7.9); backward the identity."""
    top = (1 << (bits - 1)) - 1
    scale = weight.detach().abs().amax(dim=1, keepdim=True).clamp_min(1e-30) / top
    return weight + (torch.round(weight.detach() / scale).clamp(-top, top) * scale - weight).detach()


def network_inputs(features: Tensor, positions: Tensor, eye: Tensor) -> Tensor:
    """(n, D + 4) inputs of the networks: feature, unit direction from the eye, distance (SPEC §9.6)."""
    towards = positions - eye
    distance = torch.linalg.norm(towards, dim=1, keepdim=True)
    direction = towards / distance.clamp_min(1e-12)
    return torch.cat([features, direction, distance], dim=1)
