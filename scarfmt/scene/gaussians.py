"""The two in-memory scene models: explicit 3D Gaussians, and Scaffold-GS style anchors (SPEC §6.1).

Conventions: world coordinates as in the source file; quaternions are (w, x, y, z); opacity is kept as a
logit and scales as natural logarithms, as INRIA's PLY stores them; spherical-harmonic coefficients have
shape (N, (degree+1)^2, 3), coefficient-major, INRIA's sign and order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64
from scarfmt.errors import InvalidInput


@dataclass(frozen=True)
class GaussianScene:
    """N explicit Gaussians.

    Attributes:
        positions: (N, 3) float64, world units. float64 so that coordinates of 1e6 keep their detail.
        log_scales: (N, 3) float32, natural log of the standard deviations in world units.
        rotations: (N, 4) float32, quaternion w, x, y, z; need not be normalised.
        opacity_logits: (N,) float32; opacity = 1 / (1 + exp(-logit)).
        sh: (N, (degree+1)^2, 3) float32, degree 0..3; colour = 0.5 + sum of sh * basis.
    """

    positions: F64
    log_scales: F32
    rotations: F32
    opacity_logits: F32
    sh: F32

    def __post_init__(self) -> None:
        n = len(self.positions)
        shapes = {
            "positions": (n, 3),
            "log_scales": (n, 3),
            "rotations": (n, 4),
            "opacity_logits": (n,),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise InvalidInput(
                    "input-shape", f"expected shape {shape}, got {getattr(self, name).shape}", field=name
                )
        if self.sh.ndim != 3 or self.sh.shape[0] != n or self.sh.shape[1:] not in ((1, 3), (4, 3), (9, 3), (16, 3)):
            raise InvalidInput(
                "input-shape", f"expected ({n}, 1|4|9|16, 3) spherical harmonics, got {self.sh.shape}", field="sh"
            )

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0..3."""
        return math.isqrt(self.sh.shape[1]) - 1

    def take(self, index: NDArray[np.generic]) -> GaussianScene:
        """The Gaussians at `index` (integer or boolean, as numpy indexing), in that order."""
        return GaussianScene(
            self.positions[index],
            self.log_scales[index],
            self.rotations[index],
            self.opacity_logits[index],
            self.sh[index],
        )

    def rows(self, part: slice) -> GaussianScene:
        """Some consecutive Gaussians, as views: what is written there is written here."""
        return GaussianScene(
            self.positions[part], self.log_scales[part], self.rotations[part], self.opacity_logits[part], self.sh[part]
        )

    def assign(self, other: GaussianScene) -> None:
        """Take the numbers of another scene of as many Gaussians and the same degree."""
        for name, array in vars(self).items():
            array[...] = getattr(other, name)

    def with_sh_degree(self, degree: int) -> GaussianScene:
        """A copy of the scene with bands above `degree` dropped."""
        return replace(self, sh=np.ascontiguousarray(self.sh[:, : (degree + 1) ** 2]))

    def invalid_rows(self) -> NDArray[np.bool_]:
        """(N,) bool: rows holding a NaN or an infinity in any attribute."""
        bad = ~np.isfinite(self.positions).all(1) | ~np.isfinite(self.opacity_logits)
        for values in (self.log_scales, self.rotations, self.sh.reshape(len(self), -1)):
            bad |= ~np.isfinite(values).all(1)
        return bad


@dataclass(frozen=True)
class Mlp:
    """One hidden layer perceptron: out = W1 relu(W0 x + b0) + b1, the Scaffold-GS shape.

    Attributes:
        weights: two float32 matrices, (hidden, in) and (out, hidden).
        biases: two float32 vectors, (hidden,) and (out,).
    """

    weights: tuple[F32, F32]
    biases: tuple[F32, F32]


@dataclass(frozen=True)
class AnchorModel:
    """N anchors of K Gaussian slots with their decoding MLPs (paper §3.1; Scaffold-GS).

    Attributes:
        anchors: (N, 3) float64 positions, world units.
        features: (N, D) float32.
        offsets: (N, K, 3) float32, in units of the anchor's first three scalings.
        log_scaling: (N, 6) float32, natural logs; [0:3] multiply offsets, [3:6] multiply Gaussian scales.
        mlps: ``{"opacity", "cov", "color"}`` -> :class:`Mlp` of input [feature, view direction, distance],
            or all three without the distance.
        slot_mask: (N, K) bool, slots that may ever be drawn.
    """

    anchors: F64
    features: F32
    offsets: F32
    log_scaling: F32
    mlps: dict[str, Mlp] = field(default_factory=dict)
    slot_mask: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.anchors)

    @property
    def slots(self) -> int:
        """K, Gaussian slots per anchor."""
        return int(self.offsets.shape[1])
