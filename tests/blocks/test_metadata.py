"""METADATA blocks: what is refused does not depend on the interpreter, and what is written is read back."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzz.testing.scenes import random_scene
from scarfmt.blocks.metadata import describe, nesting, pack_metadata, parse_metadata
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from scarfmt.errors import InputWarning, LimitExceeded
from scarfmt.limits import MAX_METADATA_DEPTH
from tests.samples.codec_samples import refuses

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**300), 10**300) | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
)  # fmt: skip

LOOP: dict[str, object] = {}
LOOP["a"] = LOOP


def deep(levels: int) -> bytes:
    return b'{"a":' + (levels - 1) * b"[" + (levels - 1) * b"]" + b"}"


@given(st.dictionaries(st.text(max_size=5), VALUES, max_size=4))
def test_what_is_written_is_read_back(value: dict[str, object]) -> None:
    assert parse_metadata(pack_metadata(value)) == value


def test_the_deepest_object_is_read_and_one_level_more_refused() -> None:
    """R-7.10-3, at its very limit."""
    assert nesting(deep(MAX_METADATA_DEPTH)) == MAX_METADATA_DEPTH
    parse_metadata(deep(MAX_METADATA_DEPTH))
    with pytest.raises(LimitExceeded) as caught:
        parse_metadata(deep(MAX_METADATA_DEPTH + 1), 77)
    assert (caught.value.refusal, caught.value.offset) == ("limit-metadata", 77)


@pytest.mark.parametrize("levels", [1_000, 100_000, 1_000_000])
def test_no_stack_decides_how_deep_is_too_deep(levels: int) -> None:
    """Parsers that recurse end at depths that differ by interpreter and by what called them."""
    limit = sys.getrecursionlimit()
    try:
        sys.setrecursionlimit(150)
        for data in (deep(levels), levels * b"[", levels * b'{"a":'):
            with pytest.raises(LimitExceeded):
                parse_metadata(data)
    finally:
        sys.setrecursionlimit(limit)


@given(st.binary(max_size=40) | st.text('[]{}"\\a', max_size=40).map(str.encode))
def test_nesting_is_that_of_the_specification_for_any_bytes(data: bytes) -> None:
    """Against the loop of SPEC §7.10, byte by byte."""
    depth = deepest = 0
    quoted = False
    at = iter(data)
    for byte in at:
        if quoted:
            if byte == ord("\\"):
                next(at, None)
            elif byte == ord('"'):
                quoted = False
        elif byte == ord('"'):
            quoted = True
        elif byte in b"[{":
            depth += 1
            deepest = max(deepest, depth)
        elif byte in b"]}":
            depth -= 1
    assert nesting(data) == deepest


@pytest.mark.parametrize(
    "value",
    ["\ud800", 1e999, 10**400, float("nan"), json.loads(70 * "[" + 70 * "]"), {1, 2}, LOOP],
    ids=["surrogate", "infinity", "long", "nan", "deep", "set", "loop"],
)
def test_an_encoder_refuses_what_no_reader_would_take(value: object) -> None:
    refuses("input-options", lambda: pack_metadata({"a": value}), field="metadata")


@pytest.mark.parametrize("reference", [7, {"crs": "EPSG:25832"}, {"crs": 1, "origin": [0, 0, 0]}], ids=str)
def test_a_reference_that_breaks_its_rules_is_warned_of(reference: object) -> None:
    """R-7.10-4: the scene is read all the same, without a place."""
    data = write_scene(replace(random_scene(1), metadata={"coordinate_reference": reference}))
    with pytest.warns(InputWarning, match="SPEC §7.10"):
        assert not describe(Container(BytesSource(data))).coordinate_reference


def test_keys_are_sorted_and_there_is_no_white_space() -> None:
    """R-7.10-2: by code point, at every depth; a key beyond the basic plane comes after one at its end."""
    value = {"b": [1, {"\U0001f600": 1, "\uffff": 2, "Z": 3}], "a": " kept ", "B": None}
    text = pack_metadata(value).decode()
    pairs = json.loads(text, object_pairs_hook=list)
    assert [key for key, _ in pairs] == ["B", "a", "b"]
    assert [key for key, _ in pairs[2][1][1]] == ["Z", "\uffff", "\U0001f600"]
    assert text.replace(" kept ", "").split() == [text.replace(" kept ", "")]
