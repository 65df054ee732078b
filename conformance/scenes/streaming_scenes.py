"""Scenes with a STREAMING block (SPEC §7.13)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np

from conformance.scenes.cases import Case
from conformance.scenes.container_scenes import anchor_scene, plain_scene
from conformance.scenes.made import build, static_plans
from conformance.scenes.prng import Prng
from conformance.surgery.files import vector_file
from scarfmt.blocks.streaming import Streaming, View
from scarfmt.coding.writer import QuantisedScene

_VIEW = View(np.array([1.5, -0.25, 1e-30]), np.array([0.0, 4.0, -1e6]), np.array([0.0, -2.0, 0.0]), 1.25)


def told(seed: str, tiles: int, layers: int, viewpoints: int, view: View | None = None) -> Streaming:
    """Boxes, reaches, viewpoints and gains that mean nothing."""
    prng = Prng(f"streaming {seed}")
    corners = np.sort(prng.integers(0, 256, (2, tiles, 3)), axis=0).astype(np.uint8)
    places = (prng.integers(-4096, 4097, (viewpoints, 3)) / 256).astype(np.float32)
    gains = prng.integers(0, 256, (viewpoints, layers, tiles)).astype(np.uint8)
    return Streaming(corners[0], corners[1], prng.integers(0, 256, tiles).astype(np.uint8), places, gains, view)


@cache
def streaming_scene() -> QuantisedScene:
    """Explicit profile: two layers, three tiles, METADATA, two viewpoints, a view."""
    return replace(plain_scene(), streaming=told("plain", 3, 2, 2, _VIEW))


@cache
def streaming_file() -> bytes:
    """The file of :func:`streaming_scene`."""
    return vector_file(streaming_scene())


def streaming_cases() -> Iterator[Case]:
    """Vectors of the class ``edge``: what the block may hold, and where it may not matter."""
    none = told("least", 3, 2, 0)
    yield _edge("least", "neither viewpoints nor a view: boxes alone", replace(plain_scene(), streaming=none))
    most = told("most", 3, 16, 64, _VIEW)
    most.gains[0], most.gains[1] = 0, 255
    yield _edge("most", "64 viewpoints, and gains of 16 layers where the file has two",
                replace(plain_scene(), streaming=most))
    empty = build(static_plans()["no-anchors"][1])
    yield _edge("no-tiles", "a file without tiles", replace(empty, streaming=told("empty", 0, 1, 3)))
    numbers = told("numbers", 1, 2, 2, replace(_VIEW, fov=float(np.float32(3.1415925))))
    numbers.low[:], numbers.high[:] = ((0, 128, 255),), ((255, 128, 255),)
    numbers.viewpoints[:] = ((-0.0, 3.4028235e38, 1e-45), (1, 2, 3))
    yield _edge("numbers", "numbers at the ends of their ranges; anchor profile",
                replace(anchor_scene(), streaming=numbers))


def _edge(name: str, purpose: str, scene: QuantisedScene) -> Case:
    return Case(f"edge/streaming-{name}", purpose, vector_file(scene), ("R-7.13-1",), scene=scene)
