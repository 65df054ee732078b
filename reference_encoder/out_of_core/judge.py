"""Quality of pictures, from ranges that are judged each by itself (encoder only; docs/decisions/0044).

Errors of ranges that lie elsewhere have nothing in common: what each adds to the mean squared error of a picture, all
others being drawn as they are, adds up. Where pieces of some ranges stand for all, the rest of a picture is taken to
err as the part does that they make up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from reference_encoder.importance.view_sampling import ViewSet
from reference_encoder.importance.weights import Weights
from reference_encoder.judge.quality import Quality, cap_db, shows_something
from reference_encoder.judge.reconstruct import reconstruct_gaussians
from reference_encoder.out_of_core.fit import Fit, apply
from reference_encoder.out_of_core.measure import find_meeting_views
from reference_encoder.out_of_core.overview import Overview
from reference_encoder.out_of_core.types import Range
from reference_encoder.tuning import JUDGED_ROWS, LEAST_COVER
from scarfmt.arrays import F32, F64, I64
from scarfmt.render.rasterise import render, render_with
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.threads import map_threads


@dataclass(frozen=True)
class Pictures:
    """Pictures of the source from those judging views that meet a range.

    Attributes:
        view_set: which views.
        scene, measured: the Gaussians that the range is judged by, and what they weigh.
        runs: the first of their runs in the range, and the one past the last.
        views: (V,) int64 which of them, all kinds one after another; none that shows next to nothing.
        pictures: (height, width, 3) float32 of each.
        cover: (V,) float64 part of what each shows that the range makes up.
    """

    view_set: ViewSet
    scene: GaussianScene
    measured: Weights
    runs: tuple[int, int]
    views: I64
    pictures: Sequence[F32]
    cover: F64


def choose_piece(overview: Overview, part: Range, scene: GaussianScene) -> tuple[I64, tuple[int, int]]:
    """Choose neighbours to judge a range by: (n,) Gaussians; the first of their runs and the one past the last."""
    order, run = np.argsort(overview.bounds.paths(scene.positions), kind="stable"), overview.run
    runs, most = -(-len(order) // run), JUDGED_ROWS // run
    if runs <= most:
        return order, (0, runs)
    first = int(np.random.default_rng([overview.options.seed, part.number]).integers(runs - most + 1))
    return order[first * run : (first + most) * run], (first, first + most)


def render_pictures(
    overview: Overview, part: Range, scene: GaussianScene, measured: Weights, view_set: ViewSet = ViewSet.TUNING
) -> Pictures:
    """Pictures of the source to judge a range by."""
    rows, runs = choose_piece(overview, part, scene)
    scene, measured = scene.take(rows), measured.take(rows)
    cameras, drawable = overview.views[view_set].cameras, overview.make_drawable(part, scene, runs)
    views = find_meeting_views(cameras, scene)
    looked = [cameras[number] for number in views]
    own = np.ones((len(drawable.scene), 3))
    own[len(scene) :, 0] = 0
    shown, cover = [], []
    for picture, whose in map_threads(partial(render_with, drawable, colours=own), looked):
        here, whole, _ = whose.sum(axis=(0, 1), dtype=np.float64)
        shown.append(picture)
        cover.append(here / max(whole, 1e-300) * shows_something(picture))
    seen = np.flatnonzero(np.array(cover) > 0)
    return Pictures(view_set, scene, measured, runs, views[seen], [shown[k] for k in seen], np.array(cover)[seen])


def judge(overview: Overview, fit: Fit, part: Range, shown: Pictures) -> F64:
    """Judge a range by what it adds to the errors of pictures under a Fit.

    Returns:
        (2, V) for every view: its mean squared error, peak 1, 0 where the range is not seen; and the part of what the
        picture shows that the range makes up, 0..1.
    """
    whole, _ = apply(overview, fit, part, shown.scene, shown.measured)
    finished = reconstruct_gaussians(whole) if whole.tiles else shown.scene.rows(slice(0, 0))
    cameras = overview.views[shown.view_set].cameras
    error, cover = np.zeros(len(cameras)), np.zeros(len(cameras))
    drawable = overview.make_drawable(part, finished, shown.runs)
    drawn = map_threads(partial(render, drawable), [cameras[k] for k in shown.views])
    for view, picture, truth in zip(shown.views, drawn, shown.pictures, strict=True):
        error[view] = float(((np.clip(picture, 0, 1).astype(np.float64) - np.clip(truth, 0, 1)) ** 2).mean())
    cover[shown.views] = shown.cover
    return np.stack([error, cover])


def combine_quality(overview: Overview, judged: Sequence[F64], view_set: ViewSet = ViewSet.TUNING) -> Quality:
    """Quality of pictures of the scene, from what ranges add to their errors (:func:`judge`)."""
    views, most = overview.views[view_set], cap_db(overview.options.asked_db)
    error, cover = np.sum(judged, axis=0)
    cover = np.minimum(cover, 1.0)
    found: dict[str, F64] = {}
    first = 0
    for kind, cameras in views.views.items():
        here = slice(first, first + len(cameras))
        first += len(cameras)
        covered = cover[here] > LEAST_COVER
        if covered.any():
            mean = error[here][covered] / cover[here][covered]
            found[kind] = np.minimum(-10 * np.log10(np.maximum(mean, 1e-30)), most)
    return Quality(found, views.shares)
