"""Random quantised scenes that obey every rule of SPEC §6, for tests of whatever reads or writes files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import Generator

from conformance.scenes.made import FEATURES, Plan, build, channel, mlp
from conformance.scenes.prng import Prng
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import Profile, Stream
from scarfmt.limits import MAX_LOCAL_BITS
from scarfmt.scene.model import Channel, LayerRow, SceneModel, first_layers

TILE_DEPTH = 2
LATENT = 6
CODEWORDS = 20


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
    return scene_of(random_plan(seed, profile, anchors, layers, tiles, sh_degree, latent))


def scene_of(plan: Plan) -> QuantisedScene:
    """The scene of a plan, its networks with a hidden layer; those of the anchor profile with and without distance."""
    scene, prng = build(plan), Prng(f"networks {plan.seed}")
    inputs = FEATURES + int(prng.integers(3, 5, 1)[0])
    return replace(
        scene,
        decoder=mlp(prng, plan.dimension, 12, scene.decoder.outputs) if scene.decoder else None,
        scene_mlps=tuple(mlp(prng, inputs, 16, network.outputs) for network in scene.scene_mlps),
    )


def random_plan(
    seed: int, profile: Profile, anchors: int, layers: int, tiles: int, sh_degree: int | None, latent: int | None
) -> Plan:
    """What :func:`random_scene` builds; arguments as there."""
    rng = np.random.default_rng([seed, profile, anchors, layers, tiles])
    degree = int(rng.integers(0, 4)) if sh_degree is None else sh_degree
    slots = int(rng.integers(1, 11)) if profile == Profile.ANCHOR else 1
    degree = 0 if profile == Profile.ANCHOR else degree
    bits = int(rng.choice([4, 12, 16, 24, 32]))
    channels = _channels(rng, profile, degree, latent)
    coloured = any(one.stream == Stream.COLOUR for one in channels)
    rows = _rows(rng, channels, layers, profile == Profile.ANCHOR or degree > 0 or not coloured)
    *_, decoder = first_layers(SceneModel(profile, slots, channels, rows))
    return Plan(
        f"{seed} {profile} {anchors} {layers} {tiles}",
        channels,
        rows,
        _tiles(rng, bits, tiles),
        tuple(rng.multinomial(anchors, rng.dirichlet(np.ones(tiles))).tolist()),
        bits,
        profile,
        slots,
        degree,
        (latent or LATENT) if decoder else 0,
        (CODEWORDS, CODEWORDS),
        # Anchors at one lattice point are legal, and a case of their own in the position coder.
        codes=int(rng.choice([0, 4 * anchors + 1])),
        voxel=2.0**-bits,
        metadata={"title": f"scene {seed}"} if rng.random() < 0.5 else {},
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
    out = [channel(*one) for one in chosen]
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
        for index, stream in enumerate(one.stream for one in channels):
            if stream == Stream.SCALE:
                steps[:, index] = np.maximum(steps[:, index], 1)
            if stream == Stream.OFFSETS:
                steps[:, index] = 1
        out.append(LayerRow(tuple(stages.tolist()), tuple(map(tuple, steps.tolist()))))
    return tuple(out)


def _tiles(rng: Generator, bits: int, count: int) -> tuple[Tile, ...]:
    prefixes = np.sort(rng.choice(1 << (3 * TILE_DEPTH), count, replace=False))
    low, high = max(0, bits - TILE_DEPTH - MAX_LOCAL_BITS), bits - TILE_DEPTH
    return tuple(Tile(TILE_DEPTH, int(rng.integers(low, high + 1)), int(prefix)) for prefix in prefixes)
