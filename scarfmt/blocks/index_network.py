"""ENTROPY_NETWORK block: the index network (SPEC §10.5).

The header, then every array in the order of :class:`IndexNetwork`: matrices and start states Rice-coded, biases
too, after the zero bits that they all end in.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.container.bytefields import ByteReader, unsigned_varint
from scarfmt.entropy.rice import pack_rice, pack_shifted, unpack_rice, unpack_shifted
from scarfmt.errors import Malformed
from scarfmt.neural.arithmetic import MAX_WEIGHT, Linear
from scarfmt.neural.network import (
    MAX_CLUSTERS,
    MAX_CODEWORD_DIMS,
    MAX_GRU_LAYERS,
    MAX_HEADS,
    MAX_INPUTS,
    MAX_TOKENS,
    MAX_WIDTH,
    Attention,
    GruLayer,
    Head,
    IndexNetwork,
    Inputs,
)
from scarfmt.scene.codebooks import MAX_CODEWORDS

I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
Ints = NDArray[np.integer[Any]]

_OWN, _ATTENTION = 1, 2
_FIELD = "network"


def pack_network(network: IndexNetwork) -> bytes:
    """The payload of an ENTROPY_NETWORK block, of a network that passes :meth:`IndexNetwork.check`."""
    attention = network.attention
    out = [_pack_header(network), *(_pack_linear(layer) for layer in network.embed)]
    for gru in network.gru:
        out += [bytes([gru.shift]), *(_pack_matrix(matrix) for matrix in (*gru.inputs, gru.recurrent))]
        out += [pack_shifted(array) for array in (gru.biases, gru.recurrent_biases, gru.start)]
    if attention is not None:
        out += [_pack_linear(layer) for layer in (attention.query, attention.key, attention.value)]
        out.append(bytes([attention.shift]))
    out.append(_pack_linear(network.mixer))
    out += [_pack_head(head) for head in network.heads]
    return b"".join(out)


def _pack_header(network: IndexNetwork) -> bytes:
    inputs, first = network.inputs, network.gru[0]
    flags = _OWN * inputs.own | _ATTENTION * (network.attention is not None)
    shifts = bytes([network.activation_bits, flags, inputs.latent_shift, network.codeword_shift])
    columns = (inputs.classes, inputs.attributes, inputs.depths, inputs.latents, inputs.grid)
    widths = (network.codeword_dims, network.embed[0].outputs, network.hidden, network.mixer.outputs)
    counts = (len(network.gru), len(first.biases), len(network.heads))
    return shifts + b"".join(unsigned_varint(n) for n in (*columns, *widths, *counts))


def _pack_matrix(matrix: Ints) -> bytes:
    return pack_rice(matrix.ravel())


def _pack_linear(layer: Linear) -> bytes:
    return bytes([layer.shift]) + _pack_matrix(layer.weights) + pack_shifted(layer.biases)


def _pack_head(head: Head) -> bytes:
    out = [unsigned_varint(n) for n in (len(head.biases), len(head.clusters), *head.clusters)]
    out += [_pack_linear(layer) for layer in head.projections]
    out += [bytes([head.shift, head.member_shift]), pack_shifted(head.cluster_biases), pack_shifted(head.biases)]
    return b"".join(out)


def unpack_network(payload: bytes) -> IndexNetwork:
    """The inverse of :func:`pack_network`; what depends on the codebooks is left to :meth:`IndexNetwork.check`.

    Raises:
        Malformed: ``bad-network`` for a network that breaks SPEC §10.5; ``bad-rice``, ``payload-short``,
            ``payload-long``, ``bad-varint``.
        LimitExceeded: ``count-limit``.
    """
    reader = ByteReader(payload, _FIELD)
    network = _read_network(reader)
    reader.finish()
    network.check_structure()
    return network


def _read_network(reader: ByteReader) -> IndexNetwork:
    bits, flags, latent_shift, codeword_shift = reader.take(4)
    classes, attributes, depths, latents, grid = (reader.count(MAX_INPUTS) for _ in range(5))
    inputs = Inputs(classes, bool(flags & _OWN), attributes, depths, latents, latent_shift, grid)
    dims, first = reader.count(MAX_CODEWORD_DIMS), reader.count(MAX_WIDTH)
    hidden, mixed = reader.count(MAX_WIDTH), reader.count(MAX_WIDTH)
    layers, tokens, heads = reader.count(MAX_GRU_LAYERS), reader.count(MAX_TOKENS), reader.count(MAX_HEADS)
    # Both here, by R-10.5-1. The product of attributes and depths is not bounded by their limits.
    if flags & ~(_OWN | _ATTENTION):
        raise Malformed("bad-network", f"reserved flags in {flags:#x} (SPEC §10.5)", field=_FIELD)
    if inputs.width > MAX_INPUTS:
        raise Malformed("bad-network", f"{inputs.width} input columns, at most {MAX_INPUTS} (SPEC §10.5)", field=_FIELD)
    return IndexNetwork(
        activation_bits=bits,
        inputs=inputs,
        codeword_dims=dims,
        codeword_shift=codeword_shift,
        embed=(_read_linear(reader, first, inputs.width), _read_linear(reader, hidden, first)),
        gru=tuple(
            _read_gru(reader, hidden, hidden if number else dims + 1, 1 if number else heads, 1 if number else tokens)
            for number in range(layers)
        ),
        attention=_read_attention(reader, hidden) if flags & _ATTENTION else None,
        mixer=_read_linear(reader, mixed, 2 * hidden),
        heads=tuple(_read_head(reader, dims + 1, mixed) for _ in range(heads)),
    )


def _read_matrix(reader: ByteReader, rows: int, columns: int) -> I32:
    weights = unpack_rice(reader, rows * columns)
    # Here, as int32 would wrap a weight that the network's own check must see.
    if len(weights) and int(np.abs(weights).max()) > MAX_WEIGHT:
        raise Malformed("bad-network", f"a weight above {MAX_WEIGHT} (SPEC §10.1)", field=_FIELD)
    return weights.reshape(rows, columns).astype(np.int32)


def _read_numbers(reader: ByteReader, *shape: int) -> I64:
    return unpack_shifted(reader, int(np.prod(shape))).reshape(shape)


def _read_linear(reader: ByteReader, rows: int, columns: int) -> Linear:
    shift = reader.take(1)[0]
    return Linear(_read_matrix(reader, rows, columns), _read_numbers(reader, rows), shift)


def _read_gru(reader: ByteReader, hidden: int, columns: int, matrices: int, tokens: int) -> GruLayer:
    shift, rows = reader.take(1)[0], 3 * hidden
    inputs = tuple(_read_matrix(reader, rows, columns) for _ in range(matrices))
    recurrent, biases = _read_matrix(reader, rows, hidden), _read_numbers(reader, tokens, rows)
    return GruLayer(inputs, recurrent, biases, _read_numbers(reader, rows), _read_numbers(reader, hidden), shift)


def _read_attention(reader: ByteReader, hidden: int) -> Attention:
    query, key, value = (_read_linear(reader, hidden, hidden) for _ in range(3))
    return Attention(query, key, value, reader.take(1)[0])


def _read_head(reader: ByteReader, dims: int, mixed: int) -> Head:
    codewords, count = reader.count(MAX_CODEWORDS), reader.count(MAX_CLUSTERS)
    clusters = tuple(reader.count(MAX_CODEWORDS) for _ in range(count))
    projections = tuple(_read_linear(reader, dims, mixed) for _ in range(2 if clusters else 1))
    shift, member_shift = reader.take(2)
    cluster_biases, biases = _read_numbers(reader, count), _read_numbers(reader, codewords)
    return Head(projections, clusters, cluster_biases, biases, shift, member_shift)
