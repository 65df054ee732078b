"""ENTROPY_NETWORK block: the index network (SPEC §10.5).

One zstd frame: the header, then every array in the order of :class:`IndexNetwork`. A matrix is int8, or int16
where a weight needs it; biases and start states are signed varints.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.bytefields import ByteReader, compress, decompress, signed_varint, unsigned_varint
from scarfmt.codecs.codebooks import MAX_CODEWORDS
from scarfmt.errors import Malformed
from scarfmt.neural.arithmetic import Linear
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

I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
Ints = NDArray[np.integer[Any]]

MAX_NETWORK_BYTES = 8 << 20
_OWN, _ATTENTION = 1, 2
_BIAS_BITS = 32
_FIELD = "network"


def pack_network(network: IndexNetwork) -> bytes:
    """The payload of an ENTROPY_NETWORK block, of a network that passes :meth:`IndexNetwork.check`."""
    attention = network.attention
    out = [_pack_header(network), *(_pack_linear(layer) for layer in network.embed)]
    for gru in network.gru:
        out += [bytes([gru.shift]), *(_pack_matrix(matrix) for matrix in (*gru.inputs, gru.recurrent))]
        out += [_pack_numbers(array) for array in (gru.biases, gru.recurrent_biases, gru.start)]
    if attention is not None:
        out += [_pack_linear(layer) for layer in (attention.query, attention.key, attention.value)]
        out.append(bytes([attention.shift]))
    out.append(_pack_linear(network.mixer))
    out += [_pack_head(head) for head in network.heads]
    return compress(b"".join(out))


def _pack_header(network: IndexNetwork) -> bytes:
    inputs, first = network.inputs, network.gru[0]
    flags = _OWN * inputs.own | _ATTENTION * (network.attention is not None)
    shifts = bytes([network.activation_bits, flags, inputs.latent_shift, network.codeword_shift])
    columns = (inputs.classes, inputs.attributes, inputs.depths, inputs.latents, inputs.grid)
    widths = (network.codeword_dims, network.embed[0].outputs, network.hidden, network.mixer.outputs)
    counts = (len(network.gru), len(first.biases), len(network.heads))
    return shifts + b"".join(unsigned_varint(n) for n in (*columns, *widths, *counts))


def _pack_matrix(matrix: Ints) -> bytes:
    wide = int(np.abs(matrix.astype(np.int64)).max(initial=0)) > 127
    return bytes([1 + wide]) + matrix.astype("<i2" if wide else "<i1").tobytes()


def _pack_numbers(values: Ints) -> bytes:
    return b"".join(signed_varint(value) for value in values.ravel().tolist())


def _pack_linear(layer: Linear) -> bytes:
    return bytes([layer.shift]) + _pack_matrix(layer.weights) + _pack_numbers(layer.biases)


def _pack_head(head: Head) -> bytes:
    out = [unsigned_varint(n) for n in (len(head.biases), len(head.clusters), *head.clusters)]
    out += [_pack_linear(layer) for layer in head.projections]
    out += [bytes([head.shift, head.member_shift]), _pack_numbers(head.cluster_biases), _pack_numbers(head.biases)]
    return b"".join(out)


def unpack_network(payload: bytes, limit: int = MAX_NETWORK_BYTES) -> IndexNetwork:
    """The inverse of :func:`pack_network`; what depends on the codebooks is left to :meth:`IndexNetwork.check`.

    Raises:
        Malformed: ``bad-network`` for a network that breaks SPEC §10.5; ``bad-zstd``, ``payload-short``,
            ``payload-long``, ``bad-varint``.
        LimitExceeded: ``content-limit``, ``count-limit``.
    """
    reader = ByteReader(decompress(payload, limit, _FIELD), _FIELD)
    network = _read_network(reader)
    reader.finish()
    network.check_structure()
    return network


def _read_network(reader: ByteReader) -> IndexNetwork:
    bits, flags, latent_shift, codeword_shift = reader.take(4)
    if flags & ~(_OWN | _ATTENTION):
        raise Malformed("bad-network", f"reserved flags in {flags:#x} (SPEC §10.5)", field=_FIELD)
    classes, attributes, depths, latents, grid = (reader.count(MAX_INPUTS) for _ in range(5))
    inputs = Inputs(classes, bool(flags & _OWN), attributes, depths, latents, latent_shift, grid)
    dims, first = reader.count(MAX_CODEWORD_DIMS), reader.count(MAX_WIDTH)
    hidden, mixed = reader.count(MAX_WIDTH), reader.count(MAX_WIDTH)
    layers, tokens, heads = reader.count(MAX_GRU_LAYERS), reader.count(MAX_TOKENS), reader.count(MAX_HEADS)
    # Checked before anything is read for it: the product of attributes and depths is not bounded by their limits.
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
    width = reader.take(1)[0]
    if width not in (1, 2):
        raise Malformed("bad-network", f"weights of {width} bytes, neither 1 nor 2 (SPEC §10.5)", field=_FIELD)
    weights = reader.array("<i2" if width == 2 else "<i1", rows * columns)
    return weights.reshape(rows, columns).astype(np.int32)


def _read_numbers(reader: ByteReader, *shape: int) -> I64:
    count = int(np.prod(shape))
    return np.array([reader.signed(_BIAS_BITS) for _ in range(count)], np.int64).reshape(shape)


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
