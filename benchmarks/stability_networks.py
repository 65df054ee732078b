"""Networks of SPEC §7.9 and §9.6 in the decoder's arithmetic, against float64: random ones, then the worst inputs.

The reference adds up in float64: what the order of its sums leaves open is 10^-8 of a tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.stability_search import NOT_COMPARED, Operation, Worst, search
from conformance.expect import activated
from reference_decoder.anchors import log_sigmoid, outlook, run, sigmoid, unit_quaternions
from scarfmt.arrays import F64, Floats
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.scene.gaussians import AnchorModel, Mlp

_LATENTS, _FEATURES, _HIDDEN = 6, 4, 8
_COLUMNS = (*(f"f{k}" for k in range(_FEATURES)), "x", "y", "z", "log scale")
_LOW, _HIGH = (*(-20,) * _FEATURES, *(-20,) * 3, -4), (*(20,) * _FEATURES, *(20,) * 3, 10)
_STD, _QUATERNION = slice(0, 3), slice(3, 7)


Single = Callable[[Floats, Floats], Floats]
"""Logarithmic scales (n, 1) and outputs of a network, in float32 -> values."""
Double = Callable[[F64, F64, F64], tuple[F64, F64]]
"""The evaluation in float64, and M of the outputs -> b and m."""


def random_layer(rng: np.random.Generator, rows: int, columns: int, reach: float) -> Linear:
    """Weights of 8 or 16 bits, at times all at their ends; outputs of about `reach` for inputs of 1."""
    top = int(rng.choice([127, 32767]))
    weights = rng.integers(-top, top + 1, (rows, columns))
    if rng.random() < 0.3:
        weights = rng.choice([-top - 1, top], (rows, columns))
    scales = np.full(rows, reach / top / np.sqrt(columns)) * np.exp2(rng.normal(size=rows))
    biases = rng.normal(size=rows) * reach * rng.choice([0, 0.01, 1])
    return Linear(weights.astype(np.int16), scales.astype(np.float32), biases.astype(np.float32))


def forward(network: QuantisedMlp, x: F64, magnitude: F64 | None = None) -> tuple[F64, F64]:
    """(n, out) outputs in float64, and M of R-9.5-1 of (n, in) inputs and their magnitudes, None for |x|."""
    y, m = x, np.abs(x if magnitude is None else magnitude)
    with np.errstate(all="ignore"):
        for number, layer in enumerate(network.layers):
            weights, biases = layer.matrix, layer.biases.astype(np.float64)
            y = (np.maximum(y, 0) if number else y) @ weights.T + biases
            beyond = _beyond(weights).any(axis=1) | _beyond(biases) | _beyond(m).any(axis=1, keepdims=True)
            m = np.where(beyond, np.inf, m @ np.abs(weights).T + np.abs(biases))
    return y, m


def _beyond(x: F64) -> NDArray[np.bool_]:
    return ~(np.abs(x) <= NOT_COMPARED)


def _larger(b: F64, m: F64) -> tuple[F64, F64]:
    return b, np.maximum(np.abs(b), m)


def decoder_operation(network: QuantisedMlp) -> Operation:
    """The latent decoder."""
    return Operation("latent decoder", *_latents(network), network.apply, lambda x: _larger(*forward(network, x)))


def _latents(network: QuantisedMlp) -> tuple[tuple[str, ...], tuple[int, ...], tuple[int, ...]]:
    """Columns of latents, and the exponents that are legal."""
    columns = tuple(f"z{k}" for k in range(network.inputs))
    return columns, (-149,) * len(columns), (127,) * len(columns)


def _perceptron(network: QuantisedMlp) -> Mlp:
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
    return np.concatenate([x[:, :_FEATURES], activated.view(x[:, _FEATURES : _FEATURES + 3])], axis=1)


def scene_operations(network: QuantisedMlp) -> Iterator[Operation]:
    """The operations after a network's outputs: opacity, standard deviation, quaternion, colour of a slot."""
    mlp = _perceptron(network)

    def made(name: str, single: Single, double: Double) -> Operation:
        def reference(x: F64) -> tuple[F64, F64]:
            with np.errstate(all="ignore"):
                return double(x[:, -1:], *forward(network, _reference_inputs(x)))

        def evaluate(x: Floats) -> Floats:
            return single(x[:, -1:].astype(np.float32), run(mlp, _inputs(mlp, x)))

        return Operation(name, _COLUMNS, _LOW, _HIGH, evaluate, reference)

    yield made("slot opacity", lambda s, o: np.tanh(o), lambda s, o, m: _larger(np.tanh(o), m))
    yield made(
        "slot standard deviation",
        lambda s, q: np.exp(s + log_sigmoid(q[:, _STD])),
        lambda s, q, m: activated.deviations(s, q[:, _STD], m[:, _STD]),
    )
    yield made(
        "slot rotation",
        lambda s, q: unit_quaternions(q[:, _QUATERNION]),
        lambda s, q, m: activated.quaternions(q[:, _QUATERNION], m[:, _QUATERNION]),
    )
    yield made("slot colour", lambda s, c: sigmoid(c), lambda s, c, m: _larger(activated.sigmoid(c), m))


