"""Quality of pictures, from ranges that are judged each by itself (encoder only; docs/decisions/0044).

Errors of ranges that lie elsewhere have nothing in common: what each adds to the mean squared error of a picture, all
others being drawn as they are, adds up. Where pieces of some ranges stand for all, the rest of a picture is taken to
err as the part does that they make up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain

import numpy as np

from reference_encoder.judge.finished import finished_gaussians
from reference_encoder.judge.quality import Quality, most_db
from reference_encoder.judge.views import Sight
from reference_encoder.scale.applied import apply
from reference_encoder.scale.fit import Fit
from reference_encoder.scale.glance import Overview
from reference_encoder.scale.measured import met
from reference_encoder.scale.sample import rows_of
from reference_encoder.scale.steps import Judged, Measured, Range
from reference_encoder.tuning import JUDGED_ROWS, LEAST_COVER
from scarfmt.arrays import F32, F64, I64
from scarfmt.render.camera import Camera
from scarfmt.render.rasterise import render, render_with
from scarfmt.render.several import each_view
from scarfmt.scene.gaussians import GaussianScene


@dataclass(frozen=True)
class Pictures:
    """Pictures of the source from those judging views that meet a range.

    Attributes:
        sight: which views.
        scene, measured: the Gaussians that the range is judged by, and what they weigh.
        runs: the first of their runs in the range, and the one past the last.
        views: (V,) int64 which of them, all kinds one after another.
        pictures: (height, width, 3) float32 of each.
        cover: (V,) float64 part of what each shows that the range makes up.
    """

    sight: Sight
    scene: GaussianScene
    measured: Measured
    runs: tuple[int, int]
    views: I64
    pictures: Sequence[F32]
    cover: F64


def cameras_of(overview: Overview, sight: Sight) -> list[Camera]:
    """All views of a set, kind after kind."""
    return list(chain.from_iterable(overview.views[sight].cameras.values()))


def piece(overview: Overview, part: Range, scene: GaussianScene) -> tuple[I64, tuple[int, int]]:
    """Choose neighbours to judge a range by: (n,) Gaussians; the first of their runs and the one past the last."""
    order, run = np.argsort(overview.bounds.paths(scene.positions), kind="stable"), overview.run
    runs, most = -(-len(order) // run), JUDGED_ROWS // run
    if runs <= most:
        return order, (0, runs)
    first = int(np.random.default_rng([overview.options.seed, part.number]).integers(runs - most + 1))
    return order[first * run : (first + most) * run], (first, first + most)


def pictures(
    overview: Overview, part: Range, scene: GaussianScene, measured: Measured, sight: Sight = Sight.LOOP
) -> Pictures:
    """Pictures of the source to judge a range by.

    Args:
        overview: of the whole scene.
        part, scene, measured: the range, its Gaussians, and what they weigh.
        sight: which views.
    """
    rows, runs = piece(overview, part, scene)
    scene, measured = scene.take(rows), rows_of(measured, rows)
    cameras, drawable = cameras_of(overview, sight), overview.drawn(part, scene, runs)
    views = met(cameras, scene)
    looked = [cameras[number] for number in views]
    own = np.ones((len(drawable.scene), 3))
    own[len(scene) :, 0] = 0
    shown, cover = [], []
    for picture, whose in each_view(partial(render_with, drawable, colours=own), looked):
        here, whole, _ = whose.sum(axis=(0, 1), dtype=np.float64)
        shown.append(picture)
        cover.append(here / max(whole, 1e-300))
    seen = np.flatnonzero(np.array(cover) > 0)
    return Pictures(sight, scene, measured, runs, views[seen], [shown[k] for k in seen], np.array(cover)[seen])


def judge(overview: Overview, fit: Fit, part: Range, shown: Pictures) -> Judged:
    """Judge a range: what it adds to the errors of pictures under a Fit.

    Args:
        overview, fit: of the whole scene.
        part: the range.
        shown: pictures of it.
    """
    content = apply(overview, fit, part, shown.scene, shown.measured)
    finished = finished_gaussians(fit.scene(content)) if content.tiles else shown.scene.rows(slice(0, 0))
    cameras = cameras_of(overview, shown.sight)
    error, cover = np.zeros(len(cameras)), np.zeros(len(cameras))
    drawn = each_view(partial(render, overview.drawn(part, finished, shown.runs)), [cameras[k] for k in shown.views])
    for view, picture, truth in zip(shown.views, drawn, shown.pictures, strict=True):
        error[view] = float(((np.clip(picture, 0, 1).astype(np.float64) - np.clip(truth, 0, 1)) ** 2).mean())
    cover[shown.views] = shown.cover
    return Judged(error, cover)


def quality_of(overview: Overview, judged: Sequence[Judged], sight: Sight = Sight.LOOP) -> Quality:
    """Quality of pictures of the scene, from what ranges add to their errors."""
    views, most = overview.views[sight], most_db(overview.options.asked_db)
    error = np.sum([each.error for each in judged], axis=0)
    cover = np.minimum(np.sum([each.cover for each in judged], axis=0), 1.0)
    found: dict[str, F64] = {}
    first = 0
    for kind, cameras in views.cameras.items():
        here = slice(first, first + len(cameras))
        first += len(cameras)
        told = cover[here] > LEAST_COVER
        if told.any():
            mean = error[here][told] / cover[here][told]
            found[kind] = np.minimum(-10 * np.log10(np.maximum(mean, 1e-30)), most)
    return Quality(found, views.shares)
