"""The benchmark of numerical stability in small: exact values agree, tolerances hold, and what is wrong is found."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import stability, stability_files, stability_processes
from benchmarks.entropy_operations import DoubleOperations, PermutedOperations
from benchmarks.stability_activated import Activation, activations, reference_error
from benchmarks.stability_files import BASE, Manner, decoding, digests, manners, orders
from benchmarks.stability_networks import measure_networks
from benchmarks.stability_search import Operation, search, used_tolerance
from benchmarks.stability_tables import failures, markdown
from benchmarks.stability_values import measure_values, reaches, rounded32
from scarfmt.arrays import Floats
from tests.benchmarks.test_entropy import SometimesWrong

_NAMES = ("valid/predictors", "valid/index-attention", "valid/anchors-neural", "edge/tiles-nested")
FILES = [stability_files.VECTORS / name / "input.scar" for name in _NAMES]

USUAL = {"exact": {"v/a": "1"}, "single": "s", "worst": 0.5}


@pytest.fixture(scope="module")
def exact() -> list[dict[str, Any]]:
    return measure_values(100)


def test_exact_values_are_those_of_fractions(exact: list[dict[str, Any]]) -> None:
    """Channel values, positions, latents, fine values, means, tables, rANS; and each kind was tried."""
    assert {edge["operation"]: edge["differ"] for edge in exact if edge["differ"]} == {}
    assert min(edge["cases"] for edge in exact) >= 20


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.parent.name)
def test_a_file_is_the_same_in_every_way(path: Path) -> None:
    """All exact arrays, contexts and frequencies among them; sizes in between are the benchmark's."""
    between = ("threads: 4", "at most 7", "at most 64", "torch, 4 threads", "cuda, 4 threads")
    ways = {name: way for name, way in manners().items() if not name.endswith(between)}
    found = stability.compare_files([path], ways | orders(2))
    assert {name: wrong for name, (_, _, wrong) in found.items() if wrong} == {}
    assert min(arrays for _, arrays, _ in found.values()) > 5


def test_a_wrong_way_is_found() -> None:
    """Whether it gives other values or a refusal."""
    found = stability.compare_files(FILES[1:2], {"wrong": Manner(make=SometimesWrong)})
    assert found["wrong"][2]


def test_orders_really_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    """Predictors and the network are evaluated by what shuffles, not by the usual code."""
    asked: list[str] = []
    for owner, name in ((stability_files.OtherPredictor, "contexts"), (PermutedOperations, "product")):
        usual = getattr(owner, name)

        def seen(self: Any, *given: Any, usual: Any = usual, name: str = name) -> Any:
            asked.append(name)
            return usual(self, *given)

        monkeypatch.setattr(owner, name, seen)
    way = replace(orders(1)["order 1"], bare=True)
    assert digests(decoding(FILES[0], None, way)) == digests(decoding(FILES[0], None, BASE))
    digests(decoding(FILES[1], None, way))
    assert set(asked) == {"contexts", "product"}


def test_random_orders_are_twenty_and_half_without_the_kernel() -> None:
    assert [way.bare for way in orders().values()].count(True) == len(orders()) / 2 == 10
    assert {way.threads for way in orders().values()} == {1, 2, 4}


@pytest.mark.parametrize("name", [one.operation.name for one in activations()])
def test_activated_values_keep_the_tolerance(name: str) -> None:
    """R-9.5-1 for the worst inputs a short search finds among all that are legal."""
    operation = next(one.operation for one in activations() if one.operation.name == name)
    found = search(operation, 20_000, 8)
    assert found.cases > 20_000
    assert found.used <= 1, found


def test_networks_keep_the_tolerance() -> None:
    """The latent decoder, and all that is made of networks of the anchor profile, their features included."""
    used = {operation.name: worst.used for operation, worst in measure_networks(30, 100, 6)}
    assert len(used) == 6
    assert max(used.values()) <= 1, used


@pytest.mark.parametrize("activation", activations(), ids=lambda one: one.operation.name)
def test_the_reference_agrees_with_fifty_digits(activation: Activation) -> None:
    """For any inputs: float64 leaves open a small part of the tolerance, where it is hardest too."""
    assert reference_error(activation, [*activation.hard, (0.25,) * len(activation.operation.columns)], 40) < 1e-6


def test_a_search_climbs_to_a_rare_error() -> None:
    """Growing towards x = 1000, where random inputs alone do not come."""

    def wrong(x: Floats) -> Floats:
        return (x * (1 + 1e-4 / (1 + np.abs(x - 1000) ** 0.5))).astype(np.float32)

    operation = Operation("x", ("x",), (-149,), (127,), wrong, lambda x: (x, np.abs(x)))
    assert search(operation, 2000, 30).used > 1.01 * search(operation, 2000, 0).used
    assert search(operation, 2000, 30) == search(operation, 2000, 30)


def test_what_is_not_compared_uses_no_tolerance_and_a_missing_number_all() -> None:
    """R-9.5-1: above 10^38, and where the reference is no number, any value will do."""
    a, b, m = np.array([[1.0, 0, np.nan, 2e-5]]), np.array([[np.nan, 2e38, 1, 0]]), np.array([[1.0, 2e38, 1, 0]])
    assert used_tolerance(a, b, m).tolist() == [[0.0, 0.0, np.inf, 2.0]]


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_rounding_to_binary32_is_that_of_the_machine(value: float) -> None:
    """Subnormal numbers, ties and overflow included."""
    with np.errstate(all="ignore"):
        assert rounded32(Fraction(value)) == np.float32(value)


def test_accumulators_stay_below_their_limits() -> None:
    assert all(most < limit for _, most, limit, _ in reaches())


def test_failures_name_what_is_wrong(exact: list[dict[str, Any]]) -> None:
    """Every part can report a failure, and tables can be made of it."""
    good = stability_processes.compared(USUAL, USUAL)
    other = stability_processes.compared({**USUAL, "exact": {"v/a": "2"}}, USUAL)
    activated = {"operation": "op", "columns": ("x",), "inputs": (1.0,), "cases": 1, "error": 1.0, "ulps": 1.0,
                 "used": 2.0, "found": 1.0, "wanted": 2.0, "reference": None}  # fmt: skip
    results = {
        "files": {"threads: 2": [1, 1, ["f: a"]], "order 1": [1, 1, []]},
        "real": ["f"],
        "processes": {"as usual": good, "other": other, "dead": {"failed": "-4"}},
        "encoder": {"as usual": "0", "again": "1"},
        "exact": [*exact, {"operation": "sum", "cases": 1, "worst": "", "limit": "", "differ": 1}],
        "activated": [activated],
    }
    wrong = failures(results)
    assert wrong == ["threads: 2: f: a", "other", "dead", "encoder, again", "sum", "op: 2.0 times the tolerance"]
    text = markdown(results)
    assert "**exceeded 2 times**" in text
    assert "ended with -4" in text


def test_a_process_reports_what_it_decoded() -> None:
    """The report, made in this process, holds the digests of a file and the share of the tolerance that float32
    uses."""
    job = {"paths": [str(FILES[0])], "real": str(FILES[0]), "backend": "numpy"}
    found = stability_processes.decode_job(job)
    assert found["exact"] == {str(FILES[0]): stability_processes.together(digests(decoding(FILES[0], None, BASE)))}
    assert 0 < found["worst"] < 1


def test_arithmetic_in_float64_is_compared_without_the_kernel() -> None:
    """The kernel reads float32 alone, so float64 is compared without it."""
    assert all(way.bare for way in manners().values() if isinstance(way.make(), DoubleOperations) or way.whole)
