"""Small scenes whose files the faults of the container, its limits and its cuts are put into."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from conformance.scenes.made import ANCHOR_CHANNELS, SCALE3, Plan, build
from conformance.writer.file import write_file
from conformance.writer.options import WriteOptions
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import Profile
from scarfmt.scene.model import LayerRow

_METADATA: dict[str, object] = {"title": "container"}


@cache
def plain_scene() -> QuantisedScene:
    """Explicit profile: three tiles, two layers, METADATA; 32 lattice bits."""
    return build(Plan(
        "container", (SCALE3,), (LayerRow((0,), ((1,),)), LayerRow((0, 0), ((2,), (1,)))),
        (Tile(1, 27, 1), Tile(2, 27, 16), Tile(1, 26, 5)), (4, 3, 5), bits=32, spread=1, metadata=_METADATA,
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
        "container root", (SCALE3,), (LayerRow((0,), ((1,),)),), (Tile(0, 31, 0),), (3,), bits=32, spread=1,
    ))


@cache
def crowd_scene(counts: tuple[int, ...]) -> QuantisedScene:
    """Explicit profile: tiles of one cell, which do not distinguish anchors; every table has one symbol.

    Args:
        counts: anchors of each tile, at most 8 of them.
    """
    return build(Plan(
        "container crowd", (SCALE3,), (LayerRow((0,), ((1,),)),), tuple(Tile(1, 0, n) for n in range(len(counts))),
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


PAGED_TILES = (
    Tile(1, 27, 0), Tile(2, 26, 9), Tile(2, 25, 16), Tile(5, 20, 0o21000), Tile(1, 29, 3),
    Tile(21, 8, (4 << 60) + 12345), Tile(21, 11, (1 << 63) - 1),
)  # fmt: skip
"""Tiles of depths that differ within a page and from page to page. Some begin where the one before ends; the last ends
at the end of all codes."""


@cache
def paged_scene() -> QuantisedScene:
    """Explicit profile: seven tiles, two layers.

    In pages of two, the second page has no anchors, the third none that come in layer 2, the fourth none in layer 1.
    """
    scene = build(Plan(
        "container pages", (SCALE3,), (LayerRow((1,), ((1,),)), LayerRow((1, 1), ((1,), (1,)))), PAGED_TILES,
        (5, 2, 0, 0, 4, 1, 3), bits=32, dimension=2, codewords=(3, 3), spread=1, metadata=_METADATA,
    ))  # fmt: skip
    for number, class_ in ((4, 0), (5, 0), (6, 1)):
        content = scene.contents[number]
        content.classes[:] = class_
        content.codes = np.sort(content.codes)
    return scene


@cache
def many_pages_scene(tiles: int) -> QuantisedScene:
    """Explicit profile: so many tiles, up to 4096, and no anchors."""
    return build(Plan(
        "container many pages", (SCALE3,), (LayerRow((0,), ((1,),)),), tuple(Tile(4, 0, n) for n in range(tiles)),
        (0,) * tiles, bits=4,
    ))  # fmt: skip


@cache
def plain_file() -> bytes:
    """The file of :func:`plain_scene`."""
    return write_file(plain_scene())


@cache
def paged_file() -> bytes:
    """The file of :func:`paged_scene` in pages of two tiles."""
    return write_file(paged_scene(), WriteOptions(page_bits=1))


@cache
def many_pages_file(tiles: int) -> bytes:
    """The file of :func:`many_pages_scene` in pages of one tile, each with a TILE block of five bytes."""
    return write_file(many_pages_scene(tiles), WriteOptions(page_bits=0, empty_tiles=True))


@cache
def anchor_file() -> bytes:
    """The file of :func:`anchor_scene`."""
    return write_file(anchor_scene())


@cache
def root_file() -> bytes:
    """The file of :func:`root_scene`."""
    return write_file(root_scene())
