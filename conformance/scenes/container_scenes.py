"""Small scenes whose files the faults of the container, its limits and its cuts are put into."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from conformance.scenes.made import ANCHOR_CHANNELS, PLAIN, Plan, build, channel
from conformance.surgery.files import vector_file
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import Profile, Stream
from scarfmt.scene.model import LayerRow

_SCALE = channel(Stream.SCALE, 0.5, PLAIN, PLAIN, PLAIN)
_METADATA: dict[str, object] = {"title": "container"}


@cache
def plain_scene() -> QuantisedScene:
    """Explicit profile: three tiles, two layers, a codebook, a network, METADATA; 32 lattice bits."""
    return build(Plan(
        "container", (_SCALE,), (LayerRow((1,), ((1,),)), LayerRow((1, 1), ((2,), (1,)))),
        (Tile(1, 27, 1), Tile(2, 27, 16), Tile(1, 26, 5)), (4, 3, 5), bits=32, dimension=2, codewords=(3, 3), spread=1,
        metadata=_METADATA,
    ))


@cache
def anchor_scene() -> QuantisedScene:
    """Anchor profile: one tile, two layers, two slots."""
    return build(Plan(
        "container anchors", ANCHOR_CHANNELS, (LayerRow((1,), ((1, 1),)), LayerRow((1, 1), ((1, 1), (1, 1)))),
        (Tile(0, 11, 0),), (8,), profile=Profile.ANCHOR, slots=2, dimension=2, codewords=(3, 3), spread=1,
    ))


@cache
def root_scene() -> QuantisedScene:
    """Explicit profile: one tile of depth 0 whose only cell is the whole lattice of 32 bits."""
    return build(Plan(
        "container root", (_SCALE,), (LayerRow((0,), ((1,),)),), (Tile(0, 31, 0),), (3,), bits=32, spread=1,
    ))


@cache
def crowd_scene(counts: tuple[int, ...]) -> QuantisedScene:
    """Explicit profile: tiles of one cell, which tell no anchor from another; every table has one symbol.

    Args:
        counts: anchors of each tile, at most 8 of them.
    """
    return build(Plan(
        "container crowd", (_SCALE,), (LayerRow((0,), ((1,),)),), tuple(Tile(1, 0, n) for n in range(len(counts))),
        counts, bits=1, constant=True,
    ))


@cache
def idle_slots_scene(anchors: int) -> QuantisedScene:
    """Anchor profile: 32 slots, none of them ever on; all anchors in one cell."""
    scene = build(Plan(
        "container slots", ANCHOR_CHANNELS, (LayerRow((1,), ((1, 1),)),), (Tile(0, 1, 0),), (anchors,), bits=1,
        profile=Profile.ANCHOR, slots=32, dimension=1, codewords=(1, 1), constant=True,
    ))
    (content,) = scene.contents
    content.slot_layers = np.zeros_like(content.slot_layers)
    content.values[1] = np.zeros_like(content.values[1])
    return replace(scene, contents=(content,))


@cache
def plain_file() -> bytes:
    """The file of :func:`plain_scene`."""
    return vector_file(plain_scene())


@cache
def anchor_file() -> bytes:
    """The file of :func:`anchor_scene`."""
    return vector_file(anchor_scene())


@cache
def root_file() -> bytes:
    """The file of :func:`root_scene`."""
    return vector_file(root_scene())
