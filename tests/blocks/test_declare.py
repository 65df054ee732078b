"""Declarations of payloads: what is read, packed, refused and reported, and in which order."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.blocks.declare import (
    U8,
    Check,
    Derived,
    Number,
    NumberRecord,
    Record,
    Repeat,
    Rule,
    Scope,
    ShiftedNumbers,
    Use,
    When,
    array,
    blob,
    build,
    read,
    scalar,
    varint,
    varints,
)
from scarfmt.errors import Malformed, ScarError
from tests.samples.codec_samples import refuses


def refusal(at: Scope) -> ScarError:
    return Malformed("bad-thing", f"{dict(at)}", field="thing")


PAIR = Record("rows" / U8, "numbers" / array("u4", "rows * width"))
THING = Record(
    "kind" / U8 * "0 or 1",
    Rule(Check("R-1-1", "kind is 0 or 1", "bad-thing"), lambda at: at["kind"] < 2, refusal),
    When("kind == 1", "low" / varint(33), "width_of_all" / scalar("f64", "d")),
    "count" / U8,
    "pairs" / Repeat("count", Use("pair", PAIR, width=2)),
    "size" / varint(16),
    "weights" / varints(24, "size"),
    "floats" / array("f4", "count"),
    "blob" / blob("kind") * "the end",
    "total" / Derived(lambda at: len(at["pairs"]) + at["size"], "count + size"),
)


def things() -> st.SearchStrategy[dict[str, Any]]:
    rows, weights = st.lists(st.integers(0, 4), max_size=5), st.lists(st.integers(0, 2**24 - 1))
    return st.builds(_thing, st.integers(0, 1), st.integers(0, 2**33 - 1), rows, weights)


def _thing(kind: int, low: int, rows: list[int], weights: list[int]) -> dict[str, Any]:
    pairs = [{"rows": n, "numbers": np.arange(2 * n)} for n in rows]
    values: dict[str, Any] = {"kind": kind, "count": len(rows), "pairs": pairs, "size": len(weights)}
    values |= {"weights": np.array(weights, np.int64), "floats": np.arange(len(rows), dtype="f4"), "blob": bytes(kind)}
    return values | ({"low": low, "width_of_all": 0.5} if kind else {})


@given(things())
def test_what_is_packed_is_read(values: dict[str, Any]) -> None:
    """Every kind of field, with and without what depends on a condition."""
    payload = build(THING, values)
    found = read(THING, payload, "thing")
    assert found["total"] == values["count"] + values["size"]
    for name, value in values.items():
        if name == "pairs":
            assert [pair["rows"] for pair in found[name]] == [pair["rows"] for pair in value]
            for pair, wanted in zip(found[name], value, strict=True):
                np.testing.assert_array_equal(pair["numbers"], wanted["numbers"])
        else:
            np.testing.assert_array_equal(found[name], value)


ADAPTIVE = NumberRecord("n" / Number(limit=9), "numbers" / ShiftedNumbers("n"), "more" / Number("signed", times="n"))


@given(st.lists(st.integers(1 - 2**31, 2**31 - 1), max_size=9), st.integers(0, 31))
def test_shifted_numbers_come_back(values: list[int], shift: int) -> None:
    """Zero bits that all share are sent once."""
    whole = np.array(values, np.int64)
    numbers = np.sign(whole) * (np.abs(whole) >> shift << shift)
    given_values = {"n": len(values), "numbers": numbers, "more": whole}
    found = read(ADAPTIVE, build(ADAPTIVE, given_values), "thing")
    assert found["numbers"].tolist() == numbers.tolist()
    assert found["more"].tolist() == values


@given(st.lists(st.integers(0, 2**31 - 1), max_size=9))
def test_floats_of_any_bits_come_back_from_their_differences(bits: list[int]) -> None:
    """Equal ones after the first are zeros."""
    record = NumberRecord("n" / Number(limit=9), "floats" / Number("xor f32", times="n"))
    floats = np.array(bits, np.uint32).view(np.float32)
    found = read(record, build(record, {"n": len(bits), "floats": floats}), "thing")
    assert found["floats"].view(np.uint32).tolist() == bits
    alike = build(record, {"n": 9, "floats": np.full(9, 0.7, np.float32)})
    assert len(alike) < 2 + len(build(record, {"n": 1, "floats": np.full(1, 0.7, np.float32)}))


def test_numbers_are_spent_before_they_are_read() -> None:
    """One by one, an array at once: nothing is made of a declared length that is not allowed."""
    asked: list[int] = []

    def allow(count: int) -> bool:
        asked.append(count)
        return sum(asked) <= 13

    values = {"n": 9, "numbers": np.arange(9), "more": np.arange(9)}
    refuses("limit-expansion", lambda: read(ADAPTIVE, build(ADAPTIVE, values), "thing", spend=allow))
    assert asked == [1, 1, 9, 9]
