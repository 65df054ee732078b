"""The benchmarks of the entropy model: they measure what they say, and a difference does not slip through."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks import cuda_equality, entropy_edges, entropy_speed
from benchmarks.entropy_cases import Clock, Shape, decode_batch, make_batch, make_case
from benchmarks.entropy_operations import CountingOperations, IntegerOperations, PermutedOperations
from benchmarks.entropy_stress import failures, measure_networks
from scarfmt.entropy.rans import PureRansDecoder, RansDecoder
from scarfmt.neural.arithmetic import ACCUMULATOR_LIMIT
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.operations import NUMPY, NumpyOperations

SMALL = Shape(3, 8, 64)
FLAT = Shape(2, 8, 32, two_level=False)


class SometimesWrong(NumpyOperations):
    """Every third sum of products is: what a GPU that shortens them would be."""

    def __init__(self) -> None:
        super().__init__()
        self._products = 0

    def product(self, x: NDArray[np.float32], weights: NDArray[np.float32]) -> NDArray[np.float32]:
        out = super().product(x, weights)
        self._products += 1
        if self._products % 3 == 0:
            out += 1000
        return out


@pytest.mark.parametrize("shape", [SMALL, FLAT], ids=lambda shape: shape.name)
def test_the_loop_that_is_timed_decodes(shape: Shape) -> None:
    """The loop gives the indices of the normative decoder, and every index is a codeword."""
    case = make_case(shape)
    batch = make_batch(case, 300, 1)
    evaluator = Evaluator(case.network, case.books)
    found = [
        decode_batch(evaluator, case, batch.x, decoder(batch.words), Clock())
        for decoder in (RansDecoder, PureRansDecoder)
    ]
    assert np.array_equal(*found)
    assert found[0].shape == (shape.stages, 300)
    assert set(np.unique(found[0])) <= set(range(shape.words))
    assert len(np.unique(found[0])) > shape.words // 4


def test_every_part_of_the_work_is_timed() -> None:
    case, clock = make_case(SMALL), Clock()
    batch = make_batch(case, 100, 1)
    decode_batch(Evaluator(case.network, case.books), case, batch.x, RansDecoder(batch.words), clock)
    assert set(clock.seconds) == set(entropy_speed.PARTS)


def test_tables_of_speed_have_a_row_for_each_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tables need exactly the fields that a measurement gives."""
    for name, value in (("_ANCHORS", 64), ("_BATCHES", 2), ("_SYMBOLS", 512), ("_SYMBOLS_A_CALL", (512, 256))):
        monkeypatch.setattr(entropy_speed, name, value)
    shapes = [entropy_speed.measure_shape(SMALL, backend, 1) for backend in entropy_speed.BACKENDS]
    results = {"shapes": shapes, "static": entropy_speed.measure_static(1), "load": "l"}
    text = entropy_speed.markdown(results)
    assert text.count(SMALL.name) == len(shapes) * (len(entropy_speed.THREADS) + 1)


def test_stress_finds_no_difference() -> None:
    """One network of each kind, in every way; and it did compare something."""
    found = measure_networks(5)
    assert failures({"networks": found}) == 0
    assert min(count for count, _ in found["compared"].values()) == 5
    assert min(found["kinds"].values()) == 1
    assert found["frequencies"] > 1000


def test_edges_reach_the_limits_and_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_LAYERS", "_RECURRENCES", "_ROWS"):
        monkeypatch.setattr(entropy_edges, name, 3)
    monkeypatch.setattr(entropy_edges, "_TOTALS", 400)
    monkeypatch.setattr(entropy_edges, "_SHARES", 80)
    edges = entropy_edges.measure_edges()
    assert sum(edge["differ"] for edge in edges) == 0
    assert edges[0]["worst"] == f"{ACCUMULATOR_LIMIT - 1:,}"
    assert min(edge["cases"] for edge in edges) > 50


def test_operations_that_are_wrong_are_found() -> None:
    """By rows of networks and by streams; a comparison that cannot fail is worth nothing."""
    assert cuda_equality.compare_networks(SometimesWrong(), 5)[1] > 0
    assert cuda_equality.compare_streams(SometimesWrong(), [SMALL], 50)[1] > 0
    assert cuda_equality.compare_networks(NUMPY, 5) == (5, 0)
    assert cuda_equality.compare_streams(NUMPY, [SMALL], 50) == (150, 0)


def test_without_a_gpu_the_comparison_says_that_it_was_skipped(capsys: pytest.CaptureFixture[str]) -> None:
    import torch

    if torch.cuda.is_available():
        pytest.skip("there is a GPU: run python -m benchmarks.cuda_equality")
    assert cuda_equality.main([]) == cuda_equality.SKIPPED
    assert "SKIPPED" in capsys.readouterr().out


@pytest.mark.parametrize("do", [PermutedOperations(3), IntegerOperations()], ids=["permuted", "int64"])
def test_other_arithmetic_gives_the_same_rows(do: NumpyOperations) -> None:
    """Fractions, signs and all: what whole files are compared with has to be right on its own."""
    assert cuda_equality.compare_networks(do, 10) == (10, 0)


def test_counted_extremes_are_in_units_of_the_last_digit() -> None:
    """7 / 4 + 5 / 4 is 12 quarters, of which a sum needs 12."""
    counting = CountingOperations()
    counting.product(np.array([[7.0, -5.0]]), np.array([[0.25], [0.25]]))
    seen: dict[str, Any] = {row["what"]: row["seen"] for row in counting.report()}
    assert seen == {"sum of the magnitudes of products": "12"}
