"""Activated values in float32, as a decoder gives them, against the float64 of the formulas (SPEC §9.3 to §9.6).

The reference is that of the conformance suite, and is itself compared with 50 decimal digits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np

from benchmarks.stability_search import Operation, extreme_inputs, used_tolerance
from conformance.expect import activated
from reference_decoder.anchors import outlook, sigmoid, slot_centres
from scarfmt.arrays import F64, Floats
from scarfmt.scene.activation import opacity_logits, spherical_harmonics_from_colour
from scarfmt.scene.gaussians import AnchorModel, Mlp
from scarfmt.scene.rotation import quaternion_from

LEAST, MOST = -149, 127
"""Exponents of float32: a channel value is v * step, |v| < 2^31, step <= 2^96 (R-6.4-3, R-7.5-2)."""
_DIGITS = 50
_LARGEST_LOG_OPACITY = 2.0**-13

Exact = Callable[[list[Any]], list[Any]]


@dataclass(frozen=True)
class Activation:
    """An operation, the same in 50 digits (numbers of one input -> those of the output), and inputs that are hard."""

    operation: Operation
    exact: Exact
    hard: tuple[tuple[float, ...], ...] = ()


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
    y = min(x[0], -_LARGEST_LOG_OPACITY)
    return [y - mpmath.log(-mpmath.expm1(y))]


def _opacity(x: F64) -> tuple[F64, F64]:
    return _both(np.asarray(1 / (1 + np.exp(-activated.logits(x[:, 0]))))[:, None])


def _exact_opacity(x: list[Any]) -> list[Any]:
    return [mpmath.exp(min(x[0], -_LARGEST_LOG_OPACITY))]


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
    return _both(activated.view(x))


def _exact_view(x: list[Any]) -> list[Any]:
    length = mpmath.sqrt(sum(v * v for v in x))
    return [*(v / length if length else mpmath.mpf(0) for v in x), length]


def _centre(x: Floats) -> Floats:
    """One coordinate of a slot's centre."""
    n = len(x)
    scaling = np.repeat(x[:, 2:], 6, axis=1).astype(np.float32)
    anchors, offsets = np.repeat(x[:, :1], 3, axis=1).astype(np.float64), np.repeat(x[:, 1:2], 3, axis=1)
    model = AnchorModel(anchors, np.zeros((n, 0), np.float32), offsets[:, None].astype(np.float32), scaling)
    return slot_centres(model, np.arange(n), np.zeros(n, np.int64))[:, :1]


def _centre_reference(x: F64) -> tuple[F64, F64]:
    a, offset, scale = x.T
    reach = offset * np.exp(scale)
    return (a + reach)[:, None], (np.abs(a) + np.abs(reach))[:, None]


def _exact_centre(x: list[Any]) -> list[Any]:
    return [x[0] + x[1] * mpmath.exp(min(x[2], 10000))]


def _single_logit(x: Floats) -> Floats:
    """The logit in the precision in which a decode stores it."""
    return opacity_logits(x[:, 0]).astype(np.float32)[:, None]


def _turned(x: Any) -> Floats:
    """In the type of `x`, float32 as in a decode."""
    return quaternion_from(x[:, :2], x[:, 2])


def activations() -> list[Activation]:
    """Cases without networks."""
    wide, one = ((LEAST,) * 3, (MOST,) * 3), ((LEAST,), (MOST,))
    return [
        Activation(
            Operation(
                "rotation from normal and twist", ("u", "v", "twist"), *wide,
                _turned, _rotations,
            ),
            _exact_rotation,
        ),
        Activation(
            Operation("opacity logit", ("ln opacity",), *one, _single_logit, _logit),
            _exact_logit,
        ),
        Activation(
            Operation(
                "opacity", ("ln opacity",), *one,
                lambda x: sigmoid(_single_logit(x)), _opacity,
            ),
            _exact_opacity,
        ),
        Activation(
            Operation(
                "degree 0 from Y, G, O", ("Y", "G", "O"), *wide,
                spherical_harmonics_from_colour, activated.colours,
            ),
            _exact_colour,
            ((1.0, 2.0**60, 2.0**60),),
        ),
        Activation(
            Operation(
                "view direction and distance", ("x", "y", "z"), (-1070,) * 3, (1021,) * 3, _view, _view_reference,
                np.float64,
            ),
            _exact_view,
        ),
        Activation(
            Operation("centre of a slot", ("anchor", "offset", "log scale"), *wide, _centre, _centre_reference),
            _exact_centre,
            # e^30 is 1.07e13: what is left of it here is off by some 0.001 in float64.
            ((-10686474581524.0, 1.0, 30.0),),
        ),
    ]  # fmt: skip


def reference_error(activation: Activation, inputs: Sequence[tuple[float, ...]], count: int, seed: int = 3) -> float:
    """The most of the tolerance that the float64 reference itself uses, against 50 digits.

    Args:
        activation: what is computed.
        inputs: to look at in any case.
        count: others at random.
        seed: of those.
    """
    operation = activation.operation
    others = extreme_inputs(operation, np.random.default_rng(seed), count).astype(np.float64)
    x = np.concatenate([np.array(inputs), others])
    with np.errstate(all="ignore"):
        b, m = operation.reference(x)
    with mpmath.workdps(_DIGITS):
        exact = [activation.exact([mpmath.mpf(v) for v in row]) for row in x.tolist()]
        apart = [[float(mpmath.mpf(v) - e) if np.isfinite(v) else v for v, e in zip(*pair, strict=True)]
                 for pair in zip(b.tolist(), exact, strict=True)]  # fmt: skip
    # b as a, the exact value as b: their difference is what counts.
    return float(used_tolerance(np.array(apart), np.zeros_like(b), m).max())
