"""The reference decoder, the validator, the editor and the second decoder against every vector."""

from __future__ import annotations

import base64
import hashlib
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scarfmt_conformance.protocol import ANNOTATIONS
from scarfmt_conformance.reference.answers import Manner, answer

from conformance.decoders.python import answers as minimal_answers
from conformance.decoders.python.decoder import Decoder
from conformance.decoders.python.fields import Refused
from conformance.expect.stages import EXACT
from conformance.expect.work import Work
from reference_decoder.backends import backend
from scarfmt.coding.reader import SceneReader
from scarfmt.container.source import BytesSource, open_source
from scarfmt.limits import FORMAT_LIMITS
from scarfmt.tools.truncate import truncate
from scarfmt.tools.validate import validate
from tests.conformance.vector_files import FOLDERS, VECTORS, expectation_of, name_of

MANNER = Manner(backend("auto"))
EXPECTED = {folder: expectation_of(folder) for folder in FOLDERS}
DECODED = [folder for folder in FOLDERS if "layers" in EXPECTED[folder]]
ANNOTATED = [
    (stage, folder)
    for stage in ANNOTATIONS
    for folder in FOLDERS
    if EXPECTED[folder].get("stage") == stage or stage in EXPECTED[folder]
]
RICE = [folder for folder in FOLDERS if name_of(folder).startswith(("invalid/rice-", "invalid/shift-"))]


def layers_of(expect: dict[str, Any]) -> int:
    """Layers that the header of the file declares."""
    return int(expect["layers"][-1]["stages"]["container"]["container"]["header"]["layer_count"])


def whole_file(folder: Path, scratch: Path) -> Path:
    """The file, with the zeros that `extend_to` says."""
    length = EXPECTED[folder].get("extend_to", 0)
    if not length:
        return folder / "input.scar"
    path = scratch / "input.scar"
    shutil.copyfile(folder / "input.scar", path)
    with path.open("r+b") as file:
        file.truncate(length)
    return path


def without_first(arrays: dict[str, Any]) -> dict[str, Any]:
    """Pinned or answered arrays without what is there for people."""
    return {name: {key: array[key] for key in ("dtype", "shape", "sha256")} for name, array in arrays.items()}


def check_exact(stages: dict[str, Any], pinned: dict[str, Any], claimed: tuple[str, ...] = EXACT) -> None:
    """Exactly the arrays pinned, in every exact stage."""
    for stage in claimed:
        expected = pinned.get(stage, {"arrays": {}})["arrays"]
        assert without_first(stages[stage]["arrays"]) == without_first(expected), stage
    if "container" in pinned:
        assert stages["container"] == pinned["container"]


def check_activated(folder: Path, arrays: dict[str, Any], pinned: dict[str, Any]) -> None:
    """Within the tolerance of SPEC §9.5."""
    for name, row in pinned["arrays"].items():
        count = int(np.prod(row["shape"]))
        numbers = np.frombuffer((folder / row["reference"]).read_bytes(), "<f8")
        assert len(numbers) == count * (1 + row["magnitude"])
        reference, magnitude = numbers[:count], np.abs(numbers[-count:] if count else numbers)
        assert arrays[name]["shape"] == row["shape"]
        got = np.frombuffer(base64.b64decode(arrays[name]["data"]), arrays[name]["dtype"]).astype(np.float64)
        most = np.maximum(np.abs(reference), magnitude)
        skipped = ~(most <= 1e38)
        with np.errstate(invalid="ignore"):
            near = np.abs(got - reference) <= 1e-5 * np.maximum(1, most)
        assert (near | skipped).all(), name


@pytest.mark.parametrize("folder", FOLDERS, ids=name_of)
def test_the_reference_agrees_with_the_vector(folder: Path, tmp_path: Path) -> None:
    """Every stage of every layer, or the refusal id; the hash of the file shows a damaged checkout."""
    expect = EXPECTED[folder]
    assert hashlib.sha256((folder / "input.scar").read_bytes()).hexdigest() == expect["file"]["sha256"]
    path = str(whole_file(folder, tmp_path))
    if expect["result"] == "refused":
        stage = expect["stage"] if expect["stage"] in ANNOTATIONS else "all"
        refusal = answer(path, 0, stage, MANNER)
        assert refusal["refused"] == expect["refusal"]
        if "offsets" in expect:
            first, past = expect["offsets"]
            assert first <= refusal["offset"] <= past, "R-12.1-2"
        return
    manner = replace(MANNER, camera=expect.get("camera"))
    for layer in expect.get("layers", []):
        found = answer(path, layer["layer"], "all", manner)
        if expect["result"] == "either" and "refused" in found:
            assert found["refused"] in expect["refusals"]
            continue
        check_exact(found["stages"], layer["stages"])
        if "activated" in layer["stages"]:
            check_activated(folder, found["stages"]["activated"]["arrays"], layer["stages"]["activated"])
    for stage in ANNOTATIONS:
        if stage in expect:
            assert answer(path, 0, stage, MANNER) == {"stages": {stage: {stage: expect[stage]}}}


