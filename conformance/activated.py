"""Activated values in binary64: the reference of SPEC §9.5, from the formulas of §7.9, §9.3, §9.4 and §9.6.

Every value comes with its magnitude m of R-9.5-1, where that may differ from its own. Sums are rounded once
(`math.fsum`), so that no order of addition shows; what is left to the machine are the last bits of exp, tanh, sin, cos.
A value that overflows is an infinity, or not a number, and is not an error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from conformance.expectations import Arrays
from scarfmt.codecs.mlp import Network
from scarfmt.schema import Profile
from scarfmt.writer import QuantisedScene

F64 = NDArray[np.float64]
_LARGEST_LOG_OPACITY = -(2.0**-13)


@dataclass(frozen=True)
class Activated:
    """An array of references.

    Attributes:
        reference: float64, any shape.
        magnitude: m of every number, where networks made some; None: |reference|.
    """

    reference: F64
    magnitude: F64 | None = None

    def to_bytes(self) -> bytes:
        """The references as ``<f8`` in C order, then the magnitudes."""
        arrays = [self.reference] if self.magnitude is None else [self.reference, self.magnitude]
        return b"".join(np.ascontiguousarray(array).astype("<f8").tobytes() for array in arrays)


def activated(scene: QuantisedScene, arrays: Arrays) -> dict[str, Activated]:
    """The activated values of a scene, by their names in PROTOCOL.md, of the exact arrays of its last layer."""
    with np.errstate(all="ignore"):
        return (_anchor if scene.fields.profile == Profile.ANCHOR else _explicit)(scene, arrays)


# ---------------------------------------------------------------------------------------------- 7.9 networks


def _layer(weights: list[list[float]], biases: list[float], x: list[float]) -> list[float]:
    return [_sum([*(w * v for w, v in zip(row, x, strict=True)), b]) for row, b in zip(weights, biases, strict=True)]


def _sum(terms: list[float]) -> float:
    # fsum refuses an infinity next to its opposite, and sums of finite numbers that overflow.
    if all(abs(t) < 1e290 for t in terms):
        return math.fsum(terms)
    return float(np.sum(np.array(terms)))


def network(net: Network, x: F64) -> Activated:
    """Outputs of rows of inputs (n, inputs), and the same with every weight, bias and input positive."""
    layers = [(layer.weights * layer.scales[:, None].astype(np.float64), layer.biases) for layer in net.layers]
    plain = [(w.tolist(), b.astype(np.float64).tolist()) for w, b in layers]
    positive = [(np.abs(w).tolist(), np.abs(b.astype(np.float64)).tolist()) for w, b in layers]
    return Activated(_run(plain, x, net.outputs), _run(positive, np.abs(x), net.outputs))


def _run(layers: list[tuple[Any, Any]], x: F64, outputs: int) -> F64:
    out = []
    for row in x.tolist():
        y = row
        for number, (weights, biases) in enumerate(layers):
            y = _layer(weights, biases, [max(v, 0.0) for v in y] if number else y)
        out.append(y)
    return np.array(out, np.float64).reshape(len(x), outputs)


def _larger(reference: F64, magnitude: F64 | None) -> Activated:
    assert magnitude is not None
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


def _harmonics(scene: QuantisedScene, arrays: Arrays) -> Activated:
    n, count = len(arrays["code"]), (scene.fields.sh_degree + 1) ** 2
    sh = np.zeros((n, count, 3))
    magnitude = np.zeros((n, count, 3))
    start = int("value.COLOUR" in arrays)
    if start:
        y, g, o = _value(arrays, "COLOUR", 3).T
        sh[:, 0] = np.stack([y - g + o, y + g, y - g - o], axis=1)
    if "latent" not in arrays or scene.decoder is None:
        return Activated(sh)
    made = network(scene.decoder, arrays["latent"].astype(np.float64))
    assert made.magnitude is not None
    sh[:, start:] = made.reference.reshape(n, count - start, 3)
    magnitude[:, start:] = made.magnitude.reshape(n, count - start, 3)
    return _larger(sh, magnitude)


# ---------------------------------------------------------------------------------------------- 9.6 anchor profile


def _anchor(scene: QuantisedScene, arrays: Arrays) -> dict[str, Activated]:
    assert scene.decoder is not None
    slots, scale = scene.model.slots, _value(arrays, "SCALE", 6)
    feature = network(scene.decoder, arrays["latent"].astype(np.float64))
    inputs = _view(scene, arrays, feature.reference)
    opacity, covariance, colour = (network(net, inputs) for net in scene.scene_mlps)
    q, q_magnitude = (_by_slot(part, slots, 7) for part in (covariance.reference, covariance.magnitude))
    reach = np.exp(scale)[:, None, :]
    offset = arrays["value.OFFSETS"].astype(np.float64)
    return {
        "feature": _larger(feature.reference, feature.magnitude),
        "gaussian.opacity": _larger(np.tanh(opacity.reference), opacity.magnitude),
        "gaussian.scale": _larger(reach[:, :, 3:] * _sigmoid(q[:, :, :3]), q_magnitude[:, :, :3]),
        "gaussian.rotation": _larger(_normalised(q[:, :, 3:]), q_magnitude[:, :, 3:]),
        "gaussian.colour": _larger(
            _sigmoid(_by_slot(colour.reference, slots, 3)), _by_slot(colour.magnitude, slots, 3)
        ),
        "gaussian.centre": Activated(arrays["position"][:, None, :] + offset * reach[:, :, :3]),
    }


def _view(scene: QuantisedScene, arrays: Arrays, feature: F64) -> F64:
    """Inputs of the three networks, with the camera at the header's origin."""
    away = arrays["position"] - np.array(scene.fields.origin)
    distance = np.sqrt((away * away).sum(axis=1))[:, None]
    direction = np.where(distance == 0, 0.0, away / distance)
    takes_distance = scene.scene_mlps[0].inputs == feature.shape[1] + 4
    return np.concatenate([feature, direction, distance] if takes_distance else [feature, direction], axis=1)


def _by_slot(outputs: F64 | None, slots: int, numbers: int) -> F64:
    assert outputs is not None
    return outputs.reshape(len(outputs), slots, numbers)


def _sigmoid(x: F64) -> F64:
    return np.asarray(1 / (1 + np.exp(-x)))


def _normalised(q: F64) -> F64:
    """(..., 4) of length 1; (1, 0, 0, 0) where all are 0."""
    length = np.sqrt((q * q).sum(axis=-1, keepdims=True))
    return np.where((q == 0).all(axis=-1, keepdims=True), np.array([1.0, 0.0, 0.0, 0.0]), q / length)
