"""Activated values in float32, as a decoder gives them, against the float64 of the formulas (SPEC §9.3 to §9.6).

The reference is that of the conformance suite, and is itself compared with 50 decimal digits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray

from benchmarks.stability_search import F64, Floats, Operation, extreme_inputs, used_tolerance
from conformance import activated
from reference_decoder.anchors import outlook, sigmoid
from reference_decoder.explicit import opacity_logits, spherical_harmonics_from_colour
from scarfmt.rotation import quaternion_from
from scarfmt.scene import AnchorModel, Mlp

LEAST, MOST = -149, 127
"""Exponents of float32: a channel value is v * step, |v| < 2^31, step <= 2^96 (R-6.4-3, R-7.5-2)."""
_DIGITS = 50

Exact = Callable[[list[Any]], list[Any]]


@dataclass(frozen=True)
class Activation:
    """An operation, and the same in 50 digits: numbers of one input -> those of the output."""

    operation: Operation
    exact: Exact


def _both(b: F64) -> tuple[F64, F64]:
    return b, np.abs(b)


def _rotations(x: F64) -> tuple[F64, F64]:
    return _both(activated.rotations(x))


def _exact_rotation(x: list[Any]) -> list[Any]:
    u, v, twist = x
    normal = [(u + v) / 2, (u - v) / 2, 1 - abs(u + v) / 2 - abs(u - v) / 2]
    long = mpmath.sqrt(sum(n * n for n in normal))
    a, b, c = (n / long for n in normal)
    cosine, sine = mpmath.cos(twist / 2), mpmath.sin(twist / 2)
    length = mpmath.sqrt((1 + c) ** 2 + a * a + b * b) * (-1 if cosine < 0 else 1)
    return [q / length for q in ((1 + c) * cosine, a * sine - b * cosine, a * cosine + b * sine, (1 + c) * sine)]


def _logit(x: F64) -> tuple[F64, F64]:
    return _both(activated.logits(x[:, 0])[:, None])


def _exact_logit(x: list[Any]) -> list[Any]:
    y = min(x[0], -mpmath.mpf(2) ** -13)
    return [y - mpmath.log(-mpmath.expm1(y))]


def _opacity(x: F64) -> tuple[F64, F64]:
    return _both(np.asarray(1 / (1 + np.exp(-activated.logits(x[:, 0]))))[:, None])


def _exact_opacity(x: list[Any]) -> list[Any]:
    return [mpmath.exp(min(x[0], -mpmath.mpf(2) ** -13))]


def _colour(x: F64) -> tuple[F64, F64]:
    y, g, o = x.T
    return _both(np.stack([y - g + o, y + g, y - g - o], axis=1))


def _exact_colour(x: list[Any]) -> list[Any]:
    y, g, o = x
    return [y - g + o, y + g, y - g - o]


def _view_model(anchors: F64) -> AnchorModel:
    n = len(anchors)
    nothing = np.zeros((n, 0), np.float32)
    mlp = Mlp((np.zeros((1, 4), np.float32),) * 2, (np.zeros(1, np.float32),) * 2)
    return AnchorModel(anchors, nothing, np.zeros((n, 1, 3), np.float32), nothing, {"opacity": mlp})


def _view(x: Floats) -> Floats:
    """Direction and distance of an anchor from an eye at the origin."""
    anchors = x.astype(np.float64)
    return outlook(_view_model(anchors), np.arange(len(x)), np.zeros(3), np.float32)


def _view_reference(x: F64) -> tuple[F64, F64]:
    # Scaled by the largest, so that no square over- or underflows.
    largest = np.abs(x).max(axis=1, keepdims=True)
    scaled = x / np.where(largest > 0, largest, 1)
    length = np.sqrt((scaled * scaled).sum(axis=1, keepdims=True))
    direction = scaled / np.where(length > 0, length, 1)
    return _both(np.concatenate([direction, length * largest], axis=1))


def _exact_view(x: list[Any]) -> list[Any]:
    length = mpmath.sqrt(sum(v * v for v in x))
    return [*(v / length if length else mpmath.mpf(0) for v in x), length]


def single(act: Callable[[Floats], Floats]) -> Callable[[Floats], Floats]:
    """`act` as a decode stores it: in float32."""
    return lambda x: act(x).astype(np.float32)


def activations() -> list[Activation]:
    """Those without networks."""
    wide, one = ((LEAST,) * 3, (MOST,) * 3), ((LEAST,), (MOST,))
    return [
        Activation(
            Operation(
                "rotation from normal and twist", ("u", "v", "twist"), *wide,
                lambda x: quaternion_from(x[:, :2], x[:, 2]), _rotations,
            ),
            _exact_rotation,
        ),
        Activation(
            Operation("opacity logit", ("ln opacity",), *one, single(lambda x: opacity_logits(x[:, 0])[:, None]), _logit),
            _exact_logit,
        ),
        Activation(
            Operation(
                "opacity", ("ln opacity",), *one,
                lambda x: sigmoid(opacity_logits(x[:, 0]).astype(np.float32))[:, None], _opacity,
            ),
            _exact_opacity,
        ),
        Activation(
            Operation("degree 0 from Y, G, O", ("Y", "G", "O"), *wide, spherical_harmonics_from_colour, _colour),
            _exact_colour,
        ),
        Activation(
            Operation(
                "view direction and distance", ("x", "y", "z"), (-1040,) * 3, (1022,) * 3, _view, _view_reference,
                np.float64,
            ),
            _exact_view,
        ),
    ]  # fmt: skip


def reference_error(activation: Activation, inputs: NDArray[np.float64], count: int, seed: int = 3) -> float:
    """The most of the tolerance that the float64 reference itself uses, against 50 digits.

    Args:
        activation: what is computed.
        inputs: (n, columns) to look at in any case.
        count: others at random.
        seed: of those.
    """
    operation = activation.operation
    x = np.concatenate([inputs, extreme_inputs(operation, np.random.default_rng(seed), count).astype(np.float64)])
    with np.errstate(all="ignore"):
        b, m = operation.reference(x)
    with mpmath.workdps(_DIGITS):
        exact = [activation.exact([mpmath.mpf(v) for v in row]) for row in x.tolist()]
        apart = [[float(mpmath.mpf(v) - e) if np.isfinite(v) else v for v, e in zip(*pair, strict=True)]
                 for pair in zip(b.tolist(), exact, strict=True)]  # fmt: skip
    # b as a, the exact value as b: their difference is what counts.
    return float(used_tolerance(np.array(apart), np.zeros_like(b), m).max())
