"""The reference decoder in the conformance protocol, against decoders and references that share no code with it."""

from __future__ import annotations

import base64
import io
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scarfmt_conformance.reference import answers
from scarfmt_conformance.reference.answers import CAPABILITIES, STAGES, Manner, answer, session

from conformance.decoders.python import answers as minimal_answers
from conformance.decoders.python.container import container_fields
from conformance.expect.activated import activated
from conformance.expect.expectations import expected
from conformance.generate import VECTORS
from conformance.surgery.files import blocks_of, rebuilt
from conformance.writer import write_file
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from reference_decoder.backends import backend
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.file import Container, Entry
from scarfmt.container.schema import BlockKind, Profile
from scarfmt.container.source import BytesSource, FileSource
from scarfmt.errors import InvalidInput, Truncated

BEST = backend("auto")
WHOLE, RANGE = Manner(BEST), Manner(BEST, tile_by_tile=True)
DECODED = STAGES[:-2]

Save = Callable[[bytes], str]
Answered = Callable[[dict[str, Any]], dict[str, Any]]


@pytest.fixture
def save(tmp_path: Path) -> Save:
    """Writes a file and gives its path."""

    def saved(data: bytes) -> str:
        (tmp_path / "input.scar").write_bytes(data)
        return str(tmp_path / "input.scar")

    return saved


def vector(name: str) -> str:
    """The file of a vector, in whatever class."""
    (path,) = VECTORS.glob(f"**/{name}/input.scar")
    return str(path)


def stages(path: str, layers: int = 0, manner: Manner = WHOLE) -> dict[str, Any]:
    found: dict[str, Any] = answer(path, layers, "all", manner)["stages"]
    return found


def tile_entries(data: bytes) -> list[Entry]:
    return [entry for entry in Container.open(BytesSource(data)).entries if entry.kind == BlockKind.TILE]


def pins(stage: dict[str, Any]) -> dict[str, Any]:
    """Type, shape and hash of the arrays of a stage."""
    return {name: {key: a[key] for key in ("dtype", "shape", "sha256")} for name, a in stage["arrays"].items()}


def assert_as_minimal_decoder(path: str, layers: int) -> None:
    data = Path(path).read_bytes()
    mine, other = stages(path, layers), minimal_answers.answer(data, layers, "all")["stages"]
    assert tuple(mine) == DECODED
    assert mine["container"]["container"] == container_fields(data)
    for name in minimal_answers.EXACT:
        assert pins(mine[name]) == other[name]["arrays"], name


# ------------------------------------------------------------------------------------------------ exact stages


@pytest.mark.parametrize("name", ["worked", "no-anchors", "index-modes", "predictors-deep"])
def test_every_exact_stage_is_that_of_the_minimal_decoder(name: str) -> None:
    """Each layer of vectors with and without networks."""
    path = vector(name)
    for layers in range(1, len(stages(path)["container"]["container"]["layers"]) + 1):
        assert_as_minimal_decoder(path, layers)


@pytest.mark.parametrize("seed", range(6))
def test_so_it_is_in_random_scenes(seed: int, save: Save) -> None:
    """Several tiles, both profiles, predictors, index network and grid by chance."""
    scene = neural_scene(seed, Profile(seed % 2), anchors=40, tiles=1 + seed)
    path = save(write_file(scene))
    for layers in range(1, len(scene.model.layers) + 1):
        assert_as_minimal_decoder(path, layers)


def test_frequencies_are_those_of_the_first_symbol_of_a_sub_stream() -> None:
    """SPEC appendix B by hand: layer 1 codes a split by weights 7, 7, the one anchor of layer 2 nine uniform bits."""
    path = vector("worked")
    first, second = (stages(path, layer)["frequencies"]["arrays"] for layer in (1, 2))
    halves, whole = [1 << 23, 1 << 23], [1 << 24]
    assert {name: array["first"] for name, array in first.items()} == {
        "frequencies.OPACITY": whole,
        "frequencies.POSITIONS": halves,
        "frequencies.SCALE": halves,
    }
    assert second["frequencies.POSITIONS"]["shape"] == [512]
    assert second["frequencies.POSITIONS"]["first"] == [1 << 15] * 8
    # One class at a time appears: nothing is coded.
    assert "frequencies.CLASSES" not in first | second


