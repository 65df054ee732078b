"""Valid vectors at the edges of the static format: sizes, ties, tables, steps, layers, slots, numbers, METADATA."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from conformance.scenes.cases import Case, edge
from conformance.scenes.edge_networks import network_cases, predictor_cases
from conformance.scenes.made import (
    ANCHOR_CHANNELS,
    EVERY_CHANNEL,
    FEATURES,
    REFINED_ROWS,
    SCALE3,
    SPREAD_TILES,
    WHOLE,
    Plan,
    build,
    channel,
    mlp,
    steady,
)
from conformance.scenes.page_scenes import page_cases
from conformance.scenes.prng import Prng
from conformance.surgery.files import change_numbers
from conformance.writer.file import write_file
from conformance.writer.numbers import Number
from conformance.writer.options import Renewal, Weights, WriteOptions
from conformance.writer.tables import table_of
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Block, Tile
from scarfmt.container.schema import BlockFlag, BlockKind, Profile, Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.scene.model import Channel, LayerRow

_LIMIT = (1 << 31) - 1
_MOST_WEIGHT = (1 << 24) - 1
_SHORT = 2.0**-80
"""Quaternions of about so many units: their squares are 0 in binary32."""


def edge_cases() -> Iterator[Case]:
    """Every case, each of the class ``edge``."""
    for cases in (
        _position_cases(), _lattice_cases(), _table_cases(), _value_cases(), _latent_cases(), _colour_cases(),
        _layer_cases(), _tile_cases(), page_cases(), _anchor_cases(), _number_cases(),
        _annotation_cases(), predictor_cases(), network_cases(), _activation_cases(),
    ):
        yield from cases


def _plan(seed: str, counts: tuple[int, ...] = (24,), bits: int = 6, **fields: Any) -> Plan:
    """SCALE only, one layer, one tile for each count."""
    tiles = WHOLE if len(counts) == 1 else tuple(Tile(1, 0, code) for code in range(len(counts)))
    plan = Plan(f"edge {seed}", (SCALE3,), steady(1, 0, (1,)), tiles, counts, bits=bits)
    return replace(plan, **fields)


# ---------------------------------------------------------------------------------------------- positions


def _place(plan: Plan, codes: Sequence[int]) -> QuantisedScene:
    """The scene of a plan of one tile, its anchors in the cells of these codes, ascending."""
    scene = build(plan)
    (content,) = scene.contents
    content.codes = np.array(codes, np.uint64)
    return scene


def _position_cases() -> Iterator[Case]:
    split, uniform = ("R-7.2-1",), ("R-7.2-1", "R-8.2-3")
    yield edge("nodes-small", "nodes of 15, 16, 17 and 18 anchors: those above 16 send bins", _plan(
        "nodes", (15, 16, 17, 18, 1), 4), split, features=("bins",))
    yield edge("nodes-large", "nodes of 31, 32, 33 and 255, 256, 257 anchors: bins of width 2 and 3, 16 and 17", _plan(
        "more nodes", (31, 32, 33, 255, 256, 257), 3, constant=True), split, features=("bins",))
    yield edge("nodes-4096", "nodes of 4095, 4096 and 4097 anchors", _plan(
        "large nodes", (4095, 4096, 4097), 3, constant=True), split, features=("bins",))
    yield edge("block-65535", "65535 anchors in one block: the largest split whose rest travels in one part", _plan(
        "almost full", (65535,), 1, constant=True, skew=2), split, features=("bins",))
    yield edge("one-cell", "tiles of a single cell, no local bits: positions take no bytes", _plan(
        "one cell", (33, 1, 2), 1), uniform, features=("no-local-bits",))
    yield edge("first-cell", "40 anchors in the first cell of 2^63: every node keeps all of them", _place(
        _plan("first cell", (40,), 21), [0] * 40), split, features=("ties",))
    yield edge("last-cell", "40 anchors in the last cell of 2^63: no lower half has any", _place(
        _plan("last cell", (40,), 21), [(1 << 63) - 1] * 40), split, features=("ties",))
    spine = [0, *(1 << bit for bit in range(63))]
    yield edge("spine", "an anchor splits off at every bit: as many widths of the rest of a code, 1 to 63", _place(
        _plan("spine", (64,), 21), spine), split)
    ties = sorted([5] * 3 + [6] * 17 + [7] + [448] * 16 + [511] * 2)
    yield edge("ties", "leaves of 1, 2, 3, 16 and 17 anchors that keep their order", _place(
        _plan("ties", (len(ties),), 3), ties), ("R-7.2-1", "R-6.3-1"), features=("ties",))


def _lattice_cases() -> Iterator[Case]:
    rules = "R-6.2-2", "R-9.1-1"
    residual = channel(Stream.POSITION_RESIDUAL, 1 / 3, 3)
    yield edge("lattice-1", "a lattice of one bit an axis", _plan("lattice 1", (9,), 1), rules)
    yield edge("lattice-21", "tiles of depth 21 and 20 in a lattice of 21 bits: one cell, and eight", _plan(
        "depth 21", (4, 9), 21, tiles=(Tile(21, 0, (1 << 63) - 16), Tile(20, 0, (1 << 60) - 1))), rules)
    yield edge("lattice-shift", "cells of 2^31 lattice steps, residuals in them", _plan(
        "shift 31", (12,), 32, tiles=(Tile(0, 31, 0),), channels=(residual, SCALE3), rows=steady(1, 0, (2, 1))), rules)
    yield edge("lattice-21-bits", "21 local bits at depth 11, without a shift", _plan(
        "local bits", (6, 5), 32, tiles=(Tile(11, 0, 77), Tile(11, 0, 1 << 32))), rules)
    yield edge("world-tiny", "a voxel that is subnormal, and the largest origin that leaves positions finite", _plan(
        "tiny", (7,), 32, tiles=(Tile(0, 11, 0),), voxel=5e-324, origin=(1.7e308, -1.7e308, -0.0)), rules)
    huge = _plan("huge", (7,), 20, voxel=2.0**900, origin=(0.0, 1.0, -1e300))
    yield edge("world-huge", "a voxel of 2^900", huge, rules)


# ---------------------------------------------------------------------------------------------- tables


def _scale_key(component: int) -> TableKey:
    return TableKey(Stream.SCALE, component, 1, 0)


def _table_cases() -> Iterator[Case]:
    table = ("R-8.3-1",)
    values = tuple(range(-2048, 2048))
    steep = table_of(values, (1,) * 4095 + (_MOST_WEIGHT,))
    heavy = table_of(values, (_MOST_WEIGHT,) * 4096)
    light = table_of(values, (1,) * 4096)
    tables = {1: {_scale_key(0): steep, _scale_key(1): heavy, _scale_key(2): light}}
    yield edge("alphabet-4096", "tables of 4096 symbols: weights 1 but one 2^24 - 1, all 2^24 - 1, all 1", _plan(
        "alphabet", (40,), spread=600), table, WriteOptions(tables=tables))
    extremes = {1: {_scale_key(c): table_of((-_LIMIT, 0, _LIMIT), (1, 2, 1)) for c in range(3)}}
    yield edge("alphabet-extremes", "a table of -(2^31 - 1), 0 and 2^31 - 1, and values of all three", _with_values(
        _plan("extremes", (12,)), [_LIMIT, 0, -_LIMIT, 0]), ("R-8.3-1", "R-7.5-2"), WriteOptions(tables=extremes))
    idle = {TableKey(*key): table_of((-3, 900), (5, 1)) for key in (
        (0, 0, 0, 1), (Stream.POSITIONS, 0, 0, 1), (Stream.SCALE, 3, 1, 0), (Stream.OPACITY, 0, 21, 255),
        (Stream.LATENT, 0, 1, 0), (255, 255, 255, 255))}
    yield edge("tables-idle", "tables that code nothing: of streams, components, steps and contexts there are not",
               _plan("idle", (9,)), ("R-8.3-4", "R-11-2"), WriteOptions(tables={1: idle}))
    yield from _renewed_cases()
    first = replace(_plan("first symbols", (16,), 3), constant=True, rows=(
        LayerRow((1,), ((1,),)), LayerRow((3,), ((3,),))), dimension=2, codewords=(3, 3))
    yield edge("first-symbols", "all symbols are the first of tables of two: no sub-stream has bytes",
               _place(first, [511] * 16), ("R-7.1-6", "R-8.2-3"), WriteOptions(unused=(70000,)), ("empty-streams",))


def _renewed_cases() -> Iterator[Case]:
    inherit = "R-8.3-2", "R-8.3-4"
    rich = Plan("edge weights", EVERY_CHANNEL, REFINED_ROWS, SPREAD_TILES[:2], (20, 14), degree=1, dimension=5)
    for weights in (Weights.UNIFORM, Weights.REVERSED, Weights.STEEP):
        yield edge(f"weights-{weights.value}", f"tables with {weights.value} weights of their symbols", rich,
                   ("R-8.2-2", "R-8.3-1"), WriteOptions(weights=weights))
    yield edge("tables-renewed", "every layer sends all its tables anew", rich, inherit,
               WriteOptions(renewal=Renewal.ALWAYS))
    yield edge("tables-repeated", "every layer repeats all tables in force", rich, inherit,
               WriteOptions(renewal=Renewal.REPEATED))
    yield edge("tables-wider", "alphabets with symbols that no anchor has, some of which would be refused", rich,
               ("R-8.3-4", "R-7.5-1", "R-7.6-1"), WriteOptions(unused=(-70000, 5000)))


# ---------------------------------------------------------------------------------------------- values


def _with_values(plan: Plan, pattern: Sequence[int]) -> QuantisedScene:
    """The scene of a plan whose values of all channels follow a pattern, each component from another place of it."""
    scene = build(plan)
    for content in scene.contents:
        for values in content.values:
            rows, columns = values.shape
            at = np.arange(rows)[:, None] + np.arange(columns)[None]
            values[:] = np.array(pattern)[at % len(pattern)]
    return scene


def _value_cases() -> Iterator[Case]:
    rules = "R-7.5-2", "R-9.2-1"
    both = (LayerRow((0,), ((1,),)), LayerRow((0,), ((2,),)))
    yield edge("values-limit", "values of 2^31 - 1 and its negative after a refinement, beside 0 and 1", _with_values(
        _plan("limit", (12,), rows=both), [_LIMIT, 1, -_LIMIT, 0]), rules)
    steps = Channel(Stream.SCALE, (2.0**-149, 2.0**96, 2.0**-126))
    yield edge("steps-extreme", "steps of 2^96, the least normal and the least subnormal number", _with_values(
        _plan("extreme steps", (12,), channels=(steps,)), [_LIMIT, -1, 1, -_LIMIT]), (*rules, "R-6.4-3"))
    reach = Channel(Stream.POSITION_RESIDUAL, (1.0, 0.5, 0.25))
    scene = build(_plan("reach", (9,), channels=(reach, SCALE3), rows=steady(1, 0, (1, 1))))
    values = scene.contents[0].values[0]
    values[:] = np.array([[1, 2, 4], [-1, -2, -4], [0, 1, -1]])[np.arange(9) % 3]
    yield edge("residual-reach", "position residuals of exactly -1 and 1", scene, ("R-7.5-3", "R-9.1-2"))


# ---------------------------------------------------------------------------------------------- models


def _latent_cases() -> Iterator[Case]:
    latent = channel(Stream.LATENT, 3.0, 64)
    yield edge("latent-64", "64 latent dimensions, from codebooks and LATENT", _plan(
        "latent", (6,), channels=(SCALE3, latent), rows=steady(1, 2, (1, 1)), dimension=64, codewords=(4, 4), degree=1,
        spread=2), ("R-9.2-2", "R-6.4-2"))
    short = (SCALE3, channel(Stream.LATENT, 3.0, 2))
    rows = (LayerRow((0,), ((1, 0),)), LayerRow((0,), ((1, 2),)))
    yield edge("latent-alone", "LATENT without codebooks, from layer 2 on: before, no DECODER_MLP", _plan(
        "latent alone", (20,), channels=short, rows=rows, dimension=2, degree=1), ("R-9.2-2", "R-9.2-3", "R-7.9-2"))
    three = (LayerRow((0,), ((1,),)), LayerRow((0, 1), ((1,), (1,))), LayerRow((3, 1), ((1,), (1,))))
    yield edge("codebooks-late", "codebook 0 first needed in layer 2, codebook 1 in layer 3", _plan(
        "late books", (30,), rows=three, dimension=3, degree=1), ("R-7.8-2", "R-9.2-3"))
    deep = build(_plan("deep", (5,), rows=steady(1, 1, (1,)), dimension=64, degree=3))
    widest = mlp(Prng("edge widest"), 64, 1, 1024, 3, 48)
    yield edge("mlp-widest", "DECODER_MLP of four layers, one of 1024 rows, the next of 1024 columns", replace(
        deep, decoder=widest), ("R-7.9-1", "R-9.5-1"))
    yield edge("codewords-extreme", "codewords of 65535 and -65535, eight stages", _loud(_plan(
        "loud", (20,), rows=steady(1, 8, (1,)), dimension=2, degree=0)), ("R-7.8-1", "R-9.2-2"))
    yield edge("codebook-4096", "a codebook of 4096 codewords, a residual one of 1", _plan(
        "many words", (40,), rows=steady(1, 2, (1,)), dimension=1, codewords=(4096, 1)), ("R-7.8-1", "R-8.3-1"))


def _loud(plan: Plan) -> QuantisedScene:
    scene = build(plan)
    assert scene.codebooks is not None
    for book in (scene.codebooks.coarse, scene.codebooks.residual):
        book[:] = np.where(book > 0, 65535, -65535)
    return scene


def _colour_cases() -> Iterator[Case]:
    rules = "R-9.4-2", "R-9.4-3", "R-7.9-3"
    rotation, opacity = channel(Stream.ROTATION, 0.4, 3), channel(Stream.OPACITY, 0.3, 1)
    colour = channel(Stream.COLOUR, 0.2, 3)
    for degree in range(4):
        channels = (SCALE3, rotation, opacity, colour)
        # Of degree 0 there is nothing left for a network to give.
        yield edge(f"degree-{degree}-colour", f"degree {degree}: COLOUR gives that of degree 0", _plan(
            f"colour {degree}", (10,), channels=channels, degree=degree, dimension=2 if degree else 0, codewords=(5, 5),
            rows=steady(1, int(degree > 0), (1, 2, 1, 2))), rules)
        if degree != 1:
            yield edge(f"degree-{degree}-network", f"degree {degree}: the network gives all coefficients", _plan(
                f"network {degree}", (10,), channels=(SCALE3, opacity), degree=degree, dimension=2, codewords=(5, 5),
                rows=steady(1, 1, (1, 1))), rules)
    yield edge("activation-edges", "rotations beyond -1..1 and at the poles, opacities of 1 and near 0, huge scales",
               _activations(), ("R-9.3-1", "R-9.4-1"))


def _activations() -> QuantisedScene:
    """SCALE, ROTATION and OPACITY in quarters."""
    channels = tuple(
        Channel(stream, (0.25,) * components)
        for stream, components in ((Stream.SCALE, 3), (Stream.ROTATION, 3), (Stream.OPACITY, 1))
    )
    scene = build(_plan("activations", (12,), channels=channels, rows=steady(1, 0, (1, 1, 1))))
    content = scene.contents[0]
    directions = [(0, 0), (4, 4), (-4, 4), (8, 0), (4, -4), (2, 2), (-4, -4), (9, -7), (0, 4), (40, 3), (1, 0), (-5, 5)]
    content.values[0][:] = np.array([-400, -8, 0, 3000, 12])[np.arange(36).reshape(12, 3) % 5]
    content.values[1][:, :2] = directions
    content.values[1][:, 2] = np.array([0, 13, -25, 50, 7, -1])[np.arange(12) % 6]
    content.values[2][:, 0] = np.array([0, 1, -1, -400, -9, 30])[np.arange(12) % 6]
    return scene


# ---------------------------------------------------------------------------------------------- layers, tiles


def _layer_cases() -> Iterator[Case]:
    rules = ("R-6.5-2",)
    idle = (LayerRow((0,), ((0,),)), LayerRow((0, 0), ((0,), (0,))), LayerRow((0, 0), ((1,), (0,))))
    yield edge("layers-nothing", "anchors of which nothing but a position is known; one class is never refined", _plan(
        "nothing", (20,), rows=idle), (*rules, "R-9.2-3"))
    still = steady(3, 0, (1,))
    yield edge("layers-still", "layers 2 and 3 change nothing and have no TILE block", _plan(
        "still", (9,), rows=still), (*rules, "R-7.1-7"))
    yield edge("tiles-empty-blocks", "the same with a TILE block of neither anchors nor records for every tile", _plan(
        "empty blocks", (9, 0, 3), rows=still), ("R-7.1-1", "R-7.1-7"), WriteOptions(empty_tiles=True))
    every = [LayerRow((0,) * k, ((min(k, 2),),) * k) for k in range(1, 16)]
    rows = (*every, LayerRow((0,) * 15, ((20,),) * 15))
    yield edge("layers-classes", "a class appears in each of fifteen layers; then all get twenty steps", _plan(
        "classes", (60,), rows=rows), rules)


def _late(plan: Plan, tile: int) -> QuantisedScene:
    """The scene, the anchors of a tile of the last class."""
    scene = build(plan)
    content = scene.contents[tile]
    content.classes[:] = scene.model.layers[-1].class_count - 1
    content.codes = np.sort(content.codes)
    return scene


def _tile_cases() -> Iterator[Case]:
    rows = (LayerRow((0,), ((2,),)), LayerRow((0, 0), ((2,), (2,))), LayerRow((0, 0, 0), ((2,),) * 3))
    yield edge("tile-late", "a tile whose anchors appear in layer 3 only; one without any", _late(
        _plan("late tile", (14, 8, 0), rows=rows), 1), ("R-7.1-6", "R-5.5-7"), features=("late-tile",))
    yield edge("tiles-none-used", "tiles, but no anchors in any", _plan("unused tiles", (0, 0)), ("R-7.1-6",))
    depths = (Tile(1, 0, 0), Tile(2, 0, 8), Tile(3, 0, 72), Tile(4, 0, 584), Tile(2, 2, 10), Tile(1, 3, 7))
    yield edge("tiles-nested", "tiles of depths 1 to 4 beside each other, with gaps", _plan(
        "nested", (5, 4, 3, 2, 1, 6), 8, tiles=depths), ("R-5.5-7", "R-6.2-2", "R-6.3-1"))


# ---------------------------------------------------------------------------------------------- anchor profile


def _anchor_plan(seed: str, **fields: Any) -> Plan:
    plan = Plan(f"edge {seed}", ANCHOR_CHANNELS, steady(1, 1, (1, 1)), WHOLE, (12,), bits=7, profile=Profile.ANCHOR,
                slots=3, dimension=3, codewords=(5, 5), spread=2)
    return replace(plan, **fields)


def _slots(plan: Plan, layers: Sequence[int]) -> QuantisedScene:
    """The scene, slot s of every anchor on from layer `layers[s % len(layers)]` on, 0 for never."""
    scene = build(plan)
    for content in scene.contents:
        chosen = np.array(layers)[np.arange(plan.slots) % len(layers)]
        content.slot_layers[:] = chosen
        offsets = Prng(f"{plan.seed} offsets").integers(-9, 10, content.values[-1].shape)
        content.values[-1][:] = offsets * (content.slot_layers > 0)[:, :, None]
    return scene


def _anchor_cases() -> Iterator[Case]:
    rules = "R-7.4-1", "R-9.6-1"
    one = build(_anchor_plan("one slot", slots=1))
    yield edge("anchors-one-slot", "one slot; networks that take no distance", replace(one, scene_mlps=tuple(
        mlp(Prng(f"edge distance {width}"), FEATURES + 3, 6, width) for width in (1, 7, 3))), (*rules, "R-7.9-4"))
    yield edge("anchors-slots-off", "32 slots, none of which is ever on", _slots(
        _anchor_plan("slots off", slots=32, counts=(8,)), [0]), rules)
    yield edge("anchors-slots-on", "32 slots, all on in layer 1: no masks are left to send in layer 2", _slots(
        _anchor_plan("slots on", slots=32, counts=(5,), rows=steady(2, 1, (1, 1))), [1]), rules)
    later = (LayerRow((1,), ((1, 1),)), LayerRow((1,), ((3, 1),)), LayerRow((2,), ((3, 1),)))
    yield edge("anchors-slots-later", "no slot is on in layer 1; others come in layers 2 and 3, one never", _slots(
        _anchor_plan("slots later", slots=4, rows=later), [2, 0, 3, 2]), rules)
    channels = (ANCHOR_CHANNELS[0], channel(Stream.LATENT, 3.0, 3), ANCHOR_CHANNELS[1])
    yield edge("anchors-latent", "features from LATENT alone, no codebooks", _anchor_plan(
        "anchors latent", channels=channels, rows=(LayerRow((0,), ((1, 1, 1),)), LayerRow((0,), ((1, 3, 1),)))),
        ("R-6.5-4", "R-9.2-2"))
    yield edge("anchors-none", "the anchor profile without anchors", _anchor_plan("no anchors", tiles=(), counts=()),
               ("R-7.9-4", "R-6.5-4"))
    yield edge("anchors-dull", "networks whose outputs are all 0: no opacity, quaternions of 0", _dull(), ("R-9.6-1",))


def _dull() -> QuantisedScene:
    """Anchors at the origin's cell centre, and networks without weights or biases."""
    plan = _anchor_plan("dull", origin=(-0.5, -0.5, -0.5), voxel=1.0, counts=(6,))
    scene = _slots(plan, [1])
    scene.contents[0].codes[:] = np.sort(scene.contents[0].codes % np.uint64(8))
    networks = []
    for network in scene.scene_mlps:
        layers = (replace(layer, weights=0 * layer.weights, biases=0 * layer.biases) for layer in network.layers)
        networks.append(replace(network, layers=tuple(layers)))
    return replace(scene, scene_mlps=tuple(networks))


