"""The constants of the decoder model: each is separated from all others, and none is declared that is not measured."""

from __future__ import annotations

from dataclasses import fields

import pytest

from benchmarks.decoder_costs import STEPS, Variant, solved
from scarfmt.coding.decoder_model import DECODER

NS = {
    "symbol": 5.0,
    "group": 70.0,
    "tile_layer": 40_000.0,
    "predicted": 30.0,
    "predictor_multiply_add": 0.04,
    "index_row": 300.0,
    "index_multiply_add": 0.06,
}
"""Costs of a decoder that follows the model, ns."""
FIXED_NS = 3e6
COUNTS = {
    "static": {"symbol": 1e6, "group": 1e3, "tile_layer": 10},
    "finer": {"symbol": 3e6, "group": 2e3, "tile_layer": 10},
    "small tiles": {"symbol": 1e6, "group": 9e3, "tile_layer": 300},
    "units 0": {"symbol": 1e6, "group": 3e3, "tile_layer": 10, "predicted": 2e5, "predictor_multiply_add": 1e7},
    "units 14": {"symbol": 1e6, "group": 3e3, "tile_layer": 10, "predicted": 2e5, "predictor_multiply_add": 9e7},
    "contexts": {"symbol": 1e6, "group": 8e4, "tile_layer": 10, "predicted": 2e5, "predictor_multiply_add": 1e7},
    "narrow network": {"symbol": 1.1e6, "group": 1e3, "tile_layer": 10, "index_row": 1e5, "index_multiply_add": 1e8},
    "wide network": {"symbol": 1.1e6, "group": 1e3, "tile_layer": 10, "index_row": 1e5, "index_multiply_add": 9e8},
}


def variant(counts: dict[str, float]) -> Variant:
    """A file of these counts, decoded in exactly the time that they take."""
    every = {name: counts.get(name, 0.0) for name in NS}
    return Variant(b"", every, 1e-9 * (FIXED_NS + sum(NS[name] * number for name, number in every.items())))


def test_what_every_unit_costs_is_told_apart() -> None:
    """The fit separates the costs of all units, even if variants differ in more than the one thing they are made
    for."""
    found = solved({name: variant(counts) for name, counts in COUNTS.items()})
    assert found == pytest.approx(NS, rel=0.2)


def test_all_constants_are_measured() -> None:
    """One that is declared has a variant, and the other way round."""
    declared = {field.name for field in fields(DECODER)} - {"date", "machine"}
    assert {name for name, _, _ in STEPS} == declared
