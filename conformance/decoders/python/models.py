"""LAYER, TABLES, DECODER_MLP and SCENE_MLP blocks (SPEC §6.4, §6.5, §7.9, §7.11, §8.3)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

from conformance.decoders.python.fields import (
    COLOUR,
    LATENT,
    OFFSETS,
    OPACITY,
    POSITION_RESIDUAL,
    ROTATION,
    SCALE,
    key,
    require,
)
from conformance.decoders.python.numbers import Numbers

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


def parse_layer(numbers: Numbers, k: int, opening: Opening) -> tuple[Row, Opening]:
    mode = numbers.number("entropy_mode")
    require(mode in (0, 1), "unsupported-entropy-mode")
    if k == 1:
        channels = [_channel(numbers) for _ in range(numbers.count(8, "channel_count"))]
        passes_log2, targets = numbers.number("passes_log2"), numbers.count(4, "target_count")
        opening = Opening(channels, passes_log2, numbers.numbers(targets, "occupancy_targets"))
    n = len(opening.channels)
    classes = [(numbers.number("stages"), numbers.numbers(n, "steps")) for _ in range(numbers.count(15, "class_count"))]
    numbers.seal()
    return Row(mode, classes), opening


def _channel(numbers: Numbers) -> Channel:
    stream = numbers.number("stream")
    require(any(stream in profile for profile in _COMPONENTS), "bad-channel")
    components = numbers.number("components")
    require(1 <= components <= 64, "bad-channel")
    return Channel(stream, numbers.xor_f32(components, "first_widths"))


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
    fits = all(1 <= target <= 65535 for target in targets)
    require(opening.passes_log2 <= 3 and fits and descend, "bad-context")


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


class Weighted(NamedTuple):
    """The alphabet of a table and the weights of its values (SPEC §8.3)."""

    values: list[int]
    weights: list[int]


def parse_tables(numbers: Numbers) -> dict[int, Weighted]:
    """The tables of a TABLES block by key."""
    tables: dict[int, Weighted] = {}
    digits = [0, 0, 0, 0]
    for _ in range(numbers.count(65536, "table_count")):
        digits = _digits(numbers, digits)
        kind = min(digits[2], 2)
        more = numbers.count(4095, "more", kind)
        values, weights = numbers.signed(1, "first", kind), [1]
        for gap in numbers.numbers(more, "gaps", kind):
            values.append(values[-1] + gap + 1)
        require(values[-1] < 1 << 31, "bad-table")
        if more:
            precision = numbers.count(23, "precision", kind)
            weights = [less + 1 for less in numbers.numbers(more + 1, "weights", precision)]
            require(max(weights) < 1 << 24, "bad-table")
        tables[key(*digits)] = Weighted(values, weights)
    numbers.seal()
    return tables


def _digits(numbers: Numbers, before: list[int]) -> list[int]:
    """The digits of the next key."""
    digits, same = [], 1
    numbers.spend(4)
    for i in range(4):
        digit = numbers.read(("key", i, same))
        if same:
            digit += before[i] + (i == 3)
        require(digit <= 255, "bad-table")
        same &= digit == before[i]
        digits.append(digit)
    return digits


def parse_networks(numbers: Numbers) -> list[Shape]:
    """The shapes of the networks of a DECODER_MLP or SCENE_MLP block; nothing is decoded with their weights."""
    out: list[Shape] = []
    for _ in range(numbers.count(8, "network_count")):
        shape: Shape = []
        layers = numbers.count(4, "layer_count")
        require(layers >= 1, "bad-mlp")
        for _ in range(layers):
            rows = numbers.count(1024, "rows")
            require(rows >= 1, "bad-mlp")
            columns = numbers.count(1024, "columns")
            require(columns == shape[-1][0] if shape else columns >= 1, "bad-mlp")
            weights = numbers.signed(rows * columns, "weights")
            require(min(weights) >= -32768 and max(weights) <= 32767, "bad-mlp")
            for name in ("scales", "biases"):
                require(all(map(math.isfinite, numbers.f32(rows, name))), "bad-mlp")
            shape.append((rows, columns))
        out.append(shape)
    numbers.seal()
    return out
