"""Integer arithmetic of the networks, exact in binary32 (SPEC §10.1).

Every value is an integer. A linear layer is valid when its largest possible accumulator stays below 2^24:
then every partial sum of its products is an integer that binary32 holds exactly, whatever the order of the
additions and with or without fused multiply-add. So any BLAS, on any machine, computes the same bits.

The division by 2^s and its rounding are folded into the weights: round_shift(v, s) = floor(v / 2^s + 1/2),
and with weights and bias divided by 2^s beforehand every partial sum is the same integer, divided by 2^s.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, I32, I64, Ints
from scarfmt.errors import Malformed

ACCUMULATOR_LIMIT = 1 << 24
MAX_WEIGHT = 32767
MAX_SHIFT = 24
MIN_ACTIVATION_BITS, MAX_ACTIVATION_BITS = 8, 12


def amplitude(activation_bits: int) -> int:
    """amax, the largest activation of `activation_bits` bits."""
    return (1 << (activation_bits - 1)) - 1


def half_step(shift: int) -> int:
    """The number that round_shift adds before it shifts: 2^(shift-1), or 0 for no shift."""
    return 1 << shift >> 1


def round_shift(values: Ints, shift: int) -> I64:
    """values / 2^shift to the nearest integer, ties up; int64."""
    return (values.astype(np.int64) + half_step(shift)) >> shift


def check_rows(
    weights: Ints, biases: Ints, amax: int, shift: int, *, limit: int = ACCUMULATOR_LIMIT, refusal: str = "bad-network"
) -> None:
    """Check sum|w| * amax + |b| + half_step(shift) < limit for every row (SPEC §10.1).

    Args:
        weights: (out, in) integers, applied to activations within -amax..amax.
        biases: (out,) integers.

    Raises:
        Malformed: `refusal` for a row at or above the limit, or a shift outside 0..24.
    """
    if not 0 <= shift <= MAX_SHIFT:
        raise Malformed(refusal, f"a shift of {shift}, at most {MAX_SHIFT} allowed (SPEC §10.1)", field="network")
    reach = np.abs(weights.astype(np.int64)).sum(axis=1) * amax + np.abs(biases.astype(np.int64))
    worst = int(reach.max(initial=0)) + half_step(shift)
    if worst >= limit:
        raise Malformed(refusal, f"an accumulator reaches {worst}, not below {limit} (SPEC §10.1)", field="network")


@dataclass(frozen=True)
class Linear:
    """One linear layer, acc = W x + b, and the shift that brings acc back to activations.

    Attributes:
        weights: (out, in) int32, magnitudes up to 32767.
        biases: (out,) int64.
        shift: 0..24.
    """

    weights: I32
    biases: I64
    shift: int

    @property
    def inputs(self) -> int:
        """Input width."""
        return int(self.weights.shape[1])

    @property
    def outputs(self) -> int:
        """Output width."""
        return int(self.weights.shape[0])

    def check(self, amax: int, refusal: str = "bad-network") -> None:
        """Check what makes the layer exact for inputs within -amax..amax (SPEC §10.1).

        Raises:
            Malformed: `refusal` for weights and biases of different row counts, a weight or shift out of range,
                or an accumulator that could reach 2^24.
        """
        w, b = self.weights, self.biases
        if w.ndim != 2 or not w.shape[0] or not w.shape[1] or b.shape != w.shape[:1]:
            raise Malformed(refusal, f"weights {w.shape} and biases {b.shape} make no layer", field="network")
        if int(np.abs(w.astype(np.int64)).max()) > MAX_WEIGHT:
            raise Malformed(refusal, f"a weight above {MAX_WEIGHT} (SPEC §10.1)", field="network")
        check_rows(w, b, amax, self.shift, refusal=refusal)

    @cached_property
    def folded(self) -> tuple[F32, F32]:
        """W^T / 2^s, (in, out), and b / 2^s + 1/2, (out,): floor(x W^T + b) of these is the rounded layer."""
        return fold(self.weights, self.biases, self.shift)

    def round(self, x: NDArray[Any]) -> F32:
        """(n, out) float32 integers round_shift(W x + b, shift), of (n, in) activations of any dtype."""
        weights, biases = self.folded
        out: F32 = np.asarray(x, np.float32) @ weights
        out += biases
        return np.floor(out, out=out)

    def signed(self, x: NDArray[Any], amax: int) -> F32:
        """:meth:`round`, clamped to -amax..amax."""
        out = self.round(x)
        return np.clip(out, -amax, amax, out=out)

    def relu(self, x: NDArray[Any], amax: int) -> F32:
        """:meth:`round`, clamped to 0..amax."""
        out = self.round(x)
        return np.clip(out, 0, amax, out=out)


def fold(weights: Ints, biases: Ints, shift: int) -> tuple[F32, F32]:
    """`weights` transposed and `biases`, divided by 2^shift, with the half step of the rounding added; float32."""
    scale = 0.5**shift
    # Without a shift there is nothing to round, and a half beside 24 bits would not be exact.
    half = 0.5 if shift else 0.0
    turned = np.ascontiguousarray(weights.T, dtype=np.float64) * scale
    return turned.astype(np.float32), (biases.astype(np.float64) * scale + half).astype(np.float32)
