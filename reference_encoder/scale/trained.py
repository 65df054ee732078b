"""Predictors for a scene in ranges, trained on some tiles of all of them (encoder only)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from reference_encoder.scale.fit import Fit
from reference_encoder.scale.glance import Overview
from reference_encoder.scale.steps import Range, RangeContent
from reference_encoder.tuning import CONTEXT, PREDICTOR_ANCHORS
from scarfmt.container.directory import local_bits


def some_tiles(overview: Overview, part: Range, content: RangeContent) -> RangeContent:
    """Tiles of a range drawn at random, of all ranges together about as many as predictors are trained on."""
    sizes = np.array([len(each) for each in content.contents], np.int64)
    draw = np.random.default_rng([overview.options.seed, part.number])
    order, wanted = draw.permutation(len(sizes)), PREDICTOR_ANCHORS * part.count / overview.bounds.count
    before = np.cumsum(sizes[order]) - sizes[order]
    # A tile that is wanted in part is taken as often.
    kept = np.sort(order[before + draw.random() * sizes[order] < wanted])
    return RangeContent(tuple(content.tiles[k] for k in kept), tuple(content.contents[k] for k in kept))


def train(overview: Overview, fit: Fit, tiles: Sequence[RangeContent], anchors: int) -> Fit:
    """The Fit with predictors where these pay, by what the tiles of all ranges tell.

    Args:
        overview, fit: of the scene.
        tiles: :func:`some_tiles` of all ranges.
        anchors: of the file.
    """
    options = overview.options
    contents = [content for each in tiles for content in each.contents]
    if not options.trains_networks or not contents:
        return fit
    from reference_encoder.networks.predict import choose_predictors  # needs torch

    model = replace(fit.model, context=CONTEXT)
    bits = [local_bits(fit.fields, tile) for each in tiles for tile in each.tiles]
    repeat = anchors / sum(len(content) for content in contents)
    found = choose_predictors(model, contents, bits, options.seed, options.effort, options.bits_per_ns, repeat)
    return replace(fit, model=model, predictors=found) if found else fit
