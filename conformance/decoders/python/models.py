"""LAYER, CODEBOOKS and DECODER_MLP blocks (SPEC §6.4, §6.5, §7.8, §7.9, §7.11)."""

from __future__ import annotations

from typing import NamedTuple

from conformance.decoders.python.fields import Payload, require, stored


class Rule(NamedTuple):
    """A context rule (SPEC §8.4)."""

    by_class: int
    source_channel: int
    source_component: int
    shift: int
    low: int


class Channel(NamedTuple):
    """A row of the channel table (SPEC §6.4)."""

    stream: int
    first_widths: list[float]
    rules: list[Rule]


class Row(NamedTuple):
    """A row of the layer table: per class its stages and steps (SPEC §6.5)."""

    mode: int
    classes: list[tuple[int, list[int]]]


class Opening(NamedTuple):
    """The fields that only the LAYER block of layer 1 has (SPEC §7.11)."""

    channels: list[Channel]
    passes_log2: int
    targets: list[int]


def parse_layer(block: bytes, k: int, opening: Opening) -> tuple[Row, Opening]:
    reader = Payload(block)
    mode = reader.u8()
    require(mode in (0, 1), "unsupported-entropy-mode")
    if k == 1:
        channels = []
        for _ in range(reader.count(8)):
            stream, components = reader.fields("BB")
            channel = Channel(stream, [], [])
            for _ in range(components):
                channel.first_widths.append(reader.fields("d")[0])
                by_class, source, component, shift = reader.fields("4B")
                channel.rules.append(Rule(by_class, source, component, shift, reader.svarint(33)))
            channels.append(channel)
        passes_log2 = reader.u8()
        opening = Opening(channels, passes_log2, [reader.varint(16) for _ in range(reader.count(4))])
    classes = [(reader.u8(), list(reader.take(len(opening.channels)))) for _ in range(reader.count(15))]
    reader.finish()
    return Row(mode, classes), opening


def parse_codebooks(block: bytes) -> dict[int, list[list[int]]]:
    reader = Payload(block)
    d = reader.count(64)
    books: dict[int, list[list[int]]] = {}
    for _ in range(reader.count(2)):
        number, size = reader.u8(), reader.count(4096)
        require(number <= 1 and number > max(books, default=-1) and size > 0 and d > 0, "bad-codebook")
        columns = []
        for _ in range(d):
            columns.append(reader.rice(size))
            require(max(map(abs, columns[-1])) <= 65535, "bad-codebook")
        books[number] = [list(word) for word in zip(*columns, strict=True)]
    require(bool(books), "bad-codebook")
    reader.finish()
    return books


def network_inputs(block: bytes) -> int:
    """Inputs of the one network of a DECODER_MLP block."""
    reader = Payload(stored(block))
    require(reader.count(8) == 1, "bad-mlp")
    reader.count(4)
    reader.count(1024)
    return reader.count(1024)
