"""A damaged suite is reported as such, never held against a decoder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from scarfmt_conformance.manifest import Selection, check_file, find_suite, load_expectation, load_suite

from scarfmt.errors import InvalidInput
from tests.conformance.suite.conftest import SuiteWriter
from tests.samples.codec_samples import refuses


def test_the_suite_is_found_where_one_stands(
    suite: SuiteWriter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder given; else conformance/ here; else that of the checkout."""
    suite.decoded("valid/a")
    suite.load()
    assert find_suite(str(tmp_path)) == tmp_path
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / "conformance").mkdir(parents=True)
    monkeypatch.chdir(elsewhere)
    (elsewhere / "conformance" / "manifest.json").write_text("{}")
    assert find_suite(None) == elsewhere / "conformance"


@pytest.mark.parametrize(
    "change",
    [
        {"format": "scar-conformance 1"},
        {"vectors": 5},
        {"vectors": [{}]},
        {"vectors": ["first", "first"]},
        {"bitstream": "missing"},
    ],
)
def test_a_manifest_that_is_none_is_refused(suite: SuiteWriter, change: dict[str, Any]) -> None:
    suite.decoded("valid/a")
    folder = suite.load().folder
    path = folder / "manifest.json"
    value = json.loads(path.read_text())
    if change.get("vectors") == ["first", "first"]:
        change = {"vectors": value["vectors"] * 2}
    value |= change
    if value["bitstream"] == "missing":
        del value["bitstream"]
    path.write_text(json.dumps(value))
    refuses("input-suite", lambda: load_suite(folder), r"manifest\.json")


@pytest.mark.parametrize(
    ("field", "value"),
    [("file", "../input.scar"), ("expect", "/etc/passwd"), ("result", "perhaps"), ("bytes", "many")],
)
def test_an_entry_that_is_none_is_refused(suite: SuiteWriter, field: str, value: str) -> None:
    """Paths must not lead out of the suite."""
    suite.decoded("valid/a")
    suite._entries[0][field] = value
    with pytest.raises(InvalidInput, match="not a manifest"):
        suite.load()


def test_a_damaged_or_missing_file_is_named(suite: SuiteWriter) -> None:
    folder = suite.decoded("valid/a")
    (vector,) = suite.load().vectors
    check_file(vector)
    (folder / "input.scar").write_bytes(vector.file.read_bytes().replace(b"\n", b"\r\n") + b"\r")
    with pytest.raises(InvalidInput, match=r"valid/a/input\.scar.*not the file of the manifest"):
        check_file(vector)
    (folder / "input.scar").unlink()
    with pytest.raises(InvalidInput, match=r"valid/a/input\.scar.*No such file"):
        check_file(vector)


@pytest.mark.parametrize(
    "text",
    [
        "no JSON",
        "[]",
        "{}",
        '{"result": "refused"}',
        '{"result": "decoded"}',
        '{"result": "decoded", "layers": []}',
        '{"result": "decoded", "layers": [{"layer": 1}]}',
        '{"result": "decoded", "layers": 5}',
        '{"result": "refused", "refusal": "bad-table"}',
        '{"result": "decoded", "layers": [{"layer": 1, "stages": {}}], "stage": "nowhere"}',
    ],
)
def test_an_expectation_that_is_none_is_refused(suite: SuiteWriter, text: str) -> None:
    folder = suite.decoded("valid/a")
    (vector,) = suite.load().vectors
    (folder / "expect.json").write_text(text)
    refuses("input-suite", lambda: load_expectation(vector), r"expect\.json")


@pytest.mark.parametrize(
    ("selection", "ids"),
    [
        (Selection(), ["valid/a", "valid/b", "invalid/a"]),
        (Selection(only=("valid/*",)), ["valid/a", "valid/b"]),
        (Selection(only=("*/b", "invalid/?")), ["valid/b", "invalid/a"]),
        (Selection(classes=("invalid",)), ["invalid/a"]),
        (Selection(features=("one",)), ["valid/a", "valid/b"]),
        (Selection(features=("one", "two")), ["valid/b"]),
        (Selection(only=("*/a",), classes=("valid",), features=("one",)), ["valid/a"]),
    ],
)
def test_vectors_are_selected_by_id_class_and_features(
    suite: SuiteWriter, selection: Selection, ids: list[str]
) -> None:
    suite.decoded("valid/a", features=["one"])
    suite.decoded("valid/b", features=["one", "two"])
    suite.refused("invalid/a")
    assert [vector.id for vector in selection.of(suite.load().vectors)] == ids