def chained_operation(decoder: QuantisedMlp, network: QuantisedMlp) -> Operation:
    """Colours of slots from latents, all in float32: the error of a feature is also one of what is made of it.

    A decode computes features in float64 and rounds them (:meth:`QuantisedMlp.apply`); no decoder has to.
    """
    mlp = _perceptron(network)

    def evaluate(x: Floats) -> Floats:
        return sigmoid(run(mlp, _inputs(mlp, _placed(_single(decoder, x)))))

    def reference(x: F64) -> tuple[F64, F64]:
        with np.errstate(all="ignore"):
            features, features_m = forward(decoder, x)
            inputs, inputs_m = (_reference_inputs(_placed(part)) for part in (features, features_m))
            y, m = forward(network, inputs, inputs_m)
            return _larger(activated.sigmoid(y), m)

    return Operation("slot colour from latents", *_latents(decoder), evaluate, reference)


def _single(network: QuantisedMlp, x: Floats) -> Floats:
    y = x.astype(np.float32)
    for number, layer in enumerate(network.layers):
        y = (np.maximum(y, 0) if number else y) @ layer.matrix.astype(np.float32).T + layer.biases
    return y


def _placed(features: Floats) -> F64:
    """Features of anchors that all stand in one place."""
    place = np.broadcast_to([3.0, -2.0, 1.0], (len(features), 3))
    return np.concatenate([features.astype(np.float64), place], axis=1)


def _networks(count: int, scene: bool) -> Iterator[QuantisedMlp]:
    """Random ones of every reach."""
    rng = np.random.default_rng(5)
    for number in range(count):
        # Of every second as large or small as float32 lets the scales be.
        reach = 10.0 ** rng.uniform(*((-30, 20) if number % 2 else (-3, 4)))
        hidden = (_HIDDEN,) * int(rng.integers(0, 4))
        sizes = [_FEATURES + 4, _HIDDEN, 7] if scene else [_LATENTS, *hidden, _FEATURES]
        # The last layer decides how large outputs are; between the layers all is about 1.
        reaches = [*(1.0,) * (len(sizes) - 2), reach]
        layers = [
            random_layer(rng, rows, columns, size)
            for columns, rows, size in zip(sizes[:-1], sizes[1:], reaches, strict=True)
        ]
        yield QuantisedMlp(tuple(layers))


def _operations(networks: int, scene: bool) -> Iterator[list[Operation]]:
    """The operations of each of `networks` networks."""
    if scene:
        for network in _networks(networks, scene=True):
            yield list(scene_operations(network))
        return
    for decoder, network in zip(_networks(networks, scene=False), _networks(networks, scene=True), strict=True):
        yield [decoder_operation(decoder), chained_operation(decoder, network)]


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
            [(search(one, inputs, 0, seed=number), one) for one in operations]
            for number, operations in enumerate(_operations(count, scene))
        ]
        for of_one in zip(*tried, strict=True):
            worst = sorted(of_one, key=lambda pair: -pair[0].used)[:3]
            climbed = [(search(one, inputs, rounds), one) for _, one in worst]
            best, operation = max(climbed, key=lambda pair: pair[0].used)
            cases = sum(found.cases for found, _ in [*of_one, *climbed])
            out.append((operation, replace(best, cases=cases)))
    return out
