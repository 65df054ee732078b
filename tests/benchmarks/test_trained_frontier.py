"""Bytes at equal PSNR: the best that a route has, and nothing where it has nothing."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.trained_frontier import frontier, frontier_table, reached

POINTS = st.lists(st.tuples(st.integers(10, 40).map(float), st.integers(1, 1000).map(float)), min_size=1, max_size=12)


@given(POINTS)
def test_no_point_lies_below_the_frontier_and_it_bends_upwards(points: list[tuple[float, float]]) -> None:
    """It is made of points, rises in both, and each further dB costs no smaller factor than the one before."""
    hull = frontier(points)
    assert set(hull) <= set(points)
    decibels, sizes = np.array(hull).T
    slopes = np.diff(np.log(sizes)) / np.diff(decibels)
    assert (np.diff(decibels) > 0).all()
    assert (slopes > 0).all()
    assert (np.diff(slopes) > -1e-9).all()
    for psnr, size in points:
        least = reached(hull, max(psnr, decibels[0]))
        assert least is not None
        assert size >= least * (1 - 1e-9)


def test_between_two_points_lies_their_line_and_beyond_them_nothing() -> None:
    hull = frontier([(20.0, 100.0), (22.0, 400.0), (21.0, 250.0), (19.0, 120.0)])
    assert hull == [(20.0, 100.0), (22.0, 400.0)]
    assert reached(hull, 21.0) == pytest.approx(200.0)
    assert reached(hull, 19.9) is None
    assert reached(hull, 22.1) is None
    assert reached([], 22.1) is None


def record(kind: str, layers: int, size: int, psnr_db: float) -> dict[str, Any]:
    return {"name": f"a {kind}", "kind": kind, "layers": layers, "figures": {"file_bytes": size, "psnr_db": psnr_db}}


def test_the_table_has_trained_layers_that_the_post_hoc_files_reach() -> None:
    post_hoc = [record("post-hoc", 1, 1_000_000, 20.0), record("post-hoc", 2, 4_000_000, 24.0)]
    trained = [record("trained", 1, 500_000, 22.0), record("trained", 2, 900_000, 25.0)]
    text = frontier_table([*trained, record("model", 1, 9_000_000, 23.0), record("rival", 1, 1, 21.0), *post_hoc])
    assert "| a trained | 1 | 22.00 | 500.0 | 2,000.0 | 25 % |" in text
    assert text.count("\n| a ") == 1
    assert frontier_table(trained) == ""
