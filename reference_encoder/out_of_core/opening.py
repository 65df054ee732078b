"""What a client of a scene in ranges begins with: boxes of tiles, a view, and a picture of it (encoder only).

The view is chosen, and the picture drawn, from a sample of the source: the whole is nowhere in memory at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from reference_encoder.judge.reconstruct import reconstruct_gaussians
from reference_encoder.opening_view import find_opening_view, thumbnail_blocks
from reference_encoder.out_of_core.overview import Overview
from reference_encoder.streaming_block import describe_view, measure_boxes
from scarfmt.blocks.streaming import Levels, Streaming, streaming_block
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Block
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene


def measure_range_boxes(scene: QuantisedScene) -> list[Levels]:
    """(T, 3), (T, 3) and (T,) boxes of the tiles of a range, of which only one is drawn at a time."""
    plain = replace(scene, fields=replace(scene.fields, sh_degree=0), decoder=None)
    tiles = zip(scene.tiles, scene.contents, strict=True)
    alone = (replace(plain, tiles=(tile,), contents=(content,)) for tile, content in tiles)
    return join_boxes([measure_boxes(tile, reconstruct_gaussians(tile)) for tile in alone])


def join_boxes(parts: Sequence[Sequence[Levels]]) -> list[Levels]:
    """Boxes of parts, one part after another; none of none."""
    nothing = [np.zeros(shape, np.uint8) for shape in ((0, 3), (0, 3), 0)]
    return [np.concatenate(levels) for levels in zip(nothing, *parts, strict=True)]


def make_opening_blocks(
    overview: Overview, sample: GaussianScene, boxes: Sequence[Levels], size: int
) -> tuple[Block, ...]:
    """The STREAMING block, and the THUMBNAIL if there is room for one.

    Args:
        sample: Gaussians of the source, drawn evenly, without view-dependent colour.
        boxes: of all tiles (:func:`measure_range_boxes`).
        size: bytes of all other blocks.
    """
    # Each covers as much as those that it stands for.
    wider = math.log(overview.bounds.count / len(sample)) / 2
    drawn = replace(sample, log_scales=sample.log_scales + np.float32(wider))
    opening = find_opening_view(drawn, overview.options)
    low, high, reach = boxes
    streaming = Streaming(low, high, reach, describe_view(opening, drawn.positions))
    picture = partial(render, Drawable.of(drawn))
    return streaming_block(streaming), *thumbnail_blocks(picture, opening, size)
