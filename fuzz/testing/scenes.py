"""Random quantised scenes that obey every rule of SPEC §6, for tests of whatever reads or writes files."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.random import Generator

from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import local_bits
from scarfmt.container.file import HeaderFields, Tile
from scarfmt.container.schema import Profile, Stream
from scarfmt.limits import MAX_LOCAL_BITS
from scarfmt.scene.model import Channel, Codebooks, LayerRow, SceneModel, first_layers

TILE_DEPTH = 2
FEATURES = 8
LATENT = 6


def random_scene(
    seed: int,
    profile: Profile = Profile.EXPLICIT,
    *,
    anchors: int = 200,
    layers: int = 3,
    tiles: int = 3,
    sh_degree: int | None = None,
    latent: int | None = None,
) -> QuantisedScene:
    """A scene whose channels, classes, layer table, lattice and values all follow from `seed`.

    Args:
        seed: equal arguments give equal scenes.
        profile: explicit or anchor.
        anchors: in all tiles together, may be 0.
        layers: 1..16.
        tiles: 1..64, some of them perhaps without anchors.
        sh_degree: of the explicit profile; random by default.
        latent: components of LATENT, there wherever it may be; by default `LATENT`, there by chance.
    """
    rng = np.random.default_rng([seed, profile, anchors, layers, tiles])
    degree = int(rng.integers(0, 4)) if sh_degree is None else sh_degree
    slots = int(rng.integers(1, 11)) if profile == Profile.ANCHOR else 1
    degree = 0 if profile == Profile.ANCHOR else degree
    bits = int(rng.choice([4, 12, 16, 24, 32]))
    fields = HeaderFields(profile, degree, slots, bits, (-1.5, 0.25, 3.0), 2.0**-bits, anchors)
    channels = _channels(rng, profile, degree, latent)
    size = latent or LATENT
    outputs = _decoder_outputs(profile, degree, channels)
    model = SceneModel(profile, slots, channels, _rows(rng, channels, layers, bool(outputs)))
    table = _tiles(rng, bits, tiles)
    counts = rng.multinomial(anchors, rng.dirichlet(np.ones(tiles)))
    contents = tuple(_content(rng, model, local_bits(fields, t), int(n)) for t, n in zip(table, counts, strict=True))
    coarse, _, decoder = first_layers(model)
    return QuantisedScene(
        fields,
        model,
        table,
        contents,
        _books(rng, model.max_stages, size) if coarse else None,
        _network(rng, (size, 12, outputs)) if decoder else None,
        _scene_mlps(rng, slots) if profile == Profile.ANCHOR else (),
        {"title": f"scene {seed}"} if rng.random() < 0.5 else {},
    )


def _channels(rng: Generator, profile: Profile, degree: int, latent: int | None) -> tuple[Channel, ...]:
    """SCALE always, OFFSETS by profile, the others by chance."""
    chosen: list[tuple[Stream, float, int]] = []
    if rng.random() < 0.5:
        chosen.append((Stream.POSITION_RESIDUAL, 1 / 3, 3))
    chosen.append((Stream.SCALE, 0.3, 6 if profile == Profile.ANCHOR else 3))
    if profile == Profile.EXPLICIT:
        others = [(Stream.ROTATION, 0.2, 3), (Stream.OPACITY, 0.3, 1), (Stream.COLOUR, 0.1, 3)]
        chosen += [other for other in others if rng.random() < 0.7]
    has_colour = any(stream == Stream.COLOUR for stream, _, _ in chosen)
    if (profile == Profile.ANCHOR or degree > 0 or not has_colour) and (rng.random() < 0.5 or latent):
        chosen.append((Stream.LATENT, 9.0, latent or LATENT))
    out = [Channel(stream, tuple(step * (1 + c / 8) for c in range(size))) for stream, step, size in chosen]
    if profile == Profile.ANCHOR:
        out.append(Channel(Stream.OFFSETS, (0.1, 0.1, 0.2)))
    return tuple(out)


def _rows(rng: Generator, channels: tuple[Channel, ...], layers: int, latent: bool) -> tuple[LayerRow, ...]:
    """Rows in which nothing is taken back; a class has its scale from the start, offsets in one step."""
    counts = np.sort(rng.integers(1, 5, layers))
    stages = np.zeros(0, np.int64)
    steps = np.zeros((0, len(channels)), np.int64)
    out = []
    for count in counts:
        stages = np.append(stages, np.zeros(count - len(stages), np.int64))
        steps = np.append(steps, np.zeros((count - len(steps), len(channels)), np.int64), axis=0)
        if latent:
            stages = np.minimum(stages + rng.integers(0, 3, count), 5)
        if channels[-1].stream == Stream.OFFSETS:
            stages[0] = max(stages[0], 1)  # without any stage there is no decoder, and so no feature to draw with
        steps = np.minimum(steps + rng.integers(0, 3, steps.shape), 5)
        for index, channel in enumerate(channels):
            if channel.stream == Stream.SCALE:
                steps[:, index] = np.maximum(steps[:, index], 1)
            if channel.stream == Stream.OFFSETS:
                steps[:, index] = 1
        out.append(LayerRow(tuple(stages.tolist()), tuple(map(tuple, steps.tolist()))))
    return tuple(out)


def _tiles(rng: Generator, bits: int, count: int) -> tuple[Tile, ...]:
    prefixes = np.sort(rng.choice(1 << (3 * TILE_DEPTH), count, replace=False))
    low, high = max(0, bits - TILE_DEPTH - MAX_LOCAL_BITS), bits - TILE_DEPTH
    return tuple(Tile(TILE_DEPTH, int(rng.integers(low, high + 1)), int(prefix)) for prefix in prefixes)


def _content(rng: Generator, model: SceneModel, bits: int, count: int) -> TileContent:
    content = TileContent.empty(model, count)
    ends = [row.class_count for row in model.layers]
    classes = rng.integers(0, ends[-1], count)
    codes = rng.integers(0, 1 << (3 * bits), count, np.uint64, endpoint=False)
    # Anchors at one lattice point are legal, and a case of their own in the position coder.
    codes[: count // 8] = codes[:1].repeat(count // 8)
    appears = np.searchsorted(ends, classes, side="right") + 1
    order = np.lexsort((codes, appears))
    content.codes, content.classes, appears = codes[order], classes[order], appears[order]
    if content.slot_layers.size:
        slots = rng.integers(0, len(ends) + 1, content.slot_layers.shape)
        content.slot_layers = np.where(slots > 0, np.maximum(slots, appears[:, None]), 0)
    _fill_values(rng, model, content)
    received = model.stages(len(ends), content.classes)
    indices = rng.integers(0, 20, content.indices.shape)
    content.indices = np.where(np.arange(model.max_stages) < received[:, None], indices, 0).astype(np.int16)
    return content


def _fill_values(rng: Generator, model: SceneModel, content: TileContent) -> None:
    for index, channel in enumerate(model.channels):
        shape = content.values[index].shape
        if channel.stream == Stream.OFFSETS:
            values = rng.integers(-9, 10, shape) * (content.slot_layers > 0)[:, :, None]
        else:
            steps = model.steps(len(model.layers), index, content.classes)[:, None]
            cell = np.where(steps > 0, 3 ** np.maximum(steps - 1, 0), 0)
            if channel.stream == Stream.POSITION_RESIDUAL:
                values = np.clip(np.rint(rng.normal(size=shape) * cell * 0.5), -cell, cell)
            else:
                values = np.rint(rng.normal(-2.0, 3.0, shape) * cell)
        content.values[index] = values.astype(np.int32)


def _decoder_outputs(profile: Profile, degree: int, channels: tuple[Channel, ...]) -> int:
    if profile == Profile.ANCHOR:
        return FEATURES
    return 3 * ((degree + 1) ** 2 - any(channel.stream == Stream.COLOUR for channel in channels))


def _books(rng: Generator, stages: int, size: int) -> Codebooks:
    residual = 20 if stages > 1 else 0
    return Codebooks(rng.integers(-60, 60, (20, size)), rng.integers(-9, 9, (residual, size)))


def _scene_mlps(rng: Generator, slots: int) -> tuple[QuantisedMlp, ...]:
    inputs = FEATURES + int(rng.integers(3, 5))
    return tuple(_network(rng, (inputs, 16, width * slots)) for width in (1, 7, 3))


def _network(rng: Generator, widths: tuple[int, ...]) -> QuantisedMlp:
    layers = [
        Linear.quantised(rng.normal(size=(rows, columns)) / columns, rng.normal(size=rows) * 0.1)
        for columns, rows in itertools.pairwise(widths)
    ]
    return QuantisedMlp(tuple(layers))
