"""PREDICTORS, ENTROPY_NETWORK and HASH_GRID blocks (SPEC §10.3, §10.5, §10.6)."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from conformance.writer.fields import PLAIN, RiceStyle, rice, shifted, varint
from scarfmt.arrays import Ints
from scarfmt.entropy.rans import FrequencyTable, RansEncoder
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.network import Attention, GruLayer, Head, IndexNetwork
from scarfmt.neural.predictors import Predictor

CLASS_COLUMNS = 15
OWN, ATTENTION = 1, 2


def predictors_block(
    predictors: Sequence[Predictor], class_columns: int = 0, style: RiceStyle = PLAIN
) -> bytes:
    """A PREDICTORS block; each stores the class columns up to the last with a weight, `class_columns` at least."""
    records = (_predictor(predictor, class_columns, style) for predictor in predictors)
    return varint(len(predictors)) + b"".join(records)


def _predictor(predictor: Predictor, class_columns: int, style: RiceStyle) -> bytes:
    hidden, output = predictor.hidden, predictor.output
    layers = [output] if hidden is None else [hidden, output]
    units = 0 if hidden is None else len(hidden.weights)
    used = [c + 1 for c in range(CLASS_COLUMNS) if any(layer.weights[:, c].any() for layer in layers)]
    classes = max([class_columns, *used])
    inputs = output.weights.shape[1] - units
    buckets = [size - 1 for size in predictor.buckets]
    head = bytes([predictor.stream, predictor.component, predictor.step, *buckets, classes, inputs, units])
    return head + b"".join(_predictor_layer(layer, classes, style) for layer in layers)


def _predictor_layer(layer: Linear, classes: int, style: RiceStyle) -> bytes:
    stored = [weight for row in layer.weights.tolist() for weight in row[:classes] + row[CLASS_COLUMNS:]]
    return bytes([layer.shift]) + rice(stored, style) + shifted(layer.biases.tolist(), style)


def network_block(network: IndexNetwork, style: RiceStyle = PLAIN) -> bytes:
    """An ENTROPY_NETWORK block."""
    out = [_network_head(network), *(_linear(layer, style) for layer in network.embed)]
    out += [_recurrent(layer, style) for layer in network.gru]
    if network.attention is not None:
        out.append(_attention(network.attention, style))
    out.append(_linear(network.mixer, style))
    out += [_head(head, style) for head in network.heads]
    return b"".join(out)


def _network_head(network: IndexNetwork) -> bytes:
    inputs = network.inputs
    flags = (OWN if inputs.own else 0) | (ATTENTION if network.attention is not None else 0)
    first, second = network.embed
    numbers = [
        *(inputs.classes, inputs.attributes, inputs.depths, inputs.latents, inputs.grid),
        *(network.codeword_dims, len(first.weights), len(second.weights), len(network.mixer.weights)),
        *(len(network.gru), len(network.gru[0].biases), len(network.heads)),
    ]
    shifts = bytes([network.activation_bits, flags, inputs.latent_shift, network.codeword_shift])
    return shifts + b"".join(map(varint, numbers))


def _matrix(matrix: Ints, style: RiceStyle) -> bytes:
    return rice(matrix.ravel().tolist(), style)


def _numbers(numbers: Ints, style: RiceStyle) -> bytes:
    return shifted(numbers.ravel().tolist(), style)


def _linear(layer: Linear, style: RiceStyle) -> bytes:
    return bytes([layer.shift]) + _matrix(layer.weights, style) + _numbers(layer.biases, style)


def _recurrent(layer: GruLayer, style: RiceStyle) -> bytes:
    out = [bytes([layer.shift]), *(_matrix(matrix, style) for matrix in (*layer.inputs, layer.recurrent))]
    out += [_numbers(numbers, style) for numbers in (layer.biases, layer.recurrent_biases, layer.start)]
    return b"".join(out)


def _attention(attention: Attention, style: RiceStyle) -> bytes:
    layers = (attention.query, attention.key, attention.value)
    return b"".join(_linear(layer, style) for layer in layers) + bytes([attention.shift])


def _head(head: Head, style: RiceStyle) -> bytes:
    out = [varint(number) for number in (len(head.biases), len(head.clusters), *head.clusters)]
    out += [_linear(layer, style) for layer in head.projections]
    out += [bytes([head.shift, head.member_shift])]
    out += [_numbers(head.cluster_biases, style), _numbers(head.biases, style)]
    return b"".join(out)


def grid_block(grid: HashGrid, ones: int | None) -> bytes:
    """A HASH_GRID block; `ones` of every level, or None for the nearest to its share of bits that are 1."""
    numbers = [*grid.origin, grid.extent_bits, len(grid.levels)]
    for level in grid.levels:
        numbers += [level.plane, level.resolution, level.table_log2, level.features]
    return b"".join([*map(varint, numbers), *(_level(bits.ravel(), ones) for bits in grid.bits)])


def _level(bits: Ints, ones: int | None) -> bytes:
    share = (512 * int(bits.sum()) + len(bits)) // (2 * len(bits)) if ones is None else ones
    share = min(max(share, 1), 255)
    encoder = RansEncoder()
    encoder.encode(bits, FrequencyTable.from_weights(np.array([256 - share, share])))
    stream = encoder.finish()
    return bytes([share]) + struct.pack("<I", len(stream)) + stream
