"""Scenes with a STREAMING block (SPEC §7.13)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np

from conformance.scenes.cases import Case, edge
from conformance.scenes.container_scenes import anchor_scene, plain_scene
from conformance.scenes.made import build, static_plans
from conformance.scenes.prng import Prng
from conformance.writer.file import write_file
from scarfmt.blocks.streaming import Streaming, View
from scarfmt.coding.writer import QuantisedScene

_VIEW = View(np.array([1.5, -0.25, 1e-30]), np.array([0.0, 4.0, -1e6]), np.array([0.0, -2.0, 0.0]), 1.25)


def random_boxes(seed: str, tiles: int, view: View | None = None) -> Streaming:
    """Boxes and reaches that mean nothing."""
    prng = Prng(f"streaming {seed}")
    corners = np.sort(prng.integers(0, 256, (2, tiles, 3)), axis=0).astype(np.uint8)
    return Streaming(corners[0], corners[1], prng.integers(0, 256, tiles).astype(np.uint8), view)


@cache
def streaming_scene() -> QuantisedScene:
    """Explicit profile: two layers, three tiles, METADATA, boxes, a view."""
    return replace(plain_scene(), streaming=random_boxes("plain", 3, _VIEW))


@cache
def streaming_file() -> bytes:
    """The file of :func:`streaming_scene`."""
    return write_file(streaming_scene())


def streaming_cases() -> Iterator[Case]:
    """Vectors of the class ``edge``: what the block may hold, and where it may not matter."""
    rules = ("R-7.13-1",)
    least = replace(plain_scene(), streaming=random_boxes("least", 3))
    yield edge("streaming-least", "no view: boxes alone", least, rules)
    empty = build(static_plans()["no-anchors"][1])
    none = replace(empty, streaming=random_boxes("empty", 0))
    yield edge("streaming-no-tiles", "a file without tiles", none, rules)
    numbers = random_boxes("numbers", 1, replace(_VIEW, fov=float(np.float32(3.1415925))))
    numbers.low[:], numbers.high[:] = ((0, 128, 255),), ((255, 128, 255),)
    yield edge("streaming-numbers", "numbers at the ends of their ranges; anchor profile",
               replace(anchor_scene(), streaming=numbers), rules)
