"""The Gaussians that are drawn."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Gaussians:
    """M Gaussians as a renderer wants them; float32, any of them with a gradient.

    Attributes:
        centres: (M, 3) world units.
        scales: (M, 3) standard deviations along the axes, world units, positive.
        rotations: (M, 4) quaternions w x y z of any length.
        opacities: (M,) 0..1.
        colours: (M, 3), 1 is white.
    """

    centres: Tensor
    scales: Tensor
    rotations: Tensor
    opacities: Tensor
    colours: Tensor

    def tensors(self) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """All tensors, in this order."""
        return self.centres, self.scales, self.rotations, self.opacities, self.colours
