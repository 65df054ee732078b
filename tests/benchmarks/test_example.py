"""The example scene stays as small and as good as recorded: what a change of the encoder costs cannot slip through."""

from __future__ import annotations

import pytest

from benchmarks import example
from benchmarks.report import load_results

MORE_BYTES, LESS_DB = 1.10, 0.5
RECORDED = load_results(example.NAME)


@pytest.mark.parametrize("effort", example.EFFORTS)
def test_the_example_scene_is_as_small_and_as_good_as_recorded(effort: int) -> None:
    """At a fixed quality, from views the encoder was not given; the first layer, too.

    Where a change costs more on purpose, `python -m benchmarks.example` records what it is now.
    """
    before, now = RECORDED[f"effort {effort}"], example.measure(effort)
    for field in ("bytes", "first_layer_bytes"):
        assert now[field] <= MORE_BYTES * before[field], field
    for field in ("mean_psnr_db", "worst_psnr_db", "first_layer_psnr_db"):
        assert now[field] >= before[field] - LESS_DB, field


def test_what_is_recorded_is_a_compressed_scene_that_looks_like_the_source() -> None:
    """Bounds that no new record may leave: a record of a broken encoder would bound nothing."""
    size = (example.EXAMPLES / "plush-toys.ply").stat().st_size
    for effort in example.EFFORTS:
        found = RECORDED[f"effort {effort}"]
        assert found["bytes"] < size / 20
        assert found["mean_psnr_db"] > 39
        assert found["worst_psnr_db"] > 36
    assert RECORDED["effort 2"]["bytes"] < RECORDED["effort 1"]["bytes"]
