"""LAYER block: entropy mode, channel table and context (layer 1 only), one row of the layer table (SPEC §7.11)."""

from __future__ import annotations

import struct

from scarfmt.container.bytefields import ByteReader, signed_varint, unsigned_varint
from scarfmt.container.schema import Stream
from scarfmt.errors import Malformed, Unsupported
from scarfmt.scene.model import (
    CHANNEL_STREAMS,
    MAX_CHANNELS,
    MAX_CLASSES,
    MAX_COMPONENTS,
    MAX_DEPTHS,
    Channel,
    ContextRule,
    DecodedContext,
    LayerRow,
)

STATIC, NEURAL = 0, 1
"""Entropy modes: what codes INDICES, static tables or the index network (SPEC §10.4)."""

Opening = tuple[tuple[Channel, ...], DecodedContext]
"""What only the LAYER block of layer 1 says."""


def pack_layer(row: LayerRow, opening: Opening | None) -> bytes:
    """The payload of a LAYER block; `opening` exactly in layer 1."""
    out = [bytes([NEURAL if row.neural else STATIC])]
    if opening is not None:
        channels, context = opening
        out.append(unsigned_varint(len(channels)))
        out += [_pack_channel(channel) for channel in channels]
        out += [bytes([context.passes_log2]), unsigned_varint(len(context.occupancies))]
        out += [unsigned_varint(target) for target in context.occupancies]
    out.append(unsigned_varint(row.class_count))
    for stages, steps in zip(row.stages, row.steps, strict=True):
        out.append(bytes([stages, *steps]))
    return b"".join(out)


def _pack_channel(channel: Channel) -> bytes:
    out = [bytes([channel.stream, channel.components])]
    for width, rule in zip(channel.first_width, channel.rules, strict=True):
        out.append(struct.pack("<d", width))
        out.append(bytes([rule.by_class, rule.source_channel, rule.source_component, rule.shift]))
        out.append(signed_varint(rule.low))
    return b"".join(out)


def unpack_layer(payload: bytes, layer: int, opening: Opening) -> tuple[LayerRow, Opening]:
    """The inverse of :func:`pack_layer`.

    Args:
        layer: 1-based; channels and context are read in layer 1.
        opening: what layer 1 said, for later layers.

    Raises:
        Unsupported: ``unsupported-entropy-mode``.
        Malformed: ``bad-channel``, or a payload that is too short or too long.
    """
    reader = ByteReader(payload, f"layer {layer}")
    mode = reader.take(1)[0]
    if mode not in (STATIC, NEURAL):
        raise Unsupported("unsupported-entropy-mode", f"entropy mode {mode} needs a newer reader", field="entropy_mode")
    if layer == 1:
        channels = tuple(_read_channel(reader) for _ in range(reader.count(MAX_CHANNELS)))
        opening = channels, _read_context(reader)
    stages, steps = [], []
    for _ in range(reader.count(MAX_CLASSES)):
        stages.append(reader.take(1)[0])
        steps.append(tuple(reader.take(len(opening[0]))))
    reader.finish()
    return LayerRow(tuple(stages), tuple(steps), mode == NEURAL), opening


def _read_context(reader: ByteReader) -> DecodedContext:
    passes_log2 = reader.take(1)[0]
    return DecodedContext(passes_log2, tuple(reader.unsigned(16) for _ in range(reader.count(MAX_DEPTHS))))


def _read_channel(reader: ByteReader) -> Channel:
    stream, components = reader.take(2)
    if stream not in CHANNEL_STREAMS or not 1 <= components <= MAX_COMPONENTS:
        raise Malformed("bad-channel", f"no channel has stream {stream} and {components} components", field="channels")
    widths, rules = [], []
    for _ in range(components):
        widths.append(struct.unpack("<d", reader.take(8))[0])
        by_class, source_channel, source_component, shift = reader.take(4)
        if by_class > 1:
            raise Malformed("bad-channel", "by_class is not 0 or 1 (SPEC §8.4)", field="channels")
        rules.append(ContextRule(bool(by_class), source_channel, source_component, reader.signed(33), shift))
    return Channel(Stream(stream), tuple(widths), tuple(rules))
