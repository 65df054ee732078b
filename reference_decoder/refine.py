"""Refining baked Gaussians: all of them together, until they show what the anchors' networks show.

Each step draws one view twice, as the networks have it and as the Gaussians do, and moves the Gaussians by Adam (Kingma
and Ba 2015) against the squared difference. Views come in turns, each turn in an order of its own. Of a view only one
pixel of each n x n is drawn, others each time, so that a step takes as long for large photos as for small ones; splats
are as wide as in the whole picture. A Gaussian that a view does not show is left as it is, its moments too.

Rates are those of 3DGS training, falling to 0 along a cosine; positions move in units of the Gaussian's own size.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reference_decoder.anchors import gaussians
from scarfmt.arrays import F32, F64, I64, Floats
from scarfmt.coding.writer import Report, silent
from scarfmt.render.camera import Camera
from scarfmt.render.gradients import Gradients, gradients
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.scene.placement import sh_basis
from scarfmt.threads import map_threads

_SAMPLES = 1 << 17
"""Pixels of a step, about."""
_BASE_RATE, _BAND_RATE = 2.5e-3, 1e-3
_LOGIT_RATE, _SCALE_RATE, _TURN_RATE, _PLACE_RATE = 0.05, 0.005, 0.002, 0.02
_LEAST_PART = 0.02
"""Share of the learning rates that is left at the end."""
_FIRST_DECAY, _SECOND_DECAY, _EPSILON = 0.9, 0.99, 1e-10
_SEED = 1


def refine(
    model: AnchorModel, baked: GaussianScene, views: Sequence[Camera], steps: int, report: Report = silent
) -> GaussianScene:
    """A baked scene whose pictures come nearer to those of its model. The same arguments, the same result.

    Args:
        model: what the pictures should show, with all three networks.
        baked: where to begin.
        views: cameras to draw from, at least one.
        steps: one picture each.
        report: called with (stage, fraction done).

    Raises:
        InvalidInput: ``input-mlp`` when a network is missing.
    """
    scene = baked.take(np.arange(len(baked)))
    descent = _Descent.of(scene)
    drawn = _turns(views, steps)
    for step, (view, picture) in enumerate(_pictures(model, drawn)):
        _, found = gradients(Drawable.of(scene), view, picture)
        part = max(_LEAST_PART, 0.5 * (1 + math.cos(math.pi * step / steps)))
        descent.step(found, view.centre, part)
        report("refining", (step + 1) / steps)
    return scene


def _turns(views: Sequence[Camera], steps: int) -> list[Camera]:
    """The views of all steps, sampled."""
    numbers = np.random.default_rng(_SEED)
    turns = -(-steps // len(views))
    order = np.concatenate([numbers.permutation(len(views)) for _ in range(turns)])[:steps]
    return [_sample_pixels(views[number], numbers) for number in order]


def _sample_pixels(view: Camera, numbers: np.random.Generator) -> Camera:
    """One pixel of each n x n of a view, at a random place in them, the same in all."""
    every = max(1, round(math.sqrt(view.width * view.height / _SAMPLES)))
    sampled = view.sample(every)
    shift = (0.5 * (every - 1) - numbers.integers(0, every, 2)) / every
    return replace(sampled, cx=sampled.cx + float(shift[0]), cy=sampled.cy + float(shift[1]))


def _pictures(model: AnchorModel, views: Sequence[Camera]) -> Iterator[tuple[Camera, F32]]:
    """Each view with what the model shows, drawn while others are used."""

    def exact(view: Camera) -> tuple[Camera, F32]:
        seen = gaussians(model, view.centre)
        return view, render(seen.scene, view, colours=seen.colours)

    return map_threads(exact, views)


@dataclass(frozen=True)
class _Moments:
    """Running means of a parameter's derivative and of its square, (N, ...) float32."""

    first: F32
    second: F32

    @staticmethod
    def of(shape: tuple[int, ...]) -> _Moments:
        return _Moments(np.zeros(shape, np.float32), np.zeros(shape, np.float32))

    def move(self, rows: I64, slopes: Floats, seen: F32) -> F32:
        """How far to go down the (V, ...) slopes of some rows, seen for the (V,)-th time, at a rate of 1."""
        slopes, times = slopes.astype(np.float32), seen.reshape(-1, *[1] * (slopes.ndim - 1))
        first = _FIRST_DECAY * self.first[rows] + (1 - _FIRST_DECAY) * slopes
        second = _SECOND_DECAY * self.second[rows] + (1 - _SECOND_DECAY) * slopes * slopes
        self.first[rows], self.second[rows] = first, second
        deviation = np.sqrt(second / (1 - _SECOND_DECAY**times)) + _EPSILON
        return np.asarray(first / (1 - _FIRST_DECAY**times) / deviation)


@dataclass(frozen=True)
class _Descent:
    """Adam over the numbers of a scene, in place; `times` (N,) float32, how often each Gaussian was seen."""

    scene: GaussianScene
    times: F32
    sh: _Moments
    logit: _Moments
    scale: _Moments
    turn: _Moments
    place: _Moments

    @staticmethod
    def of(scene: GaussianScene) -> _Descent:
        n = len(scene)
        three = (_Moments.of((n, 3)) for _ in range(3))
        return _Descent(scene, np.zeros(n, np.float32), _Moments.of(scene.sh.shape), _Moments.of((n,)), *three)

    def step(self, slopes: Gradients, eye: F64, part: float) -> None:
        """One step down, at `part` of the rates."""
        scene, rows = self.scene, slopes.index
        self.times[rows] += 1
        seen = self.times[rows]
        towards = scene.positions[rows] - eye
        basis = sh_basis(towards / np.linalg.norm(towards, axis=1, keepdims=True), scene.sh_degree)
        rates = np.full((basis.shape[1], 1), part * _BAND_RATE, np.float32)
        rates[0] = part * _BASE_RATE
        scene.sh[rows] -= rates * self.sh.move(rows, basis[:, :, None] * slopes.colour[:, None, :], seen)
        size = np.exp(scene.log_scales[rows].astype(np.float64).mean(axis=1))[:, None]
        scene.positions[rows] -= part * _PLACE_RATE * size * self.place.move(rows, slopes.position * size, seen)
        scene.opacity_logits[rows] -= part * _LOGIT_RATE * self.logit.move(rows, slopes.logit, seen)
        scene.log_scales[rows] -= part * _SCALE_RATE * self.scale.move(rows, slopes.log_scale, seen)
        turns = part * _TURN_RATE * self.turn.move(rows, slopes.turn, seen)
        scene.rotations[rows] = _turn(scene.rotations[rows], -turns)


def _turn(rotations: F32, turns: F32) -> F32:
    """(V, 4) quaternions turned by small (V, 3) angles about their own axes, radians; not normalised again."""
    w, axis, half = rotations[:, :1], rotations[:, 1:], 0.5 * turns
    return np.hstack([w - (axis * half).sum(axis=1, keepdims=True), axis + w * half + np.cross(axis, half)])