# ---------------------------------------------------------------------------------------------- activations


def _activation_cases() -> Iterator[Case]:
    """Activated values that need care in binary32: squares that overflow or vanish, sums that cancel."""
    value = "R-9.5-1"
    yield edge("activation-extremes", "rotations of u and v up to 1.7e38, colours of Y, G and O that cancel",
               _extremes(), (value, "R-9.3-1", "R-9.4-2"))
    far = build(_around("far", 2.0**900))
    without_distance = tuple(mlp(Prng(f"edge far {width}"), FEATURES + 3, 6, 3 * width) for width in (1, 7, 3))
    yield edge("anchors-far", "anchors 1e272 from the camera: squares of distances overflow binary64",
               replace(far, scene_mlps=without_distance), (value, "R-9.6-1"))
    near = build(_around("near", 2.0**-700))
    opacity, covariance, colour = near.scene_mlps
    yield edge("anchors-near", "anchors 1e-210 from the camera, and quaternions 1e-24 long: their squares vanish",
               replace(near, scene_mlps=(opacity, _short(covariance), colour)), (value, "R-9.6-1"))
    seen = edge("anchors-camera", "Gaussians for a camera that is not at the origin of the header",
                build(_around("camera", 0.125)), (value, "R-9.6-1"))
    yield replace(seen, camera=(3.25, -1.5, 40.0))


