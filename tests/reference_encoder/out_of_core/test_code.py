"""The file of a scene in ranges is the one that the writer makes of all its integers at once."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from reference_decoder.decode import decode
from reference_encoder.importance.weights import Weights
from reference_encoder.out_of_core.code import add_histograms, build_models, count_symbols, write_file
from reference_encoder.out_of_core.fit import apply
from reference_encoder.out_of_core.types import Rows
from reference_encoder.out_of_core.work_dir import WorkDir, file_name
from scarfmt.container.schema import BlockKind
from scarfmt.render.camera import orbit_cameras
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from tests.reference_encoder.out_of_core.chain import Chain, encoded, example, written

SIZE = 1200


def test_the_file_looks_like_the_scene() -> None:
    decoded = decode(written(encoded(SIZE))).scene
    levels = [psnr(render(example(), c), render(decoded, c)) for c in orbit_cameras(example(), 4, 160, 120)]
    assert np.mean(levels) > 36


def test_histograms_add_up_in_any_order_and_groups() -> None:
    chain = encoded(SIZE)
    parts = [count_symbols(*content)[0] for content in chain.contents]
    grouped = [add_histograms(parts[2:]), add_histograms(parts[:2])]
    told = {"quality": json.loads(metadata(chain))["quality"]}
    assert build_models(chain.overview, chain.fit, add_histograms(grouped), told).blocks == chain.models.blocks


def metadata(chain: Chain) -> bytes:
    """The METADATA block."""
    return next(block.payload for block in chain.models.blocks if block.kind == BlockKind.METADATA)


def test_a_range_of_which_nothing_is_sent_has_no_blocks() -> None:
    chain = encoded(SIZE)
    unseen = Weights(*map(np.zeros_like, vars(chain.measured[0]).values()))
    found, symbols = count_symbols(*apply(chain.overview, chain.fit, *chain.ranges[0], unseen))
    assert not any(symbols[1])
    assert not any(found.layers)
    assert not found.anchors.any()
    assert found.losses.tolist() == [chain.ranges[0][0].count, 0, 0]


def merge_file(chain: Chain, segments: Sequence[tuple[Rows, Sequence[bytes]]], folder: Path) -> bytes:
    work, target = WorkDir(str(folder)), io.BytesIO()
    for number, (_, payloads) in enumerate(segments):
        with work.write(file_name("segments", number)) as stream:
            stream.write(b"".join(payloads))
    size = write_file(work, chain.fit.fields, chain.models, [rows for rows, _ in segments], target)
    assert size == len(target.getvalue())
    return target.getvalue()


def test_ranges_make_the_file_of_the_whole(tmp_path: Path) -> None:
    chain = encoded(SIZE)
    assert len(chain.ranges) >= 4
    assert merge_file(chain, chain.segments, tmp_path) == written(chain)


def test_ranges_of_which_nothing_is_sent_leave_no_trace(tmp_path: Path) -> None:
    """All of their Gaussians may be invisible."""
    chain = encoded(SIZE)
    first, *others = chain.segments
    rows, payloads = first
    nothing = Rows((), tuple(table[:0] for table in rows.layers), 0 * rows.stream_bytes), [b""] * len(payloads)
    assert merge_file(chain, [nothing, first, nothing, *others], tmp_path) == written(chain)
