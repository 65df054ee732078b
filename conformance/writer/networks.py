"""PREDICTORS, ENTROPY_NETWORK and HASH_GRID blocks (SPEC §10.3, §10.5, §10.6)."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Sequence

import numpy as np

from conformance.writer.fields import varint
from conformance.writer.numbers import Number, numbers_block, shifted, signed
from scarfmt.arrays import Ints
from scarfmt.entropy.rans import FrequencyTable, RansEncoder
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.network import GruLayer, Head, IndexNetwork
from scarfmt.neural.predictors import Predictor

CLASS_COLUMNS = 15
OWN, ATTENTION = 1, 2


def predictors_block(predictors: Sequence[Predictor], class_columns: int = 0) -> bytes:
    """A PREDICTORS block; each stores the class columns up to the last with a weight, `class_columns` at least."""
    records = (_predictor(predictor, class_columns) for predictor in predictors)
    return numbers_block([(("predictor_count",), len(predictors)), *itertools.chain.from_iterable(records)])


def _predictor(predictor: Predictor, class_columns: int) -> list[Number]:
    hidden, output = predictor.hidden, predictor.output
    layers = [output] if hidden is None else [hidden, output]
    units = 0 if hidden is None else len(hidden.weights)
    used = [c + 1 for c in range(CLASS_COLUMNS) if any(layer.weights[:, c].any() for layer in layers)]
    classes = max([class_columns, *used])
    one, two = predictor.buckets
    out = _named(
        stream=int(predictor.stream), component=predictor.component, step=predictor.step, b1=one - 1, b2=two - 1,
        classes=classes, inputs=output.weights.shape[1] - units, units=units)
    for layer in layers:
        stored = [weight for row in layer.weights.tolist() for weight in row[:classes] + row[CLASS_COLUMNS:]]
        out += [*_named(shift=layer.shift), *signed(("weights",), stored), *shifted("biases", layer.biases.tolist())]
    return out


def _named(**numbers: int) -> list[Number]:
    return [((name,), number) for name, number in numbers.items()]


def network_block(network: IndexNetwork) -> bytes:
    """An ENTROPY_NETWORK block."""
    out = _network_head(network)
    for layer in network.embed:
        out += _linear(layer)
    for recurrent in network.gru:
        out += _recurrent(recurrent)
    attention = network.attention
    if attention is not None:
        for layer in (attention.query, attention.key, attention.value):
            out += _linear(layer)
        out += _named(score_shift=attention.shift)
    out += _linear(network.mixer)
    for head in network.heads:
        out += _head(head)
    return numbers_block(out)


def _network_head(network: IndexNetwork) -> list[Number]:
    inputs = network.inputs
    first, second = network.embed
    return _named(
        activation_bits=network.activation_bits, flags=OWN * inputs.own | ATTENTION * (network.attention is not None),
        latent_shift=inputs.latent_shift, codeword_shift=network.codeword_shift, classes=inputs.classes,
        attributes=inputs.attributes, depths=inputs.depths, latents=inputs.latents, grid=inputs.grid,
        codeword_dims=network.codeword_dims, embed_width=len(first.weights), hidden=len(second.weights),
        mixed=len(network.mixer.weights), gru_count=len(network.gru),
        tokens=len(network.gru[0].biases) if network.gru else 0, head_count=len(network.heads))


def _matrix(matrix: Ints) -> list[Number]:
    return signed(("numbers",), matrix.ravel().tolist())


def _shifted(**arrays: Ints) -> list[Number]:
    return [number for name, array in arrays.items() for number in shifted(name, array.ravel().tolist())]


def _linear(layer: Linear) -> list[Number]:
    return [*_named(shift=layer.shift), *_matrix(layer.weights), *_shifted(biases=layer.biases)]


def _recurrent(layer: GruLayer) -> list[Number]:
    matrices = (number for matrix in (*layer.inputs, layer.recurrent) for number in _matrix(matrix))
    biases = _shifted(bi=layer.biases, bh=layer.recurrent_biases, start=layer.start)
    return [*_named(shift=layer.shift), *matrices, *biases]


def _head(head: Head) -> list[Number]:
    out = _named(size=len(head.biases), cluster_count=len(head.clusters))
    out += [(("clusters",), size) for size in head.clusters]
    for layer in head.projections:
        out += _linear(layer)
    out += _named(shift=head.shift, member_shift=head.member_shift)
    return [*out, *_shifted(cluster_biases=head.cluster_biases, biases=head.biases)]


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
