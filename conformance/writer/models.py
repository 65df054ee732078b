"""LAYER, CODEBOOKS, DECODER_MLP and SCENE_MLP blocks (SPEC §7.8, §7.9, §7.11)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

from conformance.writer.fields import varint
from conformance.writer.numbers import Number, numbers_block, signed
from scarfmt.arrays import Ints
from scarfmt.blocks.mlp import Linear
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


def codebooks_block(books: Mapping[int, Ints]) -> bytes:
    """A CODEBOOKS block of (size, d) codewords by number of the book."""
    dimension = max(book.shape[1] for book in books.values())
    out: list[Number] = [(("d",), dimension), (("book_count",), len(books))]
    for number, book in sorted(books.items()):
        out += [(("number",), number), (("size",), len(book))]
        for component, column in enumerate(book.T.tolist()):
            out += signed(("words", component), column)
    return numbers_block(out)


def network_numbers(networks: Sequence[Sequence[Linear]]) -> list[Number]:
    """The numbers of a DECODER_MLP or SCENE_MLP block of networks, each its layers."""
    out: list[Number] = [(("network_count",), len(networks))]
    for layers in networks:
        out.append((("layer_count",), len(layers)))
        for layer in layers:
            out += [(("rows",), layer.weights.shape[0]), (("columns",), layer.weights.shape[1])]
            out += signed(("weights",), layer.weights.ravel().tolist())
            for name, values in (("scales", layer.scales), ("biases", layer.biases)):
                out += [((name,), bits) for bits in values.astype("<f4").view("<u4").tolist()]
    return out