def _around(seed: str, voxel: float) -> Plan:
    """Anchors around the camera, at the origin."""
    return _anchor_plan(seed, origin=(0.0, 0.0, 0.0), voxel=voxel)


def _extremes() -> QuantisedScene:
    channels = (
        channel(Stream.SCALE, 0.5, 3),
        Channel(Stream.ROTATION, (2.0**96, 2.0**96, 0.25)),
        Channel(Stream.COLOUR, (0.5,) * 3),
    )
    plan = Plan("edge activation extremes", channels, steady(1, 0, (1, 1, 1)), WHOLE, (10,), bits=6)
    scene = build(plan)
    (content,) = scene.contents
    most, large = _LIMIT, 1 << 25
    rotations = [(most, most), (most, -most), (-most, 0), (12, -1), (1, 12), (0, 0), (0, 1), (-12, 12)]
    colours = [(1, large, large), (large, large, 1), (large, -large, -3), (-large, large, 2 * large), (1, 1, 1)]
    content.values[1][:, :2] = np.array(rotations)[np.arange(10) % len(rotations)]
    content.values[2][:] = np.array(colours)[np.arange(10) % len(colours)]
    return scene


def _short(covariance: QuantisedMlp) -> QuantisedMlp:
    """Quaternions, not standard deviations, shorter."""
    first, last = covariance.layers
    factors = np.where(np.arange(len(last.scales)) % 7 < 3, 1, _SHORT).astype(np.float32)
    return QuantisedMlp((first, replace(last, scales=last.scales * factors, biases=last.biases * factors)))


