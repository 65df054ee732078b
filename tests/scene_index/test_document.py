"""Scene indices: every rule of SPEC §17 on the text of an index, in the code and as far as it can in the schema."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from conformance.scene_index.cases import HERE, index, invalid, valid
from scarfmt.errors import LimitExceeded, Malformed, ScarError, Unsupported
from scarfmt.scene_index.document import MOST_BYTES, check_size, is_index, parse_index
from tests.conftest import REPOSITORY

SCHEMA = json.loads((REPOSITORY / "conformance" / "scene.schema.json").read_text())
VALID, INVALID = sorted((HERE / "valid").glob("*.json")), sorted((HERE / "invalid").glob("*.json"))
CLASSES = {"bad-scene": Malformed, "limit-scene": LimitExceeded, "unsupported-scene": Unsupported}
UNTOLD = {
    "same-file-twice",
    "box-upside-down",
    "layers-end-elsewhere",
    "anchors-fall",
    "more-gaussians-than-slots",
    "transform-mirrors",
    "transform-shears",
    "transform-flat",
    "transform-last-row",
    "nested",
    "byte-order-mark",
    "beyond-binary64",
    "half-a-pair",
}
"""Faults that a schema cannot express, or that are not faults of the value."""


def names(path: Path) -> str:
    return path.stem


def test_the_files_are_what_the_script_writes() -> None:
    for paths, cases in ((VALID, valid()), (INVALID, invalid())):
        assert {path.stem: path.read_bytes() for path in paths} == cases


@pytest.mark.parametrize("path", VALID, ids=names)
def test_valid_indices_are_read_and_written_again(path: Path) -> None:
    data = path.read_bytes()
    assert is_index(data)
    found = parse_index(data)
    assert parse_index(found.text()) == found
    jsonschema.validate(json.loads(data), SCHEMA)
    jsonschema.validate(json.loads(found.text()), SCHEMA)


@pytest.mark.parametrize("path", INVALID, ids=names)
def test_invalid_indices_are_refused_as_their_names_say(path: Path) -> None:
    refusal, _, fault = path.stem.partition("--")
    with pytest.raises(ScarError) as caught:
        parse_index(path.read_bytes())
    assert caught.value.refusal == refusal
    assert isinstance(caught.value, CLASSES[refusal])
    try:
        value = json.loads(path.read_bytes())
    except ValueError:
        return
    told = not jsonschema.Draft202012Validator(SCHEMA).is_valid(value)
    assert told == (fault not in UNTOLD)


def test_limits_come_before_the_text_is_parsed() -> None:
    """A document that is too deep or too long need not be JSON at all."""
    with pytest.raises(LimitExceeded):
        parse_index(b"[" * 9)
    with pytest.raises(LimitExceeded):
        check_size(MOST_BYTES + 1)
    check_size(MOST_BYTES)


def test_a_reader_may_accept_fewer_files() -> None:
    text = json.dumps(index(*({**index()["files"][0], "uri": f"{n}.scar"} for n in range(3)))).encode()
    assert len(parse_index(text, files=3).files) == 3
    with pytest.raises(LimitExceeded) as caught:
        parse_index(text, files=2)
    assert caught.value.refusal == "limit-scene"


def test_layers_of_the_scene_are_those_of_all_files() -> None:
    """A file that has fewer counts with all it has (R-17-10)."""
    found = parse_index(valid()["several"])
    assert found.layer_count == 2
    assert [vars(found.layer(number)) for number in (1, 2)] == [
        {"end": 1000 + 1000 + 9000, "anchors": 30, "gaussians": 97},
        {"end": 27000, "anchors": 60, "gaussians": 127},
    ]


def test_boxes_are_placed() -> None:
    """Twice as large, a quarter turn about z, and moved."""
    low, high = parse_index(valid()["placed"]).files[0].box
    assert low.tolist() == [4.5, -1000003.0, 4.5]
    assert high.tolist() == [5.0, -999992.0, 2000.5]


def test_other_documents_are_no_index() -> None:
    assert not any(map(is_index, (b"", b"\x89SCAR", b"[1]", b"ply\n", b"  ")))


def _places(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Ways to every value in a document."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [at, *(place for key, one in inner for place in _places(one, (*at, key)))]


@pytest.mark.parametrize("odd", [None, True, -1, 0, 1e308, 2**63, "x", "", [], {}, [[]], [1, 2, 3], 1e-300, -0.5])
def test_whatever_stands_where_is_read_or_refused(odd: object) -> None:
    """Every value of every sound index replaced by something else: no error but the package's own."""
    for data in valid().values():
        document = json.loads(data)
        for *way, last in _places(document)[1:]:
            changed = json.loads(data)
            holder = changed
            for key in way:
                holder = holder[key]
            holder[last] = odd
            assert _answer(json.dumps(changed).encode()) in ("read", *CLASSES)


def _answer(data: bytes) -> str:
    try:
        found = parse_index(data)
    except ScarError as error:
        return error.refusal
    return "read" if all(len(file.box) == 2 for file in found.files) else "no box"
