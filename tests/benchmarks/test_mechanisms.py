"""Bytes at equal pictures, and the tables of mechanisms."""

from __future__ import annotations

import math

import pytest

from benchmarks.mechanisms_tables import at_equal_pictures, texts, worth


def test_a_curve_is_worth_nothing_against_itself() -> None:
    curve = [(1000, 40.0), (2000, 46.0)]
    assert at_equal_pictures(curve, curve) == pytest.approx(0)


def test_curves_are_compared_where_pictures_are_equal() -> None:
    own = [(1000, 40.0), (2000, 46.0)]
    # A tenth more bytes everywhere, measured half a decibel lower down.
    without = [(1100 * 2 ** ((db - 40) / 6), db) for db in (39.5, 45.5)]
    assert at_equal_pictures(own, without) == pytest.approx(0.1)
    assert at_equal_pictures(without, own) == pytest.approx(1 / 1.1 - 1)
    assert math.isclose(at_equal_pictures(own[::-1], without), 0.1)


def test_tables_have_a_row_a_mechanism_and_a_column_a_scene() -> None:
    record = {"scene": "plush-dog", "mechanism": "predictors", "bytes": 100, "without": 104}
    assert worth(record) == pytest.approx(0.04)
    found = texts({"coding": {"one": record, "two": {**record, "scene": "angel", "without": 99}}})
    assert list(found) == ["coding"]
    assert found["coding"].splitlines()[2] == "| predictors | +4.00% | -1.00% | +4.00% |"
