"""The invalid vectors of LAYER blocks: channel table, context rules, layer table (SPEC §6.4, §6.5, §7.11, §8.4)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from conformance.scenes.made import Plan, build, steady
from conformance.surgery.files import changed, vector_file
from conformance.writer.models import layer_block
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.scene.model import Channel, ContextRule, LayerRow, SceneModel

File = tuple[bytes, QuantisedScene]
Fault = tuple[str, str, str, str, bytes]
"""(name, what is wrong, rule, refusal id, file)."""
_CHANNELS = "R-6.4-1", "bad-channel"
_STEP = "R-6.4-3", "bad-channel"
_SOURCE = "R-8.4-1", "bad-channel"
_RECORD = "R-7.11-2", "bad-channel"
_ROWS = "R-6.5-2", "bad-layer-table"
_LIMIT = "count-limit"
_NO_STREAM = 0


def layer_faults(explicit: File, anchor: File, static: File) -> Iterator[Fault]:
    """Files with a broken LAYER block.

    Args:
        explicit: with every channel of its profile, and three layers.
        anchor: with every channel of its profile.
        static: with SCALE only, one class and a stage in layer 1.
    """
    yield from _channel_faults(explicit, anchor)
    yield from _step_faults(static)
    yield from _rule_faults(explicit, anchor)
    yield from _row_faults(explicit, anchor)
    yield from _number_faults(static)
    yield from _mode_faults(explicit)


def _with_channels(file: File, *channels: Channel) -> bytes:
    """The file with another channel table; rows keep the steps of the channels that stay, others get 1."""
    data, scene = file
    model = replace(scene.model, channels=channels)
    for layer in range(1, len(model.layers) + 1):
        data = _with_row(data, model, layer, _row_of(scene.model, channels, layer))
    return data


def _row_of(model: SceneModel, channels: tuple[Channel, ...], layer: int) -> LayerRow:
    """The row of `layer` for some of the channels of `model`, or others."""
    row, kept = model.layers[layer - 1], {channel.stream: index for index, channel in enumerate(model.channels)}
    steps = tuple(tuple(have[kept[c.stream]] if c.stream in kept else 1 for c in channels) for have in row.steps)
    return replace(row, steps=steps)


def _with_row(data: bytes, model: SceneModel, layer: int, row: LayerRow) -> bytes:
    opening = (model.channels, model.context) if layer == 1 else None
    growth = row.class_count - model.layers[layer - 1].class_count
    return changed(data, BlockKind.LAYER, layer, lambda _: layer_block(row, opening), growth)


def _of(channel: Channel, components: int) -> Channel:
    """The channel with so many components, all as the first."""
    return Channel(channel.stream, channel.first_width[:1] * components, (ContextRule(False),) * components)


def _channel_faults(explicit: File, anchor: File) -> Iterator[Fault]:
    residual, scale, rotation, opacity, colour, latent = explicit[1].model.channels
    plain = {c.stream: _of(c, c.components) for c in anchor[1].model.channels}
    offsets, scales = plain[Stream.OFFSETS], plain[Stream.SCALE]
    three = _of(scale, 3)
    yield ("channels-nine", "nine channels", "R-6.4-1", _LIMIT,
           _with_channels(explicit, residual, three, rotation, opacity, colour, latent, latent, latent, latent))
    yield "channels-none", "no channel", *_CHANNELS, _with_channels(explicit)
    yield "channel-twice", "two channels SCALE", *_CHANNELS, _with_channels(explicit, three, three)
    yield "channel-no-scale", "no channel SCALE", *_CHANNELS, _with_channels(explicit, _of(opacity, 1))
    yield "channel-offsets", "OFFSETS in the explicit profile", *_CHANNELS, _with_channels(explicit, three, offsets)
    yield ("channel-rotation", "ROTATION in the anchor profile", *_CHANNELS,
           _with_channels(anchor, scales, _of(rotation, 3), plain[Stream.LATENT], offsets))
    yield ("channel-no-offsets", "the anchor profile without OFFSETS", *_CHANNELS,
           _with_channels(anchor, scales, plain[Stream.LATENT]))
    yield ("channel-anchor-no-scale", "the anchor profile without SCALE", *_CHANNELS,
           _with_channels(anchor, plain[Stream.LATENT], offsets))
    yield "scale-four", "SCALE of four components", "R-6.4-2", "bad-channel", _with_channels(explicit, _of(scale, 4))
    yield ("opacity-two", "OPACITY of two components", "R-6.4-2", "bad-channel",
           _with_channels(explicit, three, _of(opacity, 2)))
    yield ("scale-three-anchor", "SCALE of three components in the anchor profile", "R-6.4-2", "bad-channel",
           _with_channels(anchor, _of(scale, 3), plain[Stream.LATENT], offsets))
    for name, channel in (("residual-two", _of(residual, 2)), ("rotation-four", _of(rotation, 4)),
                          ("colour-two", _of(colour, 2))):
        others = (channel, three) if channel.stream < Stream.SCALE else (three, channel)
        yield (name, f"{channel.stream.name} of {channel.components} components", "R-6.4-2", "bad-channel",
               _with_channels(explicit, *others))
    yield ("offsets-two", "OFFSETS of two components", "R-6.4-2", "bad-channel",
           _with_channels(anchor, scales, plain[Stream.LATENT], _of(offsets, 2)))
    for name, channel in (("opacity", _of(opacity, 1)), ("colour", _of(colour, 3))):
        yield (f"channel-{name}", f"{channel.stream.name} in the anchor profile", *_CHANNELS,
               _with_channels(anchor, scales, channel, plain[Stream.LATENT], offsets))
    yield from _latent_faults(explicit, anchor, three)


def _latent_faults(explicit: File, anchor: File, three: Channel) -> Iterator[Fault]:
    """LATENT of another size than DECODER_MLP takes, with codebooks of the right size and without any."""
    rule = "R-6.4-4", "bad-mlp"
    latent = next(c for c in explicit[1].model.channels if c.stream == Stream.LATENT)
    *others, offsets = (_of(c, c.components) for c in anchor[1].model.channels if c.stream != Stream.POSITION_RESIDUAL)
    scales, features = others
    scene = build(Plan("latent alone", (three, _of(latent, 3)), steady(1, 0, (1, 1)), (Tile(0, 0, 0),), (4,), bits=5,
                       dimension=3))  # fmt: skip
    alone = vector_file(scene), scene
    for name, more in (("wide", 1), ("narrow", -1)):
        purpose = f"LATENT of a component {'more' if more > 0 else 'less'} than DECODER_MLP takes"
        yield (f"latent-{name}", purpose, *rule, _with_channels(explicit, three, _of(latent, latent.components + more)))
        yield (f"latent-{name}-anchor", f"{purpose}, anchor profile", *rule,
               _with_channels(anchor, scales, _of(features, features.components + more), offsets))
        yield (f"latent-{name}-alone", f"{purpose}, no codebooks", *rule,
               _with_channels(alone, three, _of(latent, 3 + more)))


def _step_faults(static: File) -> Iterator[Fault]:
    scale = static[1].model.channels[0]
    above = math.nextafter(2.0**96, math.inf)
    for name, what, width in (
        ("zero", "0", 0.0), ("negative", "-1", -1.0), ("nan", "not a number", math.nan),
        ("infinite", "infinite", math.inf), ("large", "the next number above 2^96", above),
    ):
        channel = replace(scale, first_width=(*scale.first_width[:2], width))
        yield f"step-{name}", f"a step that is {what}", *_STEP, _with_channels(static, channel)


def _rule_faults(explicit: File, anchor: File) -> Iterator[Fault]:
    def scaled(rule: ContextRule) -> bytes:
        """SCALE is channel 1; its component 1 gets this rule."""
        residual, scale, *others = explicit[1].model.channels
        rules = (scale.rules[0], rule, scale.rules[2])
        return _with_channels(explicit, residual, replace(scale, rules=rules), *others)

    def offset(rule: ContextRule) -> bytes:
        *others, offsets = anchor[1].model.channels
        return _with_channels(anchor, *others, replace(offsets, rules=(offsets.rules[0], rule, offsets.rules[2])))

    for name, what, rule in (
        ("self", "itself", ContextRule(False, 1, 1)),
        ("component-later", "the component after it", ContextRule(False, 1, 2)),
        ("channel-later", "a channel after it", ContextRule(False, 3, 0)),
        ("channel-missing", "a channel that there is not", ContextRule(False, 254, 0)),
        ("component-missing", "a component that its channel has not", ContextRule(False, 0, 3)),
    ):
        yield f"source-{name}", f"a context rule whose source is {what}", *_SOURCE, scaled(rule)
    yield "source-shift", "a context rule that shifts by 32", *_SOURCE, scaled(ContextRule(False, 1, 0, 0, 32))
    last = len(anchor[1].model.channels) - 1
    yield "source-of-offsets", "OFFSETS with a source", *_SOURCE, offset(ContextRule(False, 0, 0))
    yield "source-offsets", "OFFSETS as the source of OFFSETS", *_SOURCE, offset(ContextRule(False, last, 0))
    for name, rule in (
        ("component", ContextRule(False, 255, 1)), ("low", ContextRule(False, 255, 0, -1)),
        ("shift", ContextRule(False, 255, 0, 0, 1)),
    ):
        yield f"no-source-{name}", f"a rule without a source, but with a {name}", *_SOURCE, scaled(rule)


def _row_faults(explicit: File, anchor: File) -> Iterator[Fault]:
    def row(layer: int, file: File = explicit, /, **fields: Any) -> bytes:
        data, scene = file
        return _with_row(data, scene.model, layer, replace(scene.model.layers[layer - 1], **fields))

    third = explicit[1].model.layers[2]
    channels = len(explicit[1].model.channels)
    wide = tuple((1,) * channels for _ in range(16))
    yield "classes-sixteen", "sixteen classes", "R-6.5-2", _LIMIT, row(3, stages=(8,) * 16, steps=wide)
    yield "classes-none", "no class", *_ROWS, row(1, stages=(), steps=())
    yield ("classes-taken-back", "fewer classes than in the layer before", *_ROWS,
           row(3, stages=third.stages[:1], steps=third.steps[:1]))
    yield "stages-nine", "nine stages", *_ROWS, row(3, stages=(9, *third.stages[1:]))
    yield "stages-taken-back", "a class has fewer stages than before", *_ROWS, row(3, stages=(1, *third.stages[1:]))
    steps = third.steps[0]
    yield "steps-21", "twenty-one steps", *_ROWS, row(3, steps=((*steps[:1], 21, *steps[2:]), *third.steps[1:]))
    opening = anchor[1].model.layers[0]
    for number in (0, 2):
        yield (f"offsets-steps-{number}", f"OFFSETS in {number} steps", "R-6.5-3", "bad-layer-table",
               _with_offset_steps(anchor, number))
    latent = anchor[1].model.channel_index(Stream.LATENT)
    bare = tuple(tuple(0 if i == latent else n for i, n in enumerate(have)) for have in opening.steps)
    yield ("anchor-no-feature", "neither a stage nor a step of LATENT in layer 1 of the anchor profile", "R-6.5-4",
           "bad-layer-table", row(1, anchor, stages=(0,) * opening.class_count, steps=bare))


def _with_offset_steps(anchor: File, number: int) -> bytes:
    """The file whose first class has so many steps of OFFSETS, in every layer."""
    data, scene = anchor
    for layer, row in enumerate(scene.model.layers, start=1):
        steps = ((*row.steps[0][:-1], number), *row.steps[1:])
        data = _with_row(data, scene.model, layer, replace(row, steps=steps))
    return data


def _mode_faults(explicit: File) -> Iterator[Fault]:
    rule = "R-7.11-1", "unsupported-entropy-mode"
    data, _ = explicit
    yield ("entropy-mode-255", "entropy mode 255 in layer 2", *rule,
           changed(data, BlockKind.LAYER, 2, lambda p: b"\xff" + p[1:]))
    yield ("entropy-mode-first", "an entropy mode that is not assigned, and nothing after it", *rule,
           changed(data, BlockKind.LAYER, 1, lambda _: b"\2"))


def _number_faults(static: File) -> Iterator[Fault]:
    data, scene = static
    channel = scene.model.channels[0]
    block = layer_block(scene.model.layers[0], (scene.model.channels, scene.model.context))
    # entropy mode, channel count, then stream, components, step (8), by_class, source channel, component, shift, low.
    stream, components, by_class, low = 2, 3, 12, 16
    assert block[stream] == channel.stream
    assert block[by_class : low + 1] == bytes([0, 255, 0, 0, 0])

    def at(place: int, value: bytes, length: int = 1) -> bytes:
        return changed(data, BlockKind.LAYER, 1, lambda p: p[:place] + value + p[place + length :])

    for value, name in ((_NO_STREAM, "no stream kind"), (Stream.INDICES, "INDICES"), (Stream.FRAMING, "FRAMING")):
        yield f"channel-stream-{int(value)}", f"a channel of {name}", *_RECORD, at(stream, bytes([value]))
    yield "components-0", "a channel without components", *_RECORD, at(components, b"\0")
    yield "components-65", "a channel of 65 components", *_RECORD, at(components, bytes([65]))
    yield "by-class-2", "by_class is 2", *_RECORD, at(by_class, b"\2")
    yield ("low-34-bits", "a number of 34 bits where 33 are allowed", "R-5.7-1", "bad-varint",
           at(low, bytes([0x80, 0x80, 0x80, 0x80, 0x20])))
    yield ("low-six-bytes", "a varint(33) of six bytes", "R-5.7-1", "bad-varint",
           at(low, bytes([0x80, 0x80, 0x80, 0x80, 0x80, 1])))
    yield ("count-63-bits", "a count of 2^63", "R-5.7-1", "bad-varint", at(1, b"\x80" * 9 + b"\1"))
    yield ("count-2-62", "a count of 2^62", "R-5.7-3", _LIMIT, at(1, b"\x80" * 8 + b"\x40"))
    yield ("count-two-bytes", "a count of 1 in two bytes", "R-5.7-1", "bad-varint", at(1, b"\x81\0"))
    yield "layer-one-byte", "a LAYER block of one byte", "R-5.7-2", "payload-short", at(1, b"", len(block) - 1)
