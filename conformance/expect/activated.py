"""Activated values in binary64: the reference of SPEC §9.5, from the formulas of §7.9, §9.3, §9.4 and §9.6.

Every value comes with its m of R-9.5-1, where that may differ from its own magnitude. Sums are rounded once
(`math.fsum`), so that no order of addition shows; what is left to the machine are the last bits of exp, tanh, sin, cos.
A value that overflows is an infinity, or not a number, and is not an error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from conformance.expect.expectations import Arrays
from scarfmt.arrays import F64
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.coding.writer import QuantisedScene

_LARGEST_LOG_OPACITY = -(2.0**-13)
LARGEST_COMPARED, SHORTEST_COMPARED = 1e38, 1e-30
"""R-9.5-1: beyond the first, below the second a binary32 on the way may have overflowed or vanished."""


@dataclass(frozen=True)
class Activated:
    """An array of references.

    Attributes:
        reference: float64, any shape.
        magnitude: m of every number; None: |reference|.
    """

    reference: F64
    magnitude: F64 | None = None

    def to_bytes(self) -> bytes:
        """The references as ``<f8`` in C order, then the magnitudes."""
        arrays = [self.reference] if self.magnitude is None else [self.reference, self.magnitude]
        return b"".join(np.ascontiguousarray(array).astype("<f8").tobytes() for array in arrays)


def activate(scene: QuantisedScene, arrays: Arrays, camera: tuple[float, ...] | None = None) -> dict[str, Activated]:
    """The activated values of a scene, by their names in PROTOCOL.md.

    Args:
        arrays: the exact arrays of its last layer.
        camera: centre of the camera, in world units; None in the explicit profile, which needs none.
    """
    with np.errstate(all="ignore"):
        return _explicit(scene, arrays) if camera is None else _anchor(scene, arrays, np.array(camera))


# ---------------------------------------------------------------------------------------------- 7.9 networks


def _layer(weights: F64, biases: F64, x: F64) -> F64:
    rows = list(zip(weights.tolist(), biases.tolist(), strict=True))
    y = [[_sum([*(w * v for w, v in zip(row, one, strict=True)), b]) for row, b in rows] for one in x.tolist()]
    return np.array(y, np.float64).reshape(len(x), len(rows))


def _sum(terms: list[float]) -> float:
    # fsum refuses an infinity next to its opposite, and sums of finite numbers that overflow.
    if all(abs(t) < 1e290 for t in terms):
        return math.fsum(terms)
    return float(np.sum(np.array(terms)))


def network(net: QuantisedMlp, x: F64, magnitude: F64) -> tuple[F64, F64]:
    """Outputs of a network, and their M of R-9.5-1.

    Args:
        x: (n, inputs).
        magnitude: (n, inputs), |x| or the M of what made it.

    Returns:
        Two of (n, outputs).
    """
    y, m = x, magnitude
    for number, layer in enumerate(net.layers):
        weights = layer.weights.astype(np.float64) * layer.scales[:, None].astype(np.float64)
        biases = layer.biases.astype(np.float64)
        y = _layer(weights, biases, np.maximum(y, 0) if number else y)
        beyond = _beyond(weights).any(axis=1) | _beyond(biases) | _beyond(m).any(axis=1, keepdims=True)
        m = np.where(beyond, np.inf, _layer(np.abs(weights), np.abs(biases), m))
    return y, m


def _beyond(x: F64) -> NDArray[np.bool_]:
    return ~(np.abs(x) <= LARGEST_COMPARED)


def _larger(reference: F64, magnitude: F64) -> Activated:
    return Activated(reference, np.maximum(np.abs(reference), magnitude))


# ---------------------------------------------------------------------------------------------- 9.3, 9.4 explicit


def rotations(values: F64) -> F64:
    """(n, 4) quaternions w x y z of (n, 3) values u, v, twist."""
    u, v, twist = values.T
    normal = np.stack([(u + v) / 2, (u - v) / 2, 1 - np.abs(u + v) / 2 - np.abs(u - v) / 2])
    x, y, z = normal / np.sqrt((normal * normal).sum(axis=0))
    c, s = np.cos(twist / 2), np.sin(twist / 2)
    length = np.sqrt((1 + z) ** 2 + x * x + y * y)
    quaternions: F64 = np.stack([(1 + z) * c, x * s - y * c, x * c + y * s, (1 + z) * s], axis=1) / length[:, None]
    return np.where(c[:, None] < 0, -quaternions, quaternions)


def logits(values: F64) -> F64:
    """(n,) opacity logits of (n,) values ln(opacity)."""
    y = np.minimum(values, _LARGEST_LOG_OPACITY)
    return np.asarray(y - np.log(-np.expm1(y)))


def _value(arrays: Arrays, name: str, components: int) -> F64:
    """Values of a channel, zeros where the file has none (R-9.2-3)."""
    found = arrays.get(f"value.{name}")
    return np.zeros((len(arrays["code"]), components)) if found is None else found.astype(np.float64)


def _explicit(scene: QuantisedScene, arrays: Arrays) -> dict[str, Activated]:
    logit = logits(_value(arrays, "OPACITY", 1)[:, 0])
    return {
        "rotation": Activated(rotations(_value(arrays, "ROTATION", 3))),
        "logit": Activated(logit),
        "opacity": Activated(np.asarray(1 / (1 + np.exp(-logit)))),
        "sh": _harmonics(scene, arrays),
    }


def colours(values: F64) -> tuple[F64, F64]:
    """(n, 3) degree-0 coefficients of (n, 3) values Y, G, O, and their m."""
    y, g, o = values.T
    sums = np.abs(values).sum(axis=1, keepdims=True)
    return np.stack([y - g + o, y + g, y - g - o], axis=1), np.repeat(sums, 3, axis=1)


def _harmonics(scene: QuantisedScene, arrays: Arrays) -> Activated:
    n, count = len(arrays["code"]), (scene.fields.sh_degree + 1) ** 2
    sh = np.zeros((n, count, 3))
    magnitude = np.zeros((n, count, 3))
    start = int("value.COLOUR" in arrays)
    if start:
        sh[:, 0], magnitude[:, 0] = colours(_value(arrays, "COLOUR", 3))
    if "latent" not in arrays or scene.decoder is None:
        return _larger(sh, magnitude) if start else Activated(sh)
    latent = arrays["latent"].astype(np.float64)
    for whole, part in zip((sh, magnitude), network(scene.decoder, latent, np.abs(latent)), strict=True):
        whole[:, start:] = part.reshape(n, count - start, 3)
    return _larger(sh, magnitude)


# ---------------------------------------------------------------------------------------------- 9.6 anchor profile


def _anchor(scene: QuantisedScene, arrays: Arrays, camera: F64) -> dict[str, Activated]:
    assert scene.decoder is not None
    slots, latent = scene.model.slots, arrays["latent"].astype(np.float64)
    scale = _value(arrays, "SCALE", 6)[:, None, :]
    feature, feature_m = network(scene.decoder, latent, np.abs(latent))
    seen = view(arrays["position"] - camera)[:, : scene.scene_mlps[0].inputs - feature.shape[1]]
    inputs, inputs_m = (np.concatenate([part, seen], axis=1) for part in (feature, feature_m))
    (o, o_m), (q, q_m), (c, c_m) = (
        [part.reshape(len(part), slots, part.shape[1] // slots) for part in network(net, inputs, np.abs(inputs_m))]
        for net in scene.scene_mlps
    )
    reach = arrays["value.OFFSETS"].astype(np.float64) * np.exp(scale[:, :, :3])
    anchor = arrays["position"][:, None, :]
    return {
        "feature": _larger(feature, feature_m),
        "gaussian.opacity": _larger(np.tanh(o[:, :, 0]), o_m[:, :, 0]),
        "gaussian.scale": Activated(*deviations(scale[:, :, 3:], q[:, :, :3], q_m[:, :, :3])),
        "gaussian.rotation": _larger(*quaternions(q[:, :, 3:], q_m[:, :, 3:])),
        "gaussian.colour": _larger(sigmoid(c), c_m),
        "gaussian.centre": Activated(anchor + reach, np.abs(anchor) + np.abs(reach)),
    }


def view(away: F64) -> F64:
    """(n, 4) unit direction and distance of (n, 3) vectors, no square of which over- or underflows."""
    scaled, length, exponents = _scale(away)
    direction = np.where(length == 0, 0.0, scaled / length)
    return np.concatenate([direction, np.ldexp(length, exponents)], axis=1)


def _scale(vectors: F64) -> tuple[F64, F64, NDArray[np.int32]]:
    """(..., k) vectors divided by 2^e, (..., 1) their lengths then, and (..., 1) e."""
    exponents = np.frexp(np.abs(vectors).max(axis=-1, keepdims=True, initial=0))[1]
    scaled = np.ldexp(vectors, -exponents)
    return scaled, np.sqrt((scaled * scaled).sum(axis=-1, keepdims=True)), exponents


def sigmoid(x: F64) -> F64:
    """1 / (1 + e^-x)."""
    return np.asarray(1 / (1 + np.exp(-x)))


def deviations(scale: F64, q: F64, magnitude: F64) -> tuple[F64, F64]:
    """Standard deviations of the logarithmic scales of anchors and q of slots, and their m, `magnitude` the M of q."""
    reference = np.exp(scale) * sigmoid(q)
    return reference, np.where(_beyond(magnitude), np.inf, reference * (1 + magnitude))


def quaternions(q: F64, magnitude: F64) -> tuple[F64, F64]:
    """(..., 4) of length 1, (1, 0, 0, 0) where all are 0; and their m, `magnitude` the M of `q`."""
    scaled, length, exponents = _scale(q)
    unit = np.where(length == 0, np.array([1.0, 0.0, 0.0, 0.0]), scaled / length)
    long, largest = np.ldexp(length, exponents), magnitude.max(axis=-1, keepdims=True)
    m = np.where(_beyond(largest) | (long < SHORTEST_COMPARED), np.inf, largest / long)
    return unit, np.broadcast_to(np.where(largest == 0, 1.0, m), q.shape)