@pytest.mark.parametrize("name", ["index-modes", "predictors-deep", "anchors"])
def test_answers_do_not_depend_on_the_byte_order_of_the_machine(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a big-endian machine most NumPy functions give big-endian arrays, whatever their operands were."""

    def big_endian(answered: Answered) -> Answered:
        return lambda arrays: answered({key: a.astype(a.dtype.newbyteorder(">")) for key, a in arrays.items()})

    here = answer(vector(name), 0, "all", WHOLE)
    for function in ("hashed", "encoded"):
        monkeypatch.setattr(answers, function, big_endian(getattr(answers, function)))
    assert answer(vector(name), 0, "all", WHOLE) == here
    dtypes = {a["dtype"] for stage in DECODED[1:] for a in here["stages"][stage]["arrays"].values()}
    assert not [dtype for dtype in dtypes if dtype.startswith((">", "="))]


def test_first_numbers_are_those_hashed() -> None:
    """A help for someone who looks for a bug: at most eight."""
    arrays = stages(vector("worked"))["integers"]["arrays"]
    assert arrays["code"]["first"] == [15, 234, 86]
    assert arrays["v.SCALE"]["first"] == [-10, -11, -17, -5, -12, -18, -3, -4]


# ------------------------------------------------------------------------------------------------ ways to decode


@pytest.mark.parametrize("seed", [15, 28])
def test_threads_and_tiles_on_their_own_give_the_same(seed: int, save: Save) -> None:
    """Observers see the same, too: their values are kept by tile, whichever thread decodes it."""
    path = save(write_scene(neural_scene(seed, Profile(seed % 2), anchors=300, tiles=12)))
    whole = stages(path)
    assert any(name.startswith("context.") for name in whole["context"]["arrays"])
    assert "embedding" in whole["context"]["arrays"]
    assert stages(path, manner=RANGE) == whole


def test_a_stage_alone_is_that_of_all(save: Save) -> None:
    """Whatever part of the decode it needs."""
    path = save(write_scene(neural_scene(5, anchors=60)))
    whole = stages(path, 2)
    for name in DECODED:
        assert answer(path, 2, name, WHOLE) == {"stages": {name: whole[name]}}


def test_torch_gives_the_same(save: Save) -> None:
    """Embeddings come off the device as the integers they are."""
    pytest.importorskip("torch")
    path = save(write_scene(neural_scene(28, anchors=150)))
    assert stages(path, manner=Manner(backend("torch"))) == stages(path)


def test_containers_and_models_are_answered_without_a_tile(save: Save, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stage reads no further than it needs to."""
    scene = random_scene(4, anchors=300)
    data = write_scene(scene)
    path, first = save(data), tile_entries(data)[0].offset
    ends: list[int] = []
    read = FileSource.read

    def noted(self: FileSource, offset: int, length: int) -> bytes:
        ends.append(offset + length if offset else 0)  # the header is read with what may follow it
        return read(self, offset, length)

    monkeypatch.setattr(FileSource, "read", noted)
    answer(path, 1, "models", WHOLE)
    assert max(ends) <= first


# ------------------------------------------------------------------------------------------------ activated values


def assert_within_tolerance(scene: QuantisedScene, answered: dict[str, Any]) -> None:
    camera = scene.fields.origin if scene.fields.profile == Profile.ANCHOR else None
    references = activated(scene, expected(scene), camera)
    assert set(answered) == set(references)
    for name, array in answered.items():
        reference, magnitude = references[name].reference, references[name].magnitude
        assert array["shape"] == list(reference.shape)
        flat = np.frombuffer(base64.b64decode(array["data"]), array["dtype"])
        values = flat.reshape(reference.shape).astype(np.float64)
        bound = 1e-5 * np.maximum(1, np.abs(reference) if magnitude is None else magnitude)
        assert (np.abs(values - reference) <= bound).all(), name


@pytest.mark.parametrize("profile", Profile)
@pytest.mark.parametrize("seed", [1, 2, 7])
def test_activated_values_keep_the_tolerance(seed: int, profile: Profile, save: Save) -> None:
    """SPEC §9.5, against formulas written a second time; in both precisions."""
    scene = random_scene(seed, profile, anchors=50)
    path = save(write_scene(scene))
    double = stages(path)["activated"]["arrays"]
    single = stages(path, manner=replace(WHOLE, single=True))["activated"]["arrays"]
    assert {array["dtype"] for array in double.values()} == {"<f8"}
    # Centres are positions, which are binary64 in any case.
    assert {array["dtype"] for name, array in single.items() if name != "gaussian.centre"} == {"<f4"}
    assert_within_tolerance(scene, double)
    assert_within_tolerance(scene, single)


# ------------------------------------------------------------------------------------------------ refusals


@pytest.mark.parametrize("manner", [WHOLE, RANGE])
def test_a_damaged_tile_refuses_the_whole_answer(manner: Manner, save: Save) -> None:
    """An answer is refused only if it needs the damaged tile. No part of a refused decode is returned."""
    damaged = bytearray(write_scene(random_scene(3, anchors=200)))
    tile = tile_entries(bytes(damaged))[-1]
    damaged[tile.offset] ^= 1
    path = save(bytes(damaged))
    refusal = answer(path, 0, "all", manner)
    assert refusal["refused"] == "crc-mismatch"
    assert refusal["offset"] == tile.offset
    assert set(refusal) == {"refused", "offset", "message"}
    assert "stages" in answer(path, 0, "models", manner)
    assert "stages" in answer(path, tile.layer - 1, "all", manner)


def test_bad_metadata_refuses_only_who_asks_for_it(save: Save) -> None:
    """R-7.10-1: a decoder must not look at it otherwise."""
    scene = replace(random_scene(3, anchors=5), metadata={"title": "a"})
    data = write_scene(scene)
    assert answer(save(data), 0, "metadata", WHOLE) == {"stages": {"metadata": {"metadata": {"title": "a"}}}}
    blocks = [replace(b, payload=b"[]") if b.kind == BlockKind.METADATA else b for b in blocks_of(data)]
    path = save(rebuilt(data, blocks))
    assert answer(path, 0, "metadata", WHOLE)["refused"] == "bad-metadata"
    assert tuple(stages(path)) == DECODED
    without = save(write_scene(replace(scene, metadata={})))
    assert answer(without, 0, "metadata", WHOLE) == {"stages": {"metadata": {"metadata": None}}}


@pytest.mark.parametrize("name", ["header-bit", "frame-size", "neural-seal", "no-table", "idle-network"])
@pytest.mark.parametrize("manner", [WHOLE, RANGE])
def test_invalid_vectors_are_refused_with_their_id(name: str, manner: Manner) -> None:
    """However the bytes are read."""
    expect = json.loads(Path(vector(name)).with_name("expect.json").read_text())
    assert answer(vector(name), 0, "all", manner)["refused"] == expect["refusal"]


def test_what_is_no_fault_of_the_file_is_no_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A missing file, a layer or stage that there is not, a source that breaks off: nothing is swallowed."""
    path = vector("worked")
    for file, layers in ((str(tmp_path / "none.scar"), 0), (path, 3), (path, -1)):
        with pytest.raises(InvalidInput):
            answer(file, layers, "all", WHOLE)
    with pytest.raises(ValueError, match="no stage"):
        answer(path, 0, "everything", WHOLE)

    def broken(*_: object) -> bytes:
        raise Truncated("truncated-source", "the line went dead")

    monkeypatch.setattr(FileSource, "read", broken)
    with pytest.raises(Truncated):
        answer(path, 0, "all", WHOLE)


# ------------------------------------------------------------------------------------------------ the program


def test_a_session_answers_line_by_line() -> None:
    """Capabilities, values and refusals, each a line of strict JSON; the process lives on after a refusal."""
    asked = [("worked", "capabilities"), ("header-bit", "all"), ("worked", "indices")]
    questions = [json.dumps({"file": vector(name), "layers": 0, "stage": stage}) for name, stage in asked]
    out = io.StringIO()
    session(io.StringIO("\n".join(questions)), out, WHOLE)
    lines = [json.loads(line, parse_constant=pytest.fail) for line in out.getvalue().splitlines()]
    assert lines[0] == {"capabilities": CAPABILITIES}
    assert lines[1]["refused"] == "header-crc-mismatch"
    assert list(lines[2]["stages"]) == ["indices"]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "scarfmt_conformance.reference.answers", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


def test_the_program_ends_with_0_after_an_answer_only() -> None:
    """A refusal is an answer; a file that is not there is not."""
    refused = run(vector("header-bit"), "--access", "range")
    assert refused.returncode == 0
    assert json.loads(refused.stdout)["refused"] == "header-crc-mismatch"
    missing = run("none.scar")
    assert missing.returncode != 0
    assert not missing.stdout


def test_an_answer_needs_no_heavy_imports() -> None:
    """Hundreds of processes start: torch, numba, network libraries and encoders stay out."""
    path = vector("index-attention")
    heavy = ("torch", "numba", "scipy", "fsspec", "reference_encoder")
    script = (
        "import sys; from scarfmt_conformance.reference.answers import main; "
        f"main([{path!r}]); assert not set({heavy!r}) & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, timeout=60)
