"""Seeing a scene as a whole without holding it: some rows, and few Gaussians that stand for all (encoder only).

What a picture shows of a range depends on what is before and behind it. Runs of neighbours in Morton order are merged
to one Gaussian each, which covers as much and has their mean colour; drawn with the Gaussians of one range, those of
all others hide it about as the scene itself does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.importance.view_sampling import Views, ViewSet, judging_views, sample_views
from reference_encoder.options import EncodeOptions
from reference_encoder.out_of_core.types import Bounds, Range
from reference_encoder.tuning import JUDGING_RANGES, MOST_PROXIES, OVERVIEW_ROWS, PROXY_RUN
from scarfmt.arrays import F64, I64
from scarfmt.render.projection import Drawable
from scarfmt.scene.gaussians import GaussianScene, concatenate
from scarfmt.scene.rotation import matrix_from_quaternion, quaternion_from_matrix

_MOST_OPACITY = 0.99

RangeSummary = tuple[GaussianScene, GaussianScene]
"""Some Gaussians of a range, and those that stand for all of them; without view-dependent colour."""


@dataclass(frozen=True)
class Overview:
    """The whole scene, as far as it is known before anything is measured.

    Attributes:
        options: of the encoder; the frame is the one that was found.
        bounds: of the scene.
        survey: where it is looked at from.
        proxies: of all ranges, one after another, without view-dependent colour.
        run: Gaussians that each stands for, neighbours in Morton order.
        edges: (ranges + 1,) int64: proxies of range k are those from `edges[k]` to below `edges[k + 1]`.
        judging: numbers of the ranges by which results are judged.
        views: what these are judged by.
    """

    options: EncodeOptions
    bounds: Bounds
    survey: Views
    proxies: GaussianScene
    run: int
    edges: I64
    judging: tuple[int, ...]
    views: Mapping[ViewSet, Views]

    def make_drawable(self, part: Range, scene: GaussianScene, runs: tuple[int, int] | None = None) -> Drawable:
        """Gaussians of a range, then proxies of all others, ready to be drawn.

        Args:
            scene: all its Gaussians, or some that stand for those of some runs.
            runs: of the range, the first of these runs and the one past the last; None for all.
        """
        begin, end = (int(edge) for edge in self.edges[part.number : part.number + 2])
        first, past = (0, end - begin) if runs is None else runs
        others = [self.proxies.rows(slice(0, begin + first)), self.proxies.rows(slice(begin + past, None))]
        return Drawable.of(concatenate([scene, *others]))


def summarise_range(scene: GaussianScene, part: Range, bounds: Bounds, options: EncodeOptions) -> RangeSummary:
    """Look at a range for what the whole needs of it: some Gaussians, drawn evenly; and those that stand for all.

    Args:
        scene: the Gaussians of the range, at least one, without NaN or infinity.
        options: `seed`.
    """
    order = np.argsort(bounds.paths(scene.positions), kind="stable")
    plain = scene.with_sh_degree(0)
    rows = sample_evenly(len(order), OVERVIEW_ROWS / bounds.count, options.seed + part.number)
    return plain.take(order[rows]), merge_runs(plain.take(order), run_length(bounds))


def run_length(bounds: Bounds) -> int:
    """Neighbours that one proxy stands for."""
    return max(PROXY_RUN, -(-bounds.count // MOST_PROXIES))


def build_overview(
    summaries: Sequence[RangeSummary], parts: Sequence[Range], bounds: Bounds, options: EncodeOptions
) -> Overview:
    """Put together what all ranges give.

    Raises:
        InvalidInput: ``input-frame``.
    """
    rows, proxies = (concatenate(parts) for parts in zip(*summaries, strict=True))
    edges = np.cumsum([0, *(len(own) for _, own in summaries)])
    looked = sample_views(rows, options, bounds.count)
    found = replace(options, frame=looked.up.up)
    judging = judging_ranges(len(parts), options.seed)
    views = {view_set: judging_views(rows, options, looked.up, view_set, bounds.count) for view_set in ViewSet}
    return Overview(found, bounds, looked, proxies, run_length(bounds), edges, judging, views)


def judging_ranges(ranges: int, seed: int) -> tuple[int, ...]:
    """Numbers of the ranges, of so many, by which results are judged: spread over the scene."""
    count = min(ranges, JUDGING_RANGES)
    shift = np.random.default_rng(seed).random()
    return tuple(int((k + shift) * ranges / count) for k in range(count))


def sample_evenly(count: int, share: float, seed: int) -> I64:
    """Choose `share` of `count` neighbours in a row, evenly; at least one."""
    if share >= 1:
        return np.arange(count)
    first = np.random.default_rng(seed).random() / share
    found = np.arange(first, count, 1 / share).astype(np.int64)
    return found if len(found) else np.array([count // 2])


def merge_runs(scene: GaussianScene, run: int) -> GaussianScene:
    """One Gaussian for every run of so many: with their mean and covariance, each by what it covers, and as much cover.

    Args:
        scene: Gaussians without view-dependent colour, neighbours beside each other.
        run: the last may be shorter.
    """
    starts = np.arange(0, len(scene), run)
    opacity = 1 / (1 + np.exp(-scene.opacity_logits.astype(np.float64)))
    scales = np.exp(np.clip(scene.log_scales.astype(np.float64), -40, 40))
    weight = opacity * _faces(scales) + 1e-300

    def mean(values: F64) -> F64:
        flat = values.reshape(len(scene), -1) * weight[:, None]
        return np.asarray(np.add.reduceat(flat, starts) / np.add.reduceat(weight, starts)[:, None])

    middle = mean(scene.positions)
    away = scene.positions - np.repeat(middle, np.diff(np.append(starts, len(scene))), axis=0)
    axes = matrix_from_quaternion(scene.rotations) * scales[:, None, :]
    spread = mean(axes @ axes.transpose(0, 2, 1) + away[:, :, None] * away[:, None, :]).reshape(-1, 3, 3)
    variances, turned = np.linalg.eigh(spread)
    turned[:, :, 0] *= np.sign(np.linalg.det(turned))[:, None]
    sides = np.sqrt(np.maximum(variances, np.exp(-80)))
    shown = np.clip(np.add.reduceat(weight, starts) / np.maximum(_faces(sides), 1e-300), 1e-4, _MOST_OPACITY)
    return GaussianScene(
        middle,
        np.log(sides).astype(np.float32),
        quaternion_from_matrix(turned).astype(np.float32),
        np.log(shown / (1 - shown)).astype(np.float32),
        mean(scene.sh.astype(np.float64)).reshape(-1, 1, 3).astype(np.float32),
        description=scene.description,
    )


def _faces(scales: F64) -> F64:
    """(n,) product of the two longest of (n, 3) axes."""
    return np.asarray(np.sort(scales, axis=1)[:, 1:].prod(axis=1))
