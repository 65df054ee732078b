"""Manifest, schemas and files of the vectors: they agree with one another and with the generator."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from scarfmt_conformance.archive import expectation, names, read, unpack

from conformance.decoders.python.answers import EXACT
from conformance.expect.features import RULES
from conformance.generate import ROOT, generate, list_written, same
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from scarfmt.limits import FORMAT_LIMITS


def manifest() -> dict[str, Any]:
    """``manifest.json``."""
    found: dict[str, Any] = json.loads((ROOT / "manifest.json").read_text())
    return found


def validator(name: str) -> Draft202012Validator:
    schema = json.loads((ROOT / name).read_text())
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def test_the_manifest_keeps_its_schema() -> None:
    """The schema itself is valid, too."""
    validator("manifest.schema.json").validate(manifest())


def test_every_expectation_keeps_its_schema() -> None:
    """The id of an expectation is also that of its folder."""
    schema = validator("expect.schema.json")
    for name in names():
        expect = expectation(name)
        schema.validate(expect)
        assert expect["id"] == name


def test_the_generator_makes_exactly_the_files_committed() -> None:
    """Nothing is edited by hand, nothing is left over."""
    files, _ = generate([])
    there = list_written()
    assert [name for name, content in files.items() if not same(name, there.get(name), content)] == []
    assert set(there) == set(files)


def test_features_that_stand_for_rules_occur() -> None:
    """Else a rule without a refusal id would have no vector, unnoticed."""
    found = {feature for row in manifest()["vectors"] for feature in row["features"]}
    assert set(RULES) <= found


def test_core_vectors_are_those_without_blocks_of_networks() -> None:
    """By the package's reader, which had no part in naming them: SPEC §2 lists what a core decoder refuses."""
    for row in manifest()["vectors"]:
        if row["result"] == "decoded" and row["class"] in ("valid", "edge"):
            kinds = {int(entry.kind) for entry in Container(BytesSource(read(row["id"])), limits=FORMAT_LIMITS).entries}
            core = row["profile"] == "explicit" and not kinds & {3, 5, 6, 7, 8}
            assert ("core" in row["features"]) == core, row["id"]


@pytest.fixture(scope="module")
def suite() -> Iterator[Path]:
    """The suite as files."""
    with unpack(ROOT) as folder:
        yield folder


def _readme_program() -> str:
    text = (ROOT / "README.md").read_text()
    start = text.index("```python\n") + len("```python\n")
    return text[start : text.index("```", start)]


def _all_right(file: str, layer: int, _stage: str) -> dict[str, Any]:
    """The answer that is expected of a vector."""
    expect = json.loads(Path(file).with_name("expect.json").read_text())
    if expect["result"] == "decoded":
        return {"stages": expect["layers"][layer - 1]["stages"]}
    return {"refused": expect.get("refusal") or expect["refusals"][0]}


def test_the_program_of_the_readme_scores(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], suite: Path
) -> None:
    """Nothing to say of a right decoder, one line for one wrong array, one for a file taken that is to be refused."""
    monkeypatch.chdir(suite)
    names = {"json": json, "EXACT": EXACT, "ASIDE": ("metadata", "streaming")}
    exec(_readme_program(), {**names, "ask": _all_right})
    assert capsys.readouterr().out == ""

    def ask(file: str, layer: int, stage: str) -> dict[str, Any]:
        found = _all_right("vectors/worked/input.scar" if "invalid/cut/" in file else file, layer, stage)
        if "valid/index-plain/" in file and layer == 2:
            found["stages"]["context"]["arrays"]["embedding"]["sha256"] = "0" * 64
        return found

    exec(_readme_program(), {**names, "ask": ask})
    assert capsys.readouterr().out.splitlines() == ["FAIL invalid/cut 0", "FAIL valid/index-plain 2"]
