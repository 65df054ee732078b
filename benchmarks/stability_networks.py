"""Networks of SPEC §7.9 and §9.6 in the decoder's arithmetic, against float64: random ones, then the worst inputs.

The reference adds up in float64: what the order of its sums leaves open is 10^-8 of a tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from benchmarks.stability_search import F64, Floats, Operation, Worst, search
from reference_decoder.anchors import log_sigmoid, outlook, run, sigmoid, unit_quaternions
from scarfmt.codecs.mlp import Linear, Network
from scarfmt.scene import AnchorModel, Mlp

_LATENTS, _FEATURES, _HIDDEN = 6, 4, 8
_COLUMNS = (*(f"f{k}" for k in range(_FEATURES)), "x", "y", "z", "log scale")
_LOW, _HIGH = (*(-20,) * _FEATURES, *(-20,) * 3, -4), (*(20,) * _FEATURES, *(20,) * 3, 10)
_STD, _QUATERNION = slice(0, 3), slice(3, 7)


def random_layer(rng: np.random.Generator, rows: int, columns: int, reach: float) -> Linear:
    """Weights of 8 or 16 bits, at times all at their ends; outputs of about `reach` for inputs of 1."""
    top = int(rng.choice([127, 32767]))
    weights = rng.integers(-top, top + 1, (rows, columns))
    if rng.random() < 0.3:
        weights = rng.choice([-top - 1, top], (rows, columns))
    scales = np.full(rows, reach / top / np.sqrt(columns)) * np.exp2(rng.normal(size=rows))
    biases = rng.normal(size=rows) * reach * rng.choice([0, 0.01, 1])
    return Linear(weights.astype(np.int16), scales.astype(np.float32), biases.astype(np.float32))


def forward(network: Network, x: F64) -> tuple[F64, F64]:
    """(n, out) outputs in float64, and m of R-9.5-1: the same of magnitudes."""
    y, m = x, np.abs(x)
    with np.errstate(all="ignore"):
        for number, layer in enumerate(network.layers):
            y = (np.maximum(y, 0) if number else y) @ layer.matrix.T + layer.biases.astype(np.float64)
            m = m @ np.abs(layer.matrix).T + np.abs(layer.biases.astype(np.float64))
    return y, np.maximum(np.abs(y), m)


def decoder_operation(network: Network) -> Operation:
    """The latent decoder."""
    columns = tuple(f"z{k}" for k in range(network.inputs))
    width = len(columns)
    return Operation(
        "latent decoder", columns, (-149,) * width, (127,) * width, network.apply, lambda x: forward(network, x)
    )


def _perceptron(network: Network) -> Mlp:
    first, second = network.layers
    single = [(layer.matrix.astype(np.float32), layer.biases) for layer in (first, second)]
    return Mlp((single[0][0], single[1][0]), (single[0][1], single[1][1]))


def _inputs(mlp: Mlp, x: Floats) -> Floats:
    """Network inputs of anchors seen from the origin, as a decoder makes them."""
    features, anchors = x[:, :_FEATURES].astype(np.float32), x[:, _FEATURES : _FEATURES + 3].astype(np.float64)
    nothing = np.zeros((len(x), 1, 3), np.float32)
    model = AnchorModel(anchors, features, nothing, nothing[:, 0], {"opacity": mlp})
    return outlook(model, np.arange(len(x)), np.zeros(3), np.float32)


def _reference_inputs(x: F64) -> F64:
    away = x[:, _FEATURES : _FEATURES + 3]
    distance = np.sqrt((away * away).sum(axis=1, keepdims=True))
    return np.concatenate([x[:, :_FEATURES], away / np.where(distance > 0, distance, 1), distance], axis=1)


def scene_operations(network: Network) -> Iterator[Operation]:
    """What becomes of a network's outputs: opacity, standard deviation, quaternion, colour of a slot."""
    mlp = _perceptron(network)

    def made(name: str, single: Callable[[Floats, Floats], Floats], double: Callable[[F64, F64], F64],
             outputs: slice = slice(None)) -> Operation:  # fmt: skip
        def reference(x: F64) -> tuple[F64, F64]:
            y, m = forward(network, _reference_inputs(x))
            with np.errstate(all="ignore"):
                b = double(y, x[:, -1:])
            return b[:, outputs], np.maximum(np.abs(b), m)[:, outputs]

        def evaluate(x: Floats) -> Floats:
            return single(run(mlp, _inputs(mlp, x)), x[:, -1:].astype(np.float32))[:, outputs]

        return Operation(name, _COLUMNS, _LOW, _HIGH, evaluate, reference)

    yield made("slot opacity", lambda o, s: np.tanh(o), lambda o, s: np.tanh(o))
    yield made(
        "slot standard deviation",
        lambda q, s: np.exp(s + log_sigmoid(q)), lambda q, s: np.exp(s) / (1 + np.exp(-q)), _STD,
    )  # fmt: skip
    yield made("slot rotation", _turned, _turned_reference, _QUATERNION)
    yield made("slot colour", lambda c, s: sigmoid(c), lambda c, s: 1 / (1 + np.exp(-c)))


def _turned(q: Floats, s: Floats) -> Floats:
    return np.concatenate([q[:, _STD], unit_quaternions(q[:, _QUATERNION])], axis=1)


def _turned_reference(q: F64, s: F64) -> F64:
    part = q[:, _QUATERNION]
    largest = np.abs(part).max(axis=1, keepdims=True)
    scaled = part / np.where(largest > 0, largest, 1)
    length = np.sqrt((scaled * scaled).sum(axis=1, keepdims=True))
    unit = np.where(largest > 0, scaled / np.where(length > 0, length, 1), np.array([1.0, 0, 0, 0]))
    return np.concatenate([q[:, _STD], unit], axis=1)


def _networks(count: int, scene: bool) -> Iterator[Network]:
    """Random ones of every reach."""
    rng = np.random.default_rng(5)
    for number in range(count):
        # Of every second as large or small as float32 lets the scales be.
        reach = 10.0 ** rng.uniform(*((-30, 20) if number % 2 else (-3, 4)))
        hidden = (_HIDDEN,) * int(rng.integers(0, 4))
        sizes = [_FEATURES + 4, _HIDDEN, 7] if scene else [_LATENTS, *hidden, 9]
        # The last layer decides how large outputs are; between the layers all is about 1.
        reaches = [*(1.0,) * (len(sizes) - 2), reach]
        layers = [
            random_layer(rng, rows, columns, size)
            for columns, rows, size in zip(sizes[:-1], sizes[1:], reaches, strict=True)
        ]
        yield Network(tuple(layers))


def _operations(network: Network, scene: bool) -> list[Operation]:
    return list(scene_operations(network)) if scene else [decoder_operation(network)]


def measure_networks(count: int, inputs: int, rounds: int) -> list[tuple[Operation, Worst]]:
    """The worst case of each operation over `count` networks, of which the worst three are climbed.

    Args:
        count: networks.
        inputs: of each, at random.
        rounds: of climbing.
    """
    out = []
    for scene in (False, True):
        tried = [
            [(search(one, inputs, 0, seed=number), one) for one in _operations(network, scene)]
            for number, network in enumerate(_networks(count, scene))
        ]
        for of_one in zip(*tried, strict=True):
            worst = sorted(of_one, key=lambda pair: -pair[0].used)[:3]
            climbed = [(search(one, inputs, rounds), one) for _, one in worst]
            best, operation = max(climbed, key=lambda pair: pair[0].used)
            cases = sum(found.cases for found, _ in [*of_one, *climbed])
            out.append((operation, replace(best, cases=cases)))
    return out
