"""The comparison of answers: exact hashes, tolerances, fields, metadata; and no answer breaks it."""

from __future__ import annotations

import base64
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scarfmt_conformance.compare import Difference, annotation_difference, differences

from tests.conformance.suite.conftest import Json, array

HERE = Path()


def compared(expected: Json, got: Any) -> list[Difference]:
    """Differences of one exact array."""
    return differences("values", {"arrays": {"a": expected}}, {"arrays": {"a": got}}, HERE)


@pytest.mark.parametrize(
    ("got", "message"),
    [
        (array("cd" * 32), "differs"),
        (array("AB" * 32), "differs"),
        (array(dtype="<u4"), "has another type"),
        (array(shape=(3, 2)), "has another shape"),
        ({**array(), "shape": [2, True]}, "has another shape"),
        ({**array(), "shape": [2.0, 3]}, "has another shape"),
        ({**array(), "shape": None}, "has another shape"),
        ({"shape": [2, 3]}, "has another type"),
        (None, "is missing"),
        ("x", "is not an object"),
    ],
)
def test_exact_arrays_differ_by_type_then_shape_then_hash(got: Any, message: str) -> None:
    assert [found.message for found in compared(array(), got)] == [message]


@pytest.mark.parametrize("answered", [None, 5, {}, {"arrays": []}])
def test_a_stage_claimed_must_be_answered(answered: Any) -> None:
    (found,) = differences("values", {"arrays": {"a": array()}}, answered, HERE)
    assert (found.stage, found.array) == ("values", "")
    assert ("is not in the answer" in found.message) == (answered is None)


# ------------------------------------------------------------------------------------------------ container


def container(**header: Any) -> Json:
    return {"container": {"header": header, "layers": [{"a": "1"}, {"a": "2"}]}}


@pytest.mark.parametrize(
    ("got", "place", "message"),
    [
        (container(x="1", y=["2"]), "header.y", "has another length"),
        (container(x="1", y=["2", 3]), "header.y[1]", "differs"),
        (container(y=["2", "3"]), "header.x", "is missing"),
        (container(x=1, y=["2", "3"]), "header.x", "differs"),
        (container(x={}, y=["2", "3"]), "header.x", "differs"),
        ({"container": {"header": container(x="1", y=["2", "3"])["container"]["header"]}}, "layers", "is missing"),
    ],
)
def test_the_first_field_that_differs_is_named(got: Any, place: str, message: str) -> None:
    (found,) = differences("container", container(x="1", y=["2", "3"]), got, HERE)
    assert (found.array, found.message) == (place, message)


# ------------------------------------------------------------------------------------------------ activated


def numbers(values: ArrayLike, dtype: str = "<f8", **changed: Any) -> Json:
    data = np.asarray(values, dtype)
    return {"dtype": dtype, "shape": list(data.shape), "data": base64.b64encode(data.tobytes()).decode(), **changed}


def activated(folder: Path, reference: ArrayLike, got: Any, magnitude: ArrayLike | None = None) -> list[Difference]:
    parts = [np.asarray(reference, "<f8")] + ([] if magnitude is None else [np.asarray(magnitude, "<f8")])
    (folder / "a.bin").write_bytes(b"".join(part.tobytes() for part in parts))
    pinned = {"shape": list(parts[0].shape), "reference": "a.bin", "magnitude": magnitude is not None}
    return differences("activated", {"arrays": {"a": pinned}}, {"arrays": {"a": got}}, folder)


