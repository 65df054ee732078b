"""A scene in ranges opens as the same scene in memory does: boxes of tiles, a view, a picture."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from reference_encoder.judge.reconstruct import reconstruct_gaussians
from reference_encoder.opening_view import find_opening_view
from reference_encoder.out_of_core.opening import join_boxes, make_opening_blocks, measure_range_boxes
from reference_encoder.out_of_core.overview import sample_evenly
from reference_encoder.streaming_block import measure_boxes
from scarfmt.blocks.streaming import unpack_streaming
from scarfmt.container.schema import BlockKind
from scarfmt.render.camera import look_at
from scarfmt.render.images import to_bytes
from scarfmt.render.metrics import psnr
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render
from tests.reference_encoder.out_of_core.chain import encoded, example

SIZE = 1200


def test_boxes_of_ranges_are_those_of_the_whole() -> None:
    chain = encoded(SIZE)
    found = join_boxes([measure_range_boxes(scene) for scene, _ in chain.contents])
    wanted = measure_boxes(chain.whole, reconstruct_gaussians(chain.whole))
    assert len(wanted[0]) > 4
    for got, expected in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(got, expected)


def test_a_range_of_which_nothing_is_sent_has_no_boxes() -> None:
    assert [levels.shape for levels in measure_range_boxes(encoded(SIZE).fit.scene((), ()))] == [(0, 3), (0, 3), (0,)]


def test_a_quarter_of_the_gaussians_finds_the_view_and_a_picture_like_the_whole() -> None:
    overview, plain = encoded(SIZE).overview, example().with_sh_degree(0)
    order = np.argsort(overview.bounds.paths(plain.positions), kind="stable")
    sample = plain.take(order[sample_evenly(len(order), 0.25, 0)])
    boxes = [np.zeros((0, 3), np.uint8), np.zeros((0, 3), np.uint8), np.zeros(0, np.uint8)]
    streaming, thumbnail = make_opening_blocks(overview, sample, boxes, 1_000_000)
    assert (streaming.kind, thumbnail.kind) == (BlockKind.STREAMING, BlockKind.THUMBNAIL)
    wanted, view = find_opening_view(plain, overview.options), unpack_streaming(streaming.payload).view
    assert view is not None
    radius = np.linalg.norm(np.ptp(plain.positions, axis=0))
    assert np.linalg.norm(view.position - wanted.centre) < 0.2 * radius
    shown = Image.open(io.BytesIO(thumbnail.payload)).convert("RGB")
    across = 2 * np.degrees(np.arctan(np.tan(view.fov / 2) * shown.width / shown.height))
    opening = look_at(view.position, view.target, view.up, *shown.size, across)
    truth = to_bytes(render(Drawable.of(plain), opening))
    assert psnr(np.asarray(shown) / np.float32(255), truth / np.float32(255)) > 18