# ---------------------------------------------------------------------------------------------- numbers, blocks


def _number_cases() -> Iterator[Case]:
    """Numbers of every length of the prefix, 0 to 31."""
    first = build(_plan("numbers", (9,), rows=steady(1, 1, (1,)), dimension=2, codewords=(3, 3), degree=3))
    weights = np.array([(1 << n // 2) - n % 2 for n in range(30)] + [-(1 << n) for n in range(16)], np.int16)
    # Bits of biases: subnormal, -0.0, and numbers next to 0 and 2.
    bits = np.array([*((1 << n) - 1 + n % 2 for n in range(31)), 1 << 31], np.uint32).view(np.float32)
    layers = (
        Linear(np.resize(weights, (32, 2)), np.full(32, 1e-6, np.float32), bits),
        Linear(np.resize(weights, (48, 32)), np.full(48, -1e-6, np.float32), np.resize(bits, 48)),
    )
    doubling = tuple(itertools.accumulate((1 << n for n in range(31)), initial=-_LIMIT))
    wide = {
        TableKey(255, 0, step, context): table_of(values, [min(1 << n, _MOST_WEIGHT) for n in range(len(values))])
        for step in (0, 1, 2)
        for context, values in enumerate((doubling, (-_LIMIT, _LIMIT), (-_LIMIT, 1, _LIMIT)))
    }
    yield edge("numbers-wide", "gaps, weights, scales and biases whose numbers have prefixes of 0 to 31 bits",
               replace(first, decoder=QuantisedMlp(layers)), ("R-8.5-1", "R-8.3-1", "R-7.9-1"),
               WriteOptions(tables={1: wide}))
    plain = build(_plan("precision", (40,)))
    yield Case("edge/numbers-precision", "tables whose `precision` says nothing of their weights, only of their model",
               change_numbers(write_file(plain), BlockKind.TABLES, _as_of_24_bits), ("R-8.3-1",), scene=plain)


def _as_of_24_bits(numbers: list[Number]) -> list[Number]:
    """The numbers of tables, the weights in the model of the largest ones."""
    return [
        (field, 23) if field[0] == "precision" else (("less", 23), n) if field[0] == "less" else (field, n)
        for field, n in numbers
    ]


def _annotation_cases() -> Iterator[Case]:
    safe = int(BlockFlag.SAFE_TO_COPY)
    blocks = [
        Block(kind, layer, bytes([kind, layer]), flags=flags)
        for kind, layer, flags in ((66, 1, 0), (127, 1, safe), (66, 2, safe), (128, 2, 0), (129, 2, safe), (255, 2, 0))
    ]
    yield edge("blocks-unknown", "unknown annotations and private blocks of every kind of flag",
               _plan("unknown", (5, 4), rows=steady(2, 0, (1,))), ("R-5.6-2", "R-5.6-3"),
               WriteOptions(blocks=tuple(blocks)))
    odd = {
        "": {"": []}, "Größe \U0001f30d": [1.5e3, -0.0, None, True, ""], "nul": "\0\x7f\u2028", "a": {"a": {"a": {}}},
    }
    text = json.dumps(odd, ensure_ascii=False, indent=3).replace("1500.0", "1.5E+3") + "\r\n\t "
    metadata = replace(build(_plan("metadata", (3,))), metadata=odd)
    rules = "R-7.10-1", "R-7.10-2"
    yield edge("metadata-odd", "METADATA with white space, empty keys, characters beyond ASCII, escapes, deep objects",
               metadata, rules, WriteOptions(metadata=text.encode()))
    escaped = json.dumps({"k\u00e9y": "\U0001f30d", "n": -1e-7}, ensure_ascii=True).replace('"n"', '"\\u006e"')
    yield edge("metadata-escaped", "METADATA with escaped surrogates and an escaped key, a key twice with one value",
               replace(metadata, metadata={"k\u00e9y": "\U0001f30d", "n": -1e-7}), rules,
               WriteOptions(metadata=escaped.replace("{", '{"n": -1e-7, ', 1).encode()))
    yield edge("metadata-empty", "METADATA of an empty object", replace(metadata, metadata={}), rules,
               WriteOptions(metadata=b"{}"))
    deep = b'{"a":' + 63 * b"[" + b'"[[{{\\"[["' + 63 * b"]" + b',"b":' + 63 * b'{"":' + b"0" + 64 * b"}"
    yield edge("metadata-deep", "METADATA nested 64 deep, brackets in strings", replace(metadata, metadata={}),
               ("R-7.10-1", "R-7.10-3"), WriteOptions(metadata=deep))
    numbers = b'{"a":1,"a":[17976931348623157' + 292 * b"0" + b",-0." + 5000 * b"0" + b'1,1e-999,1E+308],"a\\u0000":0}'
    yield edge("metadata-numbers", "METADATA with numbers at both ends of binary64, a name twice with two values",
               replace(metadata, metadata={}), rules, WriteOptions(metadata=numbers))


