"""The two in-memory scene models: explicit 3D Gaussians, and Scaffold-GS style anchors (SPEC §6.1).

Conventions: world coordinates as in the source file; quaternions are (w, x, y, z); opacity is kept as a
logit and scales as natural logarithms, as INRIA's PLY stores them; spherical-harmonic coefficients have
shape (N, (degree+1)^2, 3), coefficient-major, INRIA's sign and order.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64
from scarfmt.errors import InvalidInput, plural
from scarfmt.scene.description import NOTHING_SAID, Description


@dataclass(frozen=True)
class GaussianScene:
    """N explicit Gaussians. Arrays of other types, lists and tensors become arrays of those below.

    Attributes:
        positions: (N, 3) float64, world units. float64 so that coordinates of 1e6 keep their detail.
        log_scales: (N, 3) float32, natural log of the standard deviations in world units.
        rotations: (N, 4) float32, quaternion w, x, y, z; need not be normalised.
        opacity_logits: (N,) float32; opacity = 1 / (1 + exp(-logit)).
        sh: (N, (degree+1)^2, 3) float32, degree 0..3; colour = 0.5 + sum of sh * basis.
        description: what holds for all of them.
    """

    positions: F64
    log_scales: F32
    rotations: F32
    opacity_logits: F32
    sh: F32
    description: Description = field(default=NOTHING_SAID, kw_only=True)

    def __post_init__(self) -> None:
        for name, values in self.arrays().items():
            # Numbers of other types, such as float16, overflow in sums, and tensors index otherwise.
            with np.errstate(over="ignore"):
                array = np.asarray(values, np.float64 if name == "positions" else np.float32)
            object.__setattr__(self, name, array)
        n = len(self.positions)
        shapes = {"positions": (n, 3), "log_scales": (n, 3), "rotations": (n, 4), "opacity_logits": (n,)}
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

    def __repr__(self) -> str:
        return f"<GaussianScene: {plural(len(self), 'Gaussian')}, SH degree {self.sh_degree}>"

    def _repr_png_(self) -> bytes | None:
        """A picture for notebooks; None, and so the text, without the extra ``render`` or the compiled renderer."""
        try:
            notebook = importlib.import_module("scarfmt.render.notebook")  # by name: drawing lies above this module
            picture: bytes | None = notebook.picture(self)
        except (ModuleNotFoundError, InvalidInput):
            return None
        return picture

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0..3."""
        return math.isqrt(self.sh.shape[1]) - 1

    def take(self, index: NDArray[np.generic]) -> GaussianScene:
        """The Gaussians at `index` (integer or boolean, as numpy indexing), in that order."""
        return replace(self, **{name: values[index] for name, values in self.arrays().items()})

    def rows(self, part: slice) -> GaussianScene:
        """Some consecutive Gaussians, as views: what is written there is written here."""
        return replace(self, **{name: values[part] for name, values in self.arrays().items()})

    def arrays(self) -> dict[str, Any]:
        """The arrays by name, a row for each Gaussian."""
        return {name: values for name, values in vars(self).items() if name != "description"}

    def assign(self, other: GaussianScene) -> None:
        """Take the numbers of another scene of as many Gaussians and the same degree."""
        for name, array in self.arrays().items():
            array[...] = getattr(other, name)

    def with_sh_degree(self, degree: int) -> GaussianScene:
        """A copy of the scene with bands above `degree` dropped."""
        return replace(self, sh=np.ascontiguousarray(self.sh[:, : (degree + 1) ** 2]))

    def invalid_rows(self) -> NDArray[np.bool_]:
        """(N,) bool: rows holding a NaN or an infinity in any attribute."""
        bad = ~np.isfinite(self.positions).all(1) | ~np.isfinite(self.opacity_logits)
        for values in (self.log_scales, self.rotations):
            bad |= ~np.isfinite(values).all(1)
        return bad | ~np.isfinite(self.sh).all((1, 2))


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

    def __repr__(self) -> str:
        return f"<AnchorModel: {plural(len(self), 'anchor')} of {plural(self.slots, 'Gaussian')}>"

    @property
    def slots(self) -> int:
        """K, Gaussian slots per anchor."""
        return int(self.offsets.shape[1])


def allocate_scene(count: int, sh_degree: int, description: Description = NOTHING_SAID) -> GaussianScene:
    """Room for `count` Gaussians, whose numbers are still to be written."""
    shapes = (3,), (4,), (), ((sh_degree + 1) ** 2, 3)
    rows = (np.empty((count, *shape), np.float32) for shape in shapes)
    return GaussianScene(np.empty((count, 3)), *rows, description=description)


def concatenate(parts: Sequence[GaussianScene], sh_degree: int = 0) -> GaussianScene:
    """One scene of all Gaussians, of the highest degree of `parts` and `sh_degree`; degrees a part lacks are zeros.

    The description is that of the first part.
    """
    if not parts:
        return allocate_scene(0, sh_degree)
    coefficients = max((sh_degree + 1) ** 2, *(part.sh.shape[1] for part in parts))
    return GaussianScene(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.log_scales for part in parts]),
        np.concatenate([part.rotations for part in parts]),
        np.concatenate([part.opacity_logits for part in parts]),
        np.concatenate([pad_harmonics(part.sh, coefficients) for part in parts]),
        description=parts[0].description,
    )


def pad_harmonics(sh: F32, coefficients: int) -> F32:
    """(N, coefficients, 3) spherical harmonics: zeros above their degree."""
    return np.pad(sh, ((0, 0), (0, coefficients - sh.shape[1]), (0, 0)))
