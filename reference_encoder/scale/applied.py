"""From the Gaussians of one range to all its integers, as a Fit says (encoder only)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference_encoder.decide.assemble import contents_of
from reference_encoder.decide.decision import final_values
from reference_encoder.decide.lattice import Placement, place_within
from reference_encoder.decide.problem import Channels, Classes, standing
from reference_encoder.latent.rvq import Vectors, assign
from reference_encoder.measure.attributes import Attributes, from_scene, without_hidden_scales
from reference_encoder.measure.sensitivity import Sensitivity, measure
from reference_encoder.profiles.explicit import channels_of, log_extent, wanted_step
from reference_encoder.scale.fit import Fit, LatentFit, ranked
from reference_encoder.scale.glance import Overview
from reference_encoder.scale.steps import Measured, Range, RangeContent
from reference_encoder.sums import subtract_rows
from reference_encoder.tuning import INVISIBLE_WEIGHT, REST_SHARE
from scarfmt.arrays import I16, I64
from scarfmt.container.schema import Stream
from scarfmt.scene.gaussians import GaussianScene


def apply(overview: Overview, fit: Fit, part: Range, scene: GaussianScene, measured: Measured) -> RangeContent:
    """Tiles and all integers of a range.

    Args:
        overview, fit: of the whole scene.
        part, scene, measured: the range, its Gaussians, and what they weigh.
    """
    attributes = without_hidden_scales(from_scene(scene), measured.pixel)
    seen = measure(attributes, measured)
    every = fit.classes.classes(ranked(seen, fit.lambda_, fit.shift, overview.bounds.sh_degree))
    left_out, invisible = every < 0, measured.largest < INVISIBLE_WEIGHT
    gone = int((left_out & invisible).sum()), int((left_out & ~invisible).sum())
    kept = np.flatnonzero(every >= 0)
    if not len(kept):
        return RangeContent((), (), gone)
    attributes, seen = attributes.take(kept), seen.take(kept)
    wanted = wanted_step(seen, fit.lambda_)
    place = place_within(
        attributes.positions, wanted, fit.root, fit.fields.lattice_bits, fit.tile_anchors, (part.first, part.past)
    )
    return _content(fit, _Kept(attributes, seen, every[kept], place), gone)


@dataclass(frozen=True)
class _Kept:
    """The n Gaussians of a range that are worth sending.

    Attributes:
        attributes, seen: of them.
        importance: (n,) class of each, before any class is split.
        place: where they lie.
    """

    attributes: Attributes
    seen: Sensitivity
    importance: I64
    place: Placement


def _content(fit: Fit, kept: _Kept, gone: tuple[int, int]) -> RangeContent:
    classes, model = split_classes(fit, kept.importance, kept.attributes), fit.model
    channels = channels_of(kept.attributes, kept.seen, kept.place)
    last = model.layers[-1]
    finals: dict[Stream, I64] = {
        channel.stream: _finals(fit, index, channels, classes)
        for index, channel in enumerate(model.channels)
        if channel.stream != Stream.LATENT
    }
    indices = None
    refined = np.zeros(len(last.stages), np.int64)
    if fit.latent is not None:
        indices, left = _codewords(fit, fit.latent, kept, classes)
        index = model.channel_index(Stream.LATENT)
        if index is not None:
            refined = np.array([steps[index] for steps in last.steps])
            finals[Stream.LATENT] = _refined(fit, index, left, classes)
    plain = (np.array(last.stages) + refined)[classes] == 0
    contents = contents_of(model, kept.place, classes, finals, indices if model.max_stages else None)
    return RangeContent(kept.place.tiles, contents, gone, int(plain.sum()))


def split_classes(fit: Fit, importance: I64, attributes: Attributes) -> I64:
    """(n,) classes as the file has them, of Gaussians of these classes of importance."""
    none = np.zeros(fit.classes.count)
    return (
        Classes(
            of=importance,
            count=fit.classes.count,
            importance=none,
            standing=standing(attributes.positions, importance, log_extent(attributes), fit.box),
            presence_bits=lambda _: none,
        )
        .split(fit.parts)
        .of
    )


def _finals(fit: Fit, index: int, channels: Channels, classes: I64) -> I64:
    channel = fit.model.channels[index]
    values, weight = channels.values[channel.stream], channels.weights[channel.stream]
    return final_values(values, weight, classes, (channel.first_width, _steps(fit, index)), fit.lambda_)


def _steps(fit: Fit, index: int) -> I64:
    return np.array([steps[index] for steps in fit.model.layers[-1].steps])


@dataclass(frozen=True)
class _Left:
    """Residuals of latents of some Gaussians, after their codewords.

    Attributes:
        rows: (m,) which of n Gaussians.
        count: n.
        vectors: of the m, classes as the file has them.
    """

    rows: I64
    count: int
    vectors: Vectors


def _codewords(fit: Fit, latent: LatentFit, kept: _Kept, classes: I64) -> tuple[I16, _Left]:
    """(n, M) codewords, 0 where a class receives none, and what they leave where there are any."""
    received = np.array(fit.model.layers[-1].stages)[classes]
    rows = np.flatnonzero(received > 0)
    values = (kept.attributes.rest[rows] @ latent.projection.astype(np.float32)).astype(np.float32)
    heavy = (kept.seen.colour[rows] * REST_SHARE * latent.unit**2).astype(np.float32)
    left = Vectors(values, heavy, kept.importance[rows])
    indices = np.zeros((len(classes), max(fit.model.max_stages, len(latent.prices))), np.int16)
    for stage, prices in enumerate(latent.prices):
        there = np.flatnonzero(received[rows] > stage)
        book = (latent.books.coarse if stage == 0 else latent.books.residual).astype(np.float32)
        searched = left if len(there) == len(rows) else left.take(there)
        codes = assign(searched, book, prices, fit.lambda_)
        subtract_rows(left.x, there, book, codes)
        indices[rows[there], stage] = codes
    return indices, _Left(rows, len(classes), Vectors(left.x, left.weight, classes[rows]))


def _refined(fit: Fit, index: int, left: _Left, classes: I64) -> I64:
    """(n, d) values of the LATENT channel."""
    steps, vectors = _steps(fit, index), left.vectors
    there = np.flatnonzero(steps[vectors.classes] > 0)
    values, weight = vectors.x[there].astype(np.float64), vectors.weight[there, None].astype(np.float64)
    out = np.zeros((left.count, values.shape[1]), np.int64)
    if len(there):
        width = fit.model.channels[index].first_width
        out[left.rows[there]] = final_values(values, weight, vectors.classes[there], (width, steps), fit.lambda_)
    return out
