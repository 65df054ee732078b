"""Seeing a scene as a whole without holding it: some rows, and few Gaussians that stand for all (encoder only).

What a picture shows of a range depends on what is before and behind it. Runs of neighbours in Morton order are merged
to one Gaussian each, which covers as much and has their mean colour; drawn with the Gaussians of one range, those of
all others hide it about as the scene itself does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.judge.views import Sight, Views, judged_views
from reference_encoder.measure.survey import Survey, survey
from reference_encoder.options import EncodeOptions
from reference_encoder.scale.steps import Bounds, Range
from reference_encoder.tuning import JUDGING_RANGES, MOST_PROXIES, OVERVIEW_ROWS, PROXY_RUN
from scarfmt.arrays import F64, I64
from scarfmt.errors import InvalidInput
from scarfmt.render.projection import Drawable
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.rotation import matrix_from_quaternion, quaternion_from_matrix

_MOST_OPACITY = 0.99


@dataclass(frozen=True)
class Glance:
    """A range's part of what is known of the whole.

    Attributes:
        rows: some of its Gaussians, drawn evenly, without view-dependent colour.
        proxies: those that stand for all of them, likewise.
    """

    rows: GaussianScene
    proxies: GaussianScene


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
    survey: Survey
    proxies: GaussianScene
    run: int
    edges: I64
    judging: tuple[int, ...]
    views: Mapping[Sight, Views]

    def drawn(self, part: Range, scene: GaussianScene, runs: tuple[int, int] | None = None) -> Drawable:
        """Gaussians of a range, then proxies of all others, ready to be drawn.

        Args:
            part: the range.
            scene: all its Gaussians, or some that stand for those of some runs.
            runs: of the range, the first of these runs and the one past the last; None for all.
        """
        begin, end = (int(edge) for edge in self.edges[part.number : part.number + 2])
        first, past = (0, end - begin) if runs is None else runs
        others = [self.proxies.rows(slice(0, begin + first)), self.proxies.rows(slice(begin + past, None))]
        return Drawable.of(joined([scene, *others]))


def check_options(options: EncodeOptions) -> None:
    """Check that a scene can be encoded in ranges with these options.

    Raises:
        InvalidInput: ``input-options``.
    """
    options.check()
    if options.latent != "linear":
        message = "ranges of a scene are encoded with a linear latent: leave out --latent learned"
        raise InvalidInput("input-options", message, field="latent")


def glance(scene: GaussianScene, part: Range, bounds: Bounds, options: EncodeOptions) -> Glance:
    """Look at a range for what the whole needs of it.

    Args:
        scene: the Gaussians of the range, at least one, without NaN or infinity.
        part: the range.
        bounds: of the whole scene.
        options: `seed`.
    """
    order = np.argsort(bounds.paths(scene.positions), kind="stable")
    plain = scene.with_sh_degree(0)
    rows = drawn_evenly(len(order), OVERVIEW_ROWS / bounds.count, options.seed + part.number)
    return Glance(plain.take(order[rows]), merged(plain.take(order), run_of(bounds)))


def run_of(bounds: Bounds) -> int:
    """Neighbours that one proxy stands for."""
    return max(PROXY_RUN, -(-bounds.count // MOST_PROXIES))


def overlook(
    glances: Sequence[Glance], parts: Sequence[Range], bounds: Bounds, options: EncodeOptions
) -> Overview:
    """Put together what all ranges give.

    Args:
        glances: of each range, in their order.
        parts: the ranges.
        bounds, options: of the scene.

    Raises:
        InvalidInput: ``input-options``, ``input-frame``.
    """
    check_options(options)
    rows = joined([each.rows for each in glances])
    proxies = joined([each.proxies for each in glances])
    edges = np.cumsum([0, *(len(each.proxies) for each in glances)])
    looked = survey(rows, options, bounds.count)
    told = replace(options, frame=looked.up.up)
    views = {sight: judged_views(rows, options, looked.up, sight, bounds.count) for sight in Sight}
    return Overview(told, bounds, looked, proxies, run_of(bounds), edges, judging(len(parts), options.seed), views)


def judging(ranges: int, seed: int) -> tuple[int, ...]:
    """Numbers of the ranges, of so many, by which results are judged: spread over the scene."""
    count = min(ranges, JUDGING_RANGES)
    shift = np.random.default_rng(seed).random()
    return tuple(int((k + shift) * ranges / count) for k in range(count))


def drawn_evenly(count: int, share: float, seed: int) -> I64:
    """Choose `share` of `count` neighbours in a row, evenly; at least one."""
    if share >= 1:
        return np.arange(count)
    first = np.random.default_rng(seed).random() / share
    found = np.arange(first, count, 1 / share).astype(np.int64)
    return found if len(found) else np.array([count // 2])


def joined(scenes: Sequence[GaussianScene]) -> GaussianScene:
    """All Gaussians of several scenes; bands that one lacks are 0."""
    wide = max(scene.sh.shape[1] for scene in scenes)
    sh = np.zeros((sum(map(len, scenes)), wide, 3), np.float32)
    start = 0
    for scene in scenes:
        sh[start : start + len(scene), : scene.sh.shape[1]] = scene.sh
        start += len(scene)
    return GaussianScene(
        np.concatenate([scene.positions for scene in scenes]),
        np.concatenate([scene.log_scales for scene in scenes]),
        np.concatenate([scene.rotations for scene in scenes]),
        np.concatenate([scene.opacity_logits for scene in scenes]),
        sh,
    )


def merged(scene: GaussianScene, run: int) -> GaussianScene:
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
    )


def _faces(scales: F64) -> F64:
    """(n,) product of the two longest of (n, 3) axes."""
    return np.asarray(np.sort(scales, axis=1)[:, 1:].prod(axis=1))
