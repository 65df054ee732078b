"""Valid vectors whose activated values need care in binary32: squares that overflow or vanish, sums that cancel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from conformance.scenes.cases import Case
from conformance.scenes.made import ANCHOR_CHANNELS, FEATURES, Plan, build, channel, mlp, steady
from conformance.scenes.prng import Prng
from conformance.writer.file import write_file
from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import Profile, Stream
from scarfmt.scene.model import Channel

_WHOLE = (Tile(0, 0, 0),)
_LIMIT = (1 << 31) - 1
_SHORT = 2.0**-80
"""Quaternions of about so many units: their squares are 0 in binary32."""


def activation_cases() -> Iterator[Case]:
    """Vectors of both profiles, each of the class ``edge``."""
    yield _edge("activation-extremes", "rotations of u and v up to 1.7e38, colours of Y, G and O that cancel",
                _extremes(), "R-9.3-1", "R-9.4-2")  # fmt: skip
    far = build(_anchors("far", 2.0**900))
    without_distance = tuple(mlp(Prng(f"edge far {width}"), FEATURES + 3, 6, 3 * width) for width in (1, 7, 3))
    yield _edge("anchors-far", "anchors 1e272 from the camera: squares of distances overflow binary64",
                replace(far, scene_mlps=without_distance), "R-9.6-1")  # fmt: skip
    near = build(_anchors("near", 2.0**-700))
    opacity, covariance, colour = near.scene_mlps
    yield _edge("anchors-near", "anchors 1e-210 from the camera, and quaternions 1e-24 long: their squares vanish",
                replace(near, scene_mlps=(opacity, _short(covariance), colour)), "R-9.6-1")  # fmt: skip
    seen = _edge("anchors-camera", "Gaussians for a camera that is not at the origin of the header",
                 build(_anchors("camera", 0.125)), "R-9.6-1")  # fmt: skip
    yield replace(seen, camera=(3.25, -1.5, 40.0))


def _edge(name: str, purpose: str, scene: QuantisedScene, *rules: str) -> Case:
    return Case(f"edge/{name}", purpose, write_file(scene), ("R-9.5-1", *rules), scene=scene)


def _extremes() -> QuantisedScene:
    channels = (
        channel(Stream.SCALE, 0.5, 3),
        Channel(Stream.ROTATION, (2.0**96, 2.0**96, 0.25)),
        Channel(Stream.COLOUR, (0.5,) * 3),
    )
    plan = Plan("edge activation extremes", channels, steady(1, 0, (1, 1, 1)), _WHOLE, (10,), bits=6)
    scene = build(plan)
    (content,) = scene.contents
    most, large = _LIMIT, 1 << 25
    rotations = [(most, most), (most, -most), (-most, 0), (12, -1), (1, 12), (0, 0), (0, 1), (-12, 12)]
    colours = [(1, large, large), (large, large, 1), (large, -large, -3), (-large, large, 2 * large), (1, 1, 1)]
    content.values[1][:, :2] = np.array(rotations)[np.arange(10) % len(rotations)]
    content.values[2][:] = np.array(colours)[np.arange(10) % len(colours)]
    return scene


def _anchors(seed: str, voxel: float) -> Plan:
    """Around the camera, at the origin."""
    return Plan(f"edge {seed}", ANCHOR_CHANNELS, steady(1, 1, (1, 1)), _WHOLE, (12,), bits=7, profile=Profile.ANCHOR,
                slots=3, dimension=3, codewords=(5, 5), spread=2, origin=(0.0, 0.0, 0.0), voxel=voxel)  # fmt: skip


def _short(covariance: QuantisedMlp) -> QuantisedMlp:
    """Quaternions, not standard deviations, shorter."""
    first, last = covariance.layers
    factors = np.where(np.arange(len(last.scales)) % 7 < 3, 1, _SHORT).astype(np.float32)
    return QuantisedMlp((first, replace(last, scales=last.scales * factors, biases=last.biases * factors)))
