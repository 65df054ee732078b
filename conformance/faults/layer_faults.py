"""The invalid vectors of LAYER blocks: channel table, context rules, layer table (SPEC §6.4, §6.5, §7.11, §8.4)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from conformance.scenes.cases import Fault
from conformance.scenes.made import Plan, build, steady
from conformance.surgery.edit import renumber, replace_bytes
from conformance.surgery.files import NumberRecorder, block_of, change_block, change_numbers
from conformance.writer.file import write_file
from conformance.writer.numbers import Number, numbers_block
from scarfmt.blocks.layer import pack_layer
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.scene.model import Channel, LayerRow, SceneModel

File = tuple[bytes, QuantisedScene]
_CHANNELS = "R-6.4-1", "bad-channel"
_STEP = "R-6.4-3", "bad-channel"
_RECORD = "R-7.11-2", "bad-channel"
_ROWS = "R-6.5-2", "bad-layer-table"
_LIMIT = "count-limit"
_NO_STREAM = 0


def layer_faults(
    explicit: File, staged: File, anchor: File, static: File, predictors: bytes, stageless: bytes
) -> Iterator[Fault]:
    """Files with a broken LAYER block.

    Args:
        explicit: with every channel of its profile, and three layers.
        staged: the same with stages.
        anchor: with every channel of its profile.
        static: with SCALE only, one class and a stage in layer 1.
        predictors: the vector of that name.
        stageless: one without stages.
    """
    yield from _channel_faults(explicit, anchor)
    yield from _step_faults(static)
    yield from _row_faults(explicit, staged, anchor)
    yield from _number_faults(static[0])
    yield from _mode_faults(explicit, predictors, stageless)
    yield from _context_faults(explicit[0])


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
    return change_block(data, BlockKind.LAYER, layer, lambda _: pack_layer(row, opening), growth)


def _of(channel: Channel, components: int) -> Channel:
    """The channel with so many components, all as the first."""
    return Channel(channel.stream, channel.first_width[:1] * components)


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
    alone = write_file(scene), scene
    for name, more in (("wide", 1), ("narrow", -1)):
        purpose = f"LATENT of a component {'more' if more > 0 else 'less'} than DECODER_MLP takes"
        yield (f"latent-{name}", purpose, *rule, _with_channels(explicit, three, _of(latent, latent.components + more)))
        yield (f"latent-{name}-anchor", f"{purpose}, anchor profile", *rule,
               _with_channels(anchor, scales, _of(features, features.components + more), offsets))
        yield (f"latent-{name}-alone", f"{purpose}, no codebooks", *rule,
               _with_channels(alone, three, _of(latent, 3 + more)))


def _step_faults(static: File) -> Iterator[Fault]:
    scale = static[1].model.channels[0]
    above = 2.0**96 * (1 + 2.0**-23)
    for name, what, width in (
        ("zero", "0", 0.0), ("negative", "-1", -1.0), ("nan", "not a number", math.nan),
        ("infinite", "infinite", math.inf), ("large", "the next f32 above 2^96", above),
    ):
        channel = replace(scale, first_width=(*scale.first_width[:2], width))
        yield f"step-{name}", f"a first width that is {what}", *_STEP, _with_channels(static, channel)


def _row_faults(explicit: File, staged: File, anchor: File) -> Iterator[Fault]:
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
    yield ("stages-256", "256 stages more than there are, of which a byte holds those", *_ROWS,
           row(3, stages=(256 + third.stages[0], *third.stages[1:])))
    yield ("stages-taken-back", "a class has fewer stages than before", *_ROWS,
           row(3, staged, stages=(1, *staged[1].model.layers[2].stages[1:])))
    steps = third.steps[0]
    second = explicit[1].model.layers[1].steps
    yield ("steps-taken-back", "a class has fewer steps than in the layer before", *_ROWS,
           row(2, steps=((*second[0][:1], 0, *second[0][2:]), *second[1:])))
    yield ("steps-256", "256 steps more than there are, of which a byte holds those", *_ROWS,
           row(3, steps=((256 + steps[0], *steps[1:]), *third.steps[1:])))
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


def _mode_faults(explicit: File, predictors: bytes, stageless: bytes) -> Iterator[Fault]:
    unknown, idle = ("R-7.11-1", "unsupported-entropy-mode"), ("R-10.4-1", "bad-layer-table")
    for name, purpose, rule, data, mode in (
        ("entropy-mode-2", "an entropy mode that is not assigned", unknown, explicit[0], 2),
        ("entropy-mode-256", "entropy mode 256, of which a byte holds 0", unknown, explicit[0], 256),
        ("mode-without-stage", "entropy mode 1 in a layer in which no class has a stage", idle, stageless, 1),
    ):
        yield name, purpose, *rule, change_numbers(data, BlockKind.LAYER, renumber(("entropy_mode", mode)))
    data, scene = explicit
    second = NumberRecorder(block_of(data, BlockKind.LAYER, 2).payload)
    second.read_all(BlockKind.LAYER, {"layer": 2, "channel_count": len(scene.model.channels)})
    block = numbers_block(renumber(("entropy_mode", 255))(second.read))
    yield ("entropy-mode-255", "entropy mode 255 in layer 2", *unknown,
           change_block(data, BlockKind.LAYER, 2, replace_bytes(block)))
    yield ("entropy-mode-first", "an entropy mode that is not assigned, and nothing after it", *unknown,
           change_block(data, BlockKind.LAYER, 1, replace_bytes(numbers_block([(("entropy_mode", None), 2)]))))


def with_context(data: bytes, passes_log2: int, *targets: int) -> bytes:
    """The file with another passes_log2 and other occupancy targets."""

    def put(numbers: list[Number]) -> list[Number]:
        kept = [number for number in numbers if number[0] != ("occupancy_targets", None)]
        at = 1 + kept.index(next(number for number in kept if number[0] == ("target_count", None)))
        head = renumber(("passes_log2", passes_log2), ("target_count", len(targets)))(kept[:at])
        return [*head, *((("occupancy_targets", None), target) for target in targets), *kept[at:]]

    return change_numbers(data, BlockKind.LAYER, put)


def _context_faults(explicit: bytes) -> Iterator[Fault]:
    bad = "R-10.2-1", "bad-context"
    for name, purpose, rule, passes_log2, targets in (
        ("sixteen-passes", "passes_log2 is 4", bad, 4, (40, 5)),
        ("targets-equal", "occupancy targets do not descend", bad, 2, (40, 40)),
        ("target-zero", "an occupancy target is 0", bad, 2, (40, 0)),
        ("target-large", "a target of 65536", bad, 2, (65536,)),
        ("target-65537", "a target of 65537, of which 16 bits hold 1", bad, 2, (65537,)),
        ("passes-256", "passes_log2 is 256, of which a byte holds 0", bad, 256, (40, 5)),
        ("five-targets", "five targets", ("R-8.5-4", _LIMIT), 2, (40, 30, 20, 10, 5)),
    ):
        yield name, purpose, *rule, with_context(explicit, passes_log2, *targets)


def _number_faults(static: bytes) -> Iterator[Fault]:
    for field, value, name, purpose in (
        ("stream", _NO_STREAM, "channel-stream-0", "a channel of no stream kind"),
        ("stream", Stream.INDICES, f"channel-stream-{int(Stream.INDICES)}", "a channel of INDICES"),
        ("stream", Stream.FRAMING, f"channel-stream-{int(Stream.FRAMING)}", "a channel of FRAMING"),
        ("components", 0, "components-0", "a channel without components"),
        ("components", 65, "components-65", "a channel of 65 components"),
        ("stream", 261, "channel-stream-261", "a channel of kind 261, of which a byte holds SCALE"),
        ("components", 259, "components-259", "a channel of 259 components, of which a byte holds 3"),
    ):
        yield name, purpose, *_RECORD, change_numbers(static, BlockKind.LAYER, renumber((field, int(value))))
