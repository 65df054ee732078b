"""LAYER, DECODER_MLP and SCENE_MLP blocks (SPEC §6.4, §6.5, §7.9, §7.11)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

from conformance.decoders.python.fields import (
    COLOUR,
    LATENT,
    MAX_MLP_BYTES,
    OFFSETS,
    OPACITY,
    POSITION_RESIDUAL,
    ROTATION,
    SCALE,
    Payload,
    require,
    stored,
)

_COMPONENTS = (
    {POSITION_RESIDUAL: 3, SCALE: 3, ROTATION: 3, OPACITY: 1, COLOUR: 3, LATENT: 0},
    {POSITION_RESIDUAL: 3, SCALE: 6, LATENT: 0, OFFSETS: 3},
)
"""By profile, the components of each channel; those of LATENT are free (§6.4)."""
Shape = list[tuple[int, int]]
"""(rows, columns) of the layers of a network."""


class Channel(NamedTuple):
    """A row of the channel table (SPEC §6.4)."""

    stream: int
    first_widths: list[float]

    @property
    def components(self) -> int:
        return len(self.first_widths)


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
        channels = [_channel(reader) for _ in range(reader.count(8))]
        passes_log2 = reader.u8()
        opening = Opening(channels, passes_log2, [reader.varint(16) for _ in range(reader.count(4))])
    classes = [(reader.u8(), list(reader.take(len(opening.channels)))) for _ in range(reader.count(15))]
    reader.finish()
    return Row(mode, classes), opening


def _channel(reader: Payload) -> Channel:
    channel = Channel(reader.u8(), [])
    require(any(channel.stream in profile for profile in _COMPONENTS), "bad-channel")
    components = reader.u8()
    require(1 <= components <= 64, "bad-channel")
    channel.first_widths.extend(reader.fields(f"{components}d"))
    return channel


def check_opening(opening: Opening, profile: int) -> None:
    """The channel table, passes and targets (R-6.4-1 to R-6.4-3, R-10.2-1)."""
    streams, of_profile = [channel.stream for channel in opening.channels], _COMPONENTS[profile]
    require(all(a < b for a, b in pairwise(streams)) and set(streams) <= set(of_profile), "bad-channel")
    require({SCALE, *(OFFSETS for _ in range(profile))} <= set(streams), "bad-channel")
    for channel in opening.channels:
        require(of_profile[channel.stream] in (0, channel.components), "bad-channel")
        require(all(0 < width <= 2.0**96 for width in channel.first_widths), "bad-channel")
    targets = opening.targets
    descend = all(a > b for a, b in pairwise(targets))
    require(opening.passes_log2 <= 3 and min(targets, default=1) >= 1 and descend, "bad-context")


def check_rows(rows: list[Row], channels: list[Channel], profile: int) -> None:
    """The layer table (R-6.5-2 to R-6.5-4, R-10.4-1)."""
    before: list[tuple[int, list[int]]] = []
    for k, row in enumerate(rows, start=1):
        good = len(row.classes) >= max(len(before), 1)
        for c, (stages, steps) in enumerate(row.classes):
            least = [before[c][0], *before[c][1]] if c < len(before) else [0] * (1 + len(steps))
            good &= stages <= 8 and max(steps) <= 20
            good &= all(a <= b for a, b in zip(least, [stages, *steps], strict=True))
            good &= all(n == 1 for n, channel in zip(steps, channels, strict=True) if channel.stream == OFFSETS)
        good &= row.mode == 0 or any(stages for stages, _ in row.classes)
        good &= not profile or k > 1 or has_latents(row, channels)
        require(good, "bad-layer-table")
        before = row.classes


def has_latents(row: Row, channels: list[Channel]) -> bool:
    """Whether a class has a stage, or a step of LATENT."""
    latent = [i for i, channel in enumerate(channels) if channel.stream == LATENT]
    return any(stages > 0 or any(steps[i] for i in latent) for stages, steps in row.classes)


def parse_networks(block: bytes) -> list[Shape]:
    """The shapes of the networks of a DECODER_MLP or SCENE_MLP block; nothing is decoded with their weights."""
    reader, out = Payload(stored(block, MAX_MLP_BYTES)), []
    for _ in range(reader.count(8)):
        shape: Shape = []
        layers = reader.count(4)
        require(layers >= 1, "bad-mlp")
        for _ in range(layers):
            rows = reader.count(1024)
            require(rows >= 1, "bad-mlp")
            columns = reader.count(1024)
            require(columns == shape[-1][0] if shape else columns >= 1, "bad-mlp")
            width = reader.u8()
            require(width in (1, 2), "bad-mlp")
            reader.take(rows * columns * width)
            for _ in range(2):
                require(all(map(math.isfinite, reader.fields(f"{rows}f"))), "bad-mlp")
            shape.append((rows, columns))
        out.append(shape)
    reader.finish()
    return out