@pytest.mark.parametrize("dtype", ["<f4", "<f8"])
@pytest.mark.parametrize(
    ("reference", "magnitude", "error", "agrees"),
    [
        (0.25, None, 0.9e-5, True),
        (0.25, None, 1.2e-5, False),
        (100.0, None, 0.9e-3, True),
        (100.0, None, 1.2e-3, False),
        (-100.0, None, 0.9e-3, True),
        (0.25, 50.0, 4.5e-4, True),
        (0.25, 50.0, 6.0e-4, False),
        (100.0, 1.0, 0.9e-3, True),
    ],
)
def test_the_tolerance_is_relative_to_the_magnitude_and_at_least_absolute(
    tmp_path: Path, dtype: str, reference: float, magnitude: float | None, error: float, agrees: bool
) -> None:
    """SPEC §9.5, on both sides of the bound, for both types of answer."""
    for sign in (-1, 1):
        got = numbers([0.0, reference + sign * error], dtype)
        found = activated(tmp_path, [0.0, reference], got, None if magnitude is None else [0.0, magnitude])
        assert (not found) == agrees


@pytest.mark.parametrize(
    ("reference", "magnitude", "got", "agrees"),
    [
        (math.inf, None, math.inf, True),
        (math.nan, None, 3.0, True),
        (0.5, math.inf, 7.0, True),
        (0.5, math.nan, 7.0, True),
        (0.5, None, math.nan, False),
        (0.5, None, math.inf, False),
        (1e37, None, -math.inf, False),
        (-3e38, None, -math.inf, True),
        (0.5, 1e300, math.inf, True),
    ],
)
def test_numbers_that_are_none(
    tmp_path: Path, reference: float, magnitude: float | None, got: float, agrees: bool
) -> None:
    """Nothing is compared where the reference says nothing or binary32 may overflow; elsewhere NaN is wrong."""
    found = activated(tmp_path, [reference], numbers([got]), None if magnitude is None else [magnitude])
    assert (not found) == agrees


@pytest.mark.parametrize(
    ("got", "message"),
    [
        (numbers([1.0]), "has another shape"),
        (numbers([1.0, 2.0], shape=[2, 1]), "has another shape"),
        (numbers([1.0, 2.0], shape="2"), "has another shape"),
        (numbers([1.0, 2.0], shape=[float("nan")]), "has another shape"),
        (numbers([1.0, 2.0], dtype="<f2"), "is of type '<f2', not <f4 or <f8"),
        (numbers([1.0, 2.0]) | {"dtype": ["<f8"]}, "is of type"),
        (numbers([1.0, 2.0]) | {"dtype": "<f4"}, "has 16 bytes of data, not 8"),
        (numbers([1.0, 2.0], data=None), "has no data"),
        (numbers([1.0, 2.0], data="!!!!"), "not base64"),
        (numbers([1.0, 2.0], data="é"), "not base64"),
        (numbers([1.0, 2.0], data="AAAA"), "has 3 bytes of data, not 16"),
    ],
)
def test_answers_without_the_right_numbers_are_told_apart(tmp_path: Path, got: Json, message: str) -> None:
    (found,) = activated(tmp_path, [1.0, 2.0], got)
    assert message in found.message


# ------------------------------------------------------------------------------------------------ metadata


@pytest.mark.parametrize(
    ("a", "b", "same"),
    [
        (None, None, True),
        ({}, None, False),
        ({"a": 1}, {"a": 1.0}, True),
        ({"a": 1}, {"a": True}, False),
        ({"a": 12345678901234567890123}, {"a": 1.2345678901234568e22}, True),
        ({"a": 10**400}, {"a": math.inf}, True),
        ({"a": [1, {"b": "é"}]}, {"a": [1, {"b": "é"}]}, True),
        ({"a": [1, 2]}, {"a": [1]}, False),
        ({"a": 1, "b": 2}, {"b": 2, "a": 1}, True),
        ({"a": 1}, {"a": 1, "b": 2}, False),
        ({"a": None}, {"a": False}, False),
        ({"a": "1"}, {"a": 1}, False),
    ],
)
def test_metadata_is_compared_as_json(a: Any, b: Any, same: bool) -> None:
    """Keys in any order, numbers as binary64."""
    assert (annotation_difference("metadata", a, {"metadata": b}) is None) == same
