"""The STREAMING block of a file: boxes of tiles, gains from some viewpoints, and a first view (SPEC §7.13).

Linear in the number of Gaussians: pictures from a few dozen views say what each weighs, its values after each layer how
far it still is from the last, and tiles add that up. No tile is drawn by itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.judge.finished import finished_anchors, finished_gaussians
from reference_encoder.measure.survey import GIVEN, survey
from reference_encoder.measure.weights import PIXEL
from reference_encoder.options import EncodeOptions
from reference_encoder.streaming.errors import LayerErrors, gaussian_errors
from reference_encoder.streaming.eyes import Eye, eyes
from scarfmt.arrays import F64, I64
from scarfmt.blocks.streaming import GAIN_OF_ONE, GAIN_STEPS, REACH_OF_SIDE, Levels, Streaming, View
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import tile_table
from scarfmt.container.schema import Profile
from scarfmt.render.camera import Camera
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import contributions_by_view
from scarfmt.render.viewpoints import Surroundings
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.streaming import view as planning
from scarfmt.streaming.boxes import coverage, cubes, tight_boxes
from scarfmt.streaming.plan import BEHIND
from scarfmt.streaming.view import share_in_picture
from scarfmt.tools.annotate import with_streaming

USUAL_VIEWPOINTS, LEAST_VIEWPOINTS = 8, 4
GAIN_SHARE = 0.005
"""Part of a file that gains take up, where nobody says how many viewpoints."""
_BULK = 0.9
"""Share of the visible content of a tile that sticks out of its box no further than its reach."""
_DEVIATIONS = 2.0
_FIRST_ELEVATION, _FIRST_DISTANCE = 20.0, 1.6
_HARDLY = 0.1
"""Part of a tile in the pictures of an eye below which the eye has no gain of it."""
_FILLED = 0.5
"""Part of the gain usual for its size that such a tile gets for this eye."""


def usual_viewpoints(scene: QuantisedScene, size: int) -> int:
    """Number of viewpoints by default: none for a single tile, of which there is no choice.

    Args:
        size: of the file, bytes.
    """
    tiles, layers = len(scene.tiles), len(scene.model.layers)
    return 0 if tiles < 2 else min(max(int(GAIN_SHARE * size / (tiles * layers)), LEAST_VIEWPOINTS), USUAL_VIEWPOINTS)


def streamed(data: bytes, scene: QuantisedScene, options: EncodeOptions) -> bytes:
    """The file, with the STREAMING block that `options` ask for.

    A single tile, of which there is no choice, has its box and a view to begin with told where cameras are known.

    Args:
        data: of `scene`.
        scene: all integers of it.
        options: what it was encoded with.
    """
    usual = options.viewpoints is None
    count = usual_viewpoints(scene, len(data)) if options.viewpoints is None else options.viewpoints
    return with_streaming(data, told(scene, options, count)) if count or (usual and options.cameras) else data


def told(scene: QuantisedScene, options: EncodeOptions, count: int) -> Streaming:
    """The values of the STREAMING block of a file.

    Args:
        scene: all integers of it.
        options: what it was encoded with: its cameras, or those that stand for anywhere, give viewpoints and view.
        count: most viewpoints; with 0, only boxes and the view.
    """
    drawn = _drawn(scene)
    shell = drawn if isinstance(drawn, GaussianScene) else _shell(drawn)
    views = survey(shell, options)
    given = views.views.get(GIVEN)
    matter = given or views.cameras
    places = eyes(matter, max(count, 1))
    seen = _seen(scene, drawn, places, options.seed)
    tile = np.repeat(np.arange(len(scene.tiles)), [len(content) for content in scene.contents])
    low, high, reach = _boxes(scene, shell, tile, seen.shape.sum(axis=0), _extents(drawn))
    viewpoints = np.array([eye.centre for eye in places]).astype(np.float32)
    gains = np.zeros((len(places), len(scene.model.layers), len(scene.tiles)), np.uint8)
    first = eyes(matter, USUAL_VIEWPOINTS)[0].cameras[0] if given else None
    streaming = Streaming(low, high, reach, viewpoints, gains, _view(shell, options, first))
    gains[:] = _levels(_filled(_tile_gains(seen, tile, len(scene.tiles)), scene, streaming, places))
    return streaming if count else replace(streaming, viewpoints=viewpoints[:0], gains=gains[:0])


@dataclass(frozen=True)
class _Seen:
    """N anchors seen from V eyes.

    Attributes:
        shape, colour: (V, N) float64 what they weigh: squared error of a picture per squared unit.
        errors: after no layer, after layer 1, and so on to the last but one.
    """

    shape: F64
    colour: F64
    errors: Sequence[LayerErrors]


def _drawn(scene: QuantisedScene) -> GaussianScene | AnchorModel:
    return finished_gaussians(scene) if scene.fields.profile == Profile.EXPLICIT else finished_anchors(scene)


def _shell(model: AnchorModel) -> GaussianScene:
    """A Gaussian on every anchor, of which only the place counts."""
    n = len(model)
    zeros = (np.zeros((n, 3), np.float32), np.zeros((n, 4), np.float32), np.zeros(n, np.float32))
    return GaussianScene(model.anchors, *zeros, np.zeros((n, 1, 3), np.float32))


def _seen(scene: QuantisedScene, drawn: GaussianScene | AnchorModel, places: Sequence[Eye], seed: int) -> _Seen:
    if isinstance(drawn, AnchorModel):
        from reference_encoder.streaming.anchors import AnchorWeights, anchor_errors  # needs torch

        weights = AnchorWeights(drawn, places, seed)
        return _Seen(weights.shape, weights.colour, anchor_errors(scene, drawn, weights))
    shape, colour = np.zeros((2, len(places), len(drawn)))
    ready = Drawable.of(drawn)
    for number, eye in enumerate(places):
        for camera, seen in zip(eye.cameras, contributions_by_view(ready, eye.cameras, sh_degree=0), strict=True):
            samples = camera.width * camera.height * 3
            shape[number, seen.index] += seen.contrast_sq / samples
            colour[number, seen.index] += seen.weight_sq / samples
    away = np.min([((drawn.positions - eye.centre) ** 2).sum(axis=1) for eye in places], axis=0)
    return _Seen(shape, colour, gaussian_errors(scene, drawn, PIXEL * np.sqrt(away)))


def _tile_gains(seen: _Seen, tile: I64, tiles: int) -> F64:
    """(V, L, T) float64 squared error that each layer takes away, sums over the pictures of an eye."""
    left = np.zeros((len(seen.shape), len(seen.errors) + 1, tiles))
    for layer, errors in enumerate(seen.errors):
        for number, (shape, colour) in enumerate(zip(seen.shape, seen.colour, strict=True)):
            left[number, layer] = np.bincount(tile, shape * errors.shape + colour * errors.colour, tiles)
    return np.asarray(left[:, :-1] - left[:, 1:])


def _filled(gains: F64, scene: QuantisedScene, streaming: Streaming, places: Sequence[Eye]) -> F64:
    """Gains of a picture that has all of the tile in it, from those summed over all pictures of an eye.

    An eye that had hardly any of a tile in its pictures is told what other eyes gain of it, by how large it looks.
    """
    boxes = tight_boxes(cubes(scene.fields, tile_table(scene.tiles)), streaming)
    shares = np.array(
        [sum(share_in_picture(boxes, _planned(camera), 1.0) for camera in eye.cameras) for eye in places]
    )
    # As planners count it.
    looked = np.maximum(shares, BEHIND)
    sizes = np.array([coverage(boxes, eye.centre) for eye in places])
    gains = np.maximum(gains, 0)
    usual = gains.sum(axis=0) / (sizes * looked).sum(axis=0)
    filled = _FILLED * usual * sizes[:, None]
    return np.asarray(np.where((shares > _HARDLY)[:, None], gains / looked[:, None], filled))


def _planned(camera: Camera) -> planning.Camera:
    """A view as planners have it."""
    pose, field = camera.world_to_camera, 2 * math.atan(camera.height / (2 * camera.fy))
    return planning.Camera(camera.centre, pose[2, :3], -pose[1, :3], field, camera.width, camera.height)


def _levels(gains: F64) -> Levels:
    """Coded levels of gains. A gain that is zero or negative is 0."""
    with np.errstate(divide="ignore"):
        steps = np.rint(GAIN_OF_ONE + GAIN_STEPS * np.log2(np.maximum(gains, 0)))
    return np.asarray(np.clip(steps, 0, 255).astype(np.uint8))


def _extents(drawn: GaussianScene | AnchorModel) -> F64:
    """(N,) how far what an anchor stands for reaches from its place, world units."""
    if isinstance(drawn, GaussianScene):
        return np.asarray(_DEVIATIONS * np.exp(drawn.log_scales.max(axis=1).astype(np.float64)))
    scaling = np.exp(drawn.log_scaling.astype(np.float64))
    offsets = np.abs(drawn.offsets * scaling[:, None, :3]).max(axis=(1, 2), initial=0)
    return np.asarray(offsets + scaling[:, 3:].max(axis=1))


def _boxes(
    scene: QuantisedScene, shell: GaussianScene, tile: I64, weight: F64, extents: F64
) -> tuple[Levels, Levels, Levels]:
    """Corners (T, 3), (T, 3) and reaches (T,) as the block has them."""
    every = cubes(scene.fields, tile_table(scene.tiles))
    corner, side = every[:, :3], every[:, 3] - every[:, 0]
    tiles = len(side)
    low, high, reach = np.zeros((tiles, 3), np.uint8), np.zeros((tiles, 3), np.uint8), np.zeros(tiles, np.uint8)
    edges = np.searchsorted(tile, np.arange(tiles + 1))
    for number in range(tiles):
        part = slice(edges[number], edges[number + 1])
        places = 256 * (shell.positions[part] - corner[number]) / side[number]
        if len(places) == 0:
            continue
        low[number] = np.clip(np.floor(places.min(axis=0)), 0, 255)
        high[number] = np.clip(np.maximum(np.ceil(places.max(axis=0)) - 1, low[number]), 0, 255)
        margin = np.minimum(places - low[number], high[number] + 1.0 - places).min(axis=1) * side[number] / 256
        out = _quantile(np.maximum(extents[part] - margin, 0), weight[part] + 1e-300)
        if out > 0:
            reach[number] = np.clip(math.ceil(REACH_OF_SIDE + GAIN_STEPS * math.log2(out / side[number])), 1, 255)
    return low, high, reach


def _quantile(values: F64, weights: F64) -> float:
    """The least value that is not exceeded by :data:`_BULK` of the weights."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][min(int(np.searchsorted(total, _BULK * total[-1])), len(order) - 1)])


def _view(shell: GaussianScene, options: EncodeOptions, camera: Camera | None) -> View:
    """A view to begin with: that of the camera amid most of those given, else from outside and a little above."""
    around = Surroundings.of(shell, options.frame)
    if camera is None:
        eye = around.middle + _FIRST_DISTANCE * around.radius * around.direction(0.5, _FIRST_ELEVATION)
        camera = around.camera(eye, around.middle, "first")
    forward, down = camera.world_to_camera[2, :3], camera.world_to_camera[1, :3]
    ahead = max(float((around.middle - camera.centre) @ forward), 0.1 * around.radius)
    field = 2 * math.atan(camera.height / (2 * camera.fy))
    return View(camera.centre, camera.centre + ahead * forward, -down, field)