@pytest.mark.parametrize("folder", [f for f in FOLDERS if name_of(f).startswith("either/work-")], ids=name_of)
def test_the_reference_refuses_a_byte_beyond_the_limit_of_work(folder: Path) -> None:
    """Other readers may have raised it; with the numbers of SPEC §13.2 a term that is not counted shows here."""
    found = answer(str(folder / "input.scar"), 0, "all", MANNER)
    assert found["refused"] == "limit-work"


@pytest.mark.parametrize("folder", DECODED, ids=name_of)
def test_the_work_of_the_reference_is_that_of_the_specification(folder: Path, tmp_path: Path) -> None:
    """work(k) of SPEC §13.2, computed from what the second decoder reads."""
    data = (folder / "input.scar").read_bytes()
    with open_source(str(whole_file(folder, tmp_path))) as source:
        reader = SceneReader(source, limits=FORMAT_LIMITS)
        for layer in EXPECTED[folder]["layers"]:
            models = reader.models(layer["layer"])
            declared = reader.extent(layer["layer"], np.arange(reader.header.tile_count))
            assert models.work.total(declared) == Work(Decoder(data, layer["layer"])).total()


@pytest.mark.parametrize("folder", FOLDERS, ids=name_of)
def test_validate_agrees_with_the_vector(folder: Path, tmp_path: Path) -> None:
    """Valid vectors keep every rule, (V) rules too; of others the rule broken is found, perhaps after others."""
    expect = EXPECTED[folder]
    with open_source(str(whole_file(folder, tmp_path))) as source:
        findings = validate(source).findings
    errors = {finding.refusal for finding in findings if finding.severity == "error"}
    if expect["result"] == "decoded" and expect["layers"][-1]["layer"] < layers_of(expect):
        assert errors, "layers that no decoder is asked for have faults"
    elif expect["result"] == "decoded":
        assert not errors
    elif expect["result"] == "refused":
        assert expect["refusal"] in errors
    else:
        assert errors <= set(expect["refusals"])


@pytest.mark.parametrize("folder", [f for f in FOLDERS if "from" in EXPECTED[f]], ids=name_of)
def test_truncated_vectors_are_what_an_editor_makes(folder: Path) -> None:
    """Byte for byte (SPEC §14)."""
    expect = EXPECTED[folder]
    whole = (VECTORS / expect["from"] / "input.scar").read_bytes()
    assert truncate(BytesSource(whole), expect["to_layer"]) == (folder / "input.scar").read_bytes()


@pytest.mark.parametrize("folder", DECODED, ids=name_of)
def test_a_decoder_written_from_the_specification_agrees(folder: Path) -> None:
    """SPEC.md's pseudo-code, transcribed without this package, gives the same arrays: the text suffices."""
    data = (folder / "input.scar").read_bytes()
    for layer in EXPECTED[folder]["layers"]:
        stages = minimal_answers.answer(data, layer["layer"], "all")["stages"]
        check_exact(stages, layer["stages"])


@pytest.mark.parametrize("folder", RICE, ids=name_of)
def test_a_decoder_written_from_the_specification_refuses_bad_rice_codes(folder: Path) -> None:
    """With the same id: the order of checks in SPEC §5.9 is the package's."""
    with pytest.raises(Refused) as caught:
        Decoder((folder / "input.scar").read_bytes())
    assert str(caught.value) == EXPECTED[folder]["refusal"]


@pytest.mark.parametrize(
    ("stage", "folder"), ANNOTATED, ids=lambda part: part if isinstance(part, str) else name_of(part)
)
def test_a_decoder_written_from_the_specification_reads_the_same_annotations(
    stage: str, folder: Path, tmp_path: Path
) -> None:
    """Objects, and the id of what is refused (SPEC §7.10, §7.13)."""
    expect = EXPECTED[folder]
    found = minimal_answers.answer(whole_file(folder, tmp_path).read_bytes(), 0, stage)
    if stage in expect:
        assert found == {"stages": {stage: {stage: expect[stage]}}}
    else:
        assert found["refused"] == expect["refusal"]
