"""The reference decoder in the conformance protocol, against decoders and references that share no code with it."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scarfmt_conformance.archive import names
from scarfmt_conformance.reference import answers
from scarfmt_conformance.reference.answers import CAPABILITIES, Manner, answer, session

from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Container, Entry
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import BytesSource
from scarfmt.errors import InvalidInput
from tests.conformance.vector_files import vector_file

WHOLE = Manner()
Save = Callable[[bytes], str]


@pytest.fixture
def save(tmp_path: Path) -> Save:
    """Writes a file and gives its path."""

    def saved(data: bytes) -> str:
        (tmp_path / "input.scar").write_bytes(data)
        return str(tmp_path / "input.scar")

    return saved


def vector(name: str) -> str:
    """The file of a vector, in whatever class."""
    (id_,) = names(name, f"*/{name}")
    return str(vector_file(id_))


def stages(path: str, layers: int = 0, manner: Manner = WHOLE) -> dict[str, Any]:
    found: dict[str, Any] = answer(path, layers, "all", WHOLE)["stages"]
    return found


def tile_entries(data: bytes) -> list[Entry]:
    return [entry for entry in Container(BytesSource(data)).entries if entry.kind == BlockKind.TILE]


# ------------------------------------------------------------------------------------------------ exact stages


def test_answers_do_not_depend_on_the_byte_order_of_the_machine() -> None:
    """On a big-endian machine most NumPy functions give big-endian arrays, whatever their operands were."""
    for dtype in ("u1", "<u2", "<u8", "<i4", "<f4", "<f8"):
        here = {"a": np.arange(5).astype(dtype)}
        there = {"a": here["a"].astype(here["a"].dtype.newbyteorder(">"))}
        assert answers.hash_arrays(there) == answers.hash_arrays(here)
        assert answers.encode_arrays(there) == answers.encode_arrays(here)


# ------------------------------------------------------------------------------------------------ refusals


def test_a_damaged_tile_refuses_the_whole_answer(save: Save) -> None:
    """An answer is refused only if it needs the damaged tile. No part of a refused decode is returned."""
    damaged = bytearray(write_scene(random_scene(3, anchors=200)))
    tile = tile_entries(bytes(damaged))[-1]
    damaged[tile.offset] ^= 1
    path = save(bytes(damaged))
    refusal = answer(path, 0, "all", WHOLE)
    assert refusal["refused"] == "crc-mismatch"
    assert refusal["offset"] == tile.offset
    assert set(refusal) == {"refused", "offset", "message"}
    assert "stages" in answer(path, 0, "models", WHOLE)
    assert "stages" in answer(path, tile.layer - 1, "all", WHOLE)


def test_what_is_no_fault_of_the_file_is_no_answer(tmp_path: Path) -> None:
    """A missing file, a layer or stage that there is not: nothing is swallowed."""
    path = vector("worked")
    for file, layers in ((str(tmp_path / "none.scar"), 0), (path, 3), (path, -1)):
        with pytest.raises(InvalidInput):
            answer(file, layers, "all", WHOLE)
    with pytest.raises(ValueError, match="no stage"):
        answer(path, 0, "everything", WHOLE)


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
    refused = run(vector("header-bit"))
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
