"""From the trained torch model to the integers of the file (SPEC §10.5): the same numbers, in the file's classes."""

from __future__ import annotations

import numpy as np
import torch

from reference_encoder.networks.head import HeadModel
from reference_encoder.networks.layers import Dense
from reference_encoder.networks.model import AttentionModel, GruModel, IndexModel
from scarfmt.arrays import I32, I64
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.network import Attention, GruLayer, Head, IndexNetwork, Inputs
from scarfmt.scene.codebooks import Codebooks


def export(model: IndexModel, inputs: Inputs, books: Codebooks) -> IndexNetwork:
    """The network as the file holds it.

    Args:
        inputs: meaning of the columns the model was trained on.
        books: in the order of the model's clusters.

    Raises:
        Malformed: ``bad-network``; the bounds kept in training make it a fault of this program.
    """
    shape, attention = model.shape, model.attention
    with torch.no_grad():
        network = IndexNetwork(
            shape.activation_bits,
            inputs,
            model.codeword_dims,
            model.codeword_shift,
            (_linear(model.first), _linear(model.second)),
            tuple(_gru(layer) for layer in model.layers),
            _attention(attention) if attention is not None else None,
            _linear(model.mixer),
            tuple(_head(model.head(book)) for book in range(len(model.heads))),
        )
    network.check(books, model.stages)
    return network


def _matrix(values: torch.Tensor) -> I32:
    return np.asarray(values.numpy(), np.int32)


def _vector(values: torch.Tensor) -> I64:
    return np.asarray(values.numpy(), np.int64)


def _linear(dense: Dense) -> Linear:
    weights, biases = dense.integers(True)
    return Linear(_matrix(weights), _vector(biases), dense.shift)


def _gru(layer: GruModel) -> GruLayer:
    recurrent, recurrent_biases = layer.recurrent.integers(True)
    return GruLayer(
        tuple(_matrix(dense.integers(True)[0]) for dense in layer.dense_inputs),
        _matrix(recurrent),
        _vector(layer.bias_integers(True)),
        _vector(recurrent_biases),
        _vector(layer.start_integers(True)),
        layer.shift,
    )


def _attention(part: AttentionModel) -> Attention:
    return Attention(_linear(part.query), _linear(part.key), _linear(part.value), part.shift)


def _head(head: HeadModel) -> Head:
    levels = [head.level(number) for number in range(len(head.levels))]
    biases = [_vector(level.biases(True)) for level in levels]
    return Head(
        tuple(_linear(level.project) for level in levels),
        head.sizes,
        biases[0] if head.sizes else np.zeros(0, np.int64),
        biases[-1],
        levels[0].shift,
        levels[1].shift if head.sizes else 0,
    )
