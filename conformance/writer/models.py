"""LAYER, CODEBOOKS, DECODER_MLP and SCENE_MLP blocks (SPEC §7.8, §7.9, §7.11)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

from conformance.writer.fields import PLAIN, RiceStyle, rice, varint
from scarfmt.arrays import Ints
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.scene.model import Channel, DecodedContext, LayerRow

Opening = tuple[Sequence[Channel], DecodedContext]
"""The fields that only the LAYER block of layer 1 has: the channels, and how decoded values are summed up."""


def layer_block(row: LayerRow, opening: Opening | None) -> bytes:
    """The LAYER block of a row of the layer table; `opening` in layer 1 alone."""
    return bytes([row.neural]) + (_opening(*opening) if opening else b"") + _classes(row)


def _opening(channels: Sequence[Channel], context: DecodedContext) -> bytes:
    targets = context.occupancies
    parts = [varint(len(channels)), *map(_channel, channels), bytes([context.passes_log2])]
    return b"".join([*parts, varint(len(targets)), *map(varint, targets)])


def _channel(channel: Channel) -> bytes:
    return struct.pack(f"<2B{channel.components}d", channel.stream, channel.components, *channel.first_width)


def _classes(row: LayerRow) -> bytes:
    states = (bytes([stages, *steps]) for stages, steps in zip(row.stages, row.steps, strict=True))
    return varint(len(row.stages)) + b"".join(states)


def codebooks_block(books: Mapping[int, Ints], style: RiceStyle = PLAIN) -> bytes:
    """A CODEBOOKS block of (size, d) codewords by number of the book."""
    dimension = max(book.shape[1] for book in books.values())
    out = [varint(dimension), varint(len(books))]
    for number, book in sorted(books.items()):
        out += [bytes([number]), varint(len(book)), *(rice(column, style) for column in book.T.tolist())]
    return b"".join(out)


def networks_content(networks: Sequence[QuantisedMlp], *, wide: bool) -> bytes:
    """The content of a DECODER_MLP or SCENE_MLP block; `wide`: two bytes a weight always."""
    return varint(len(networks)) + b"".join(_network(network, wide) for network in networks)


def _network(network: QuantisedMlp, wide: bool) -> bytes:
    return varint(len(network.layers)) + b"".join(_linear(layer, wide) for layer in network.layers)


def _linear(layer: Linear, wide: bool) -> bytes:
    rows, columns = layer.weights.shape
    weights = [int(weight) for weight in layer.weights.ravel()]
    width = 2 if wide or min(weights) < -128 or max(weights) > 127 else 1
    packed = struct.pack(f"<{len(weights)}{'bh'[width - 1]}", *weights)
    scales, biases = (struct.pack(f"<{rows}f", *numbers) for numbers in (layer.scales, layer.biases))
    return b"".join([varint(rows), varint(columns), bytes([width]), packed, scales, biases])
