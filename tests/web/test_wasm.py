"""The WebAssembly decoder against the conformance suite, and what its C sources repeat of the Python ones."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from conformance.generate import VECTORS
from scarfmt.neural.tables import EXP2, SIGMOID, TANH
from tests.conftest import REPOSITORY
from tests.web.conftest import WEB

SOURCES = WEB / "wasm"
TABLES = SOURCES / "integer_tables.h"
MODULE_BYTES = 120 * 1024
"""Maximum size of the module, compressed."""
WIDTH = 120


@pytest.fixture(scope="module")
def session(web: Path) -> str:
    """The command of a decoder that answers the protocol."""
    if not (web / "dist" / "scar.wasm").exists():
        pytest.skip("web/dist/scar.wasm is not built: clang-14 and lld-14 are missing")
    return f"node {web / 'dist' / 'tests' / 'conformance.mjs'} --session"


def run_suite(session: str, report: Path, *options: str) -> dict[str, int]:
    """Vectors by outcome, of a run that asks the decoder."""
    command = [sys.executable, "-m", "scarfmt", "conformance", "run", "--session", session, "--output", str(report)]
    subprocess.run([*command, *options], cwd=REPOSITORY, capture_output=True, timeout=600, check=False)
    outcomes = [vector["outcome"] for vector in json.loads(report.read_text())["vectors"]]
    return {outcome: outcomes.count(outcome) for outcome in set(outcomes)}


@pytest.mark.parametrize("kind", ["valid", "edge", "truncated"])
def test_conformance(session: str, tmp_path: Path, kind: str) -> None:
    """A viewer shows what the format says, for decoded vectors and for those that end early."""
    found = run_suite(session, tmp_path / "report.json", "--class", kind)
    assert set(found) == {"passed"}


@pytest.mark.slow
def test_whole_suite(session: str, tmp_path: Path) -> None:
    """Every refusal too, by its id."""
    found = run_suite(session, tmp_path / "report.json")
    assert set(found) == {"passed"}
    assert found["passed"] > 800


def test_module_is_small(session: str, web: Path) -> None:
    """A page loads it before it shows anything."""
    packed = subprocess.run(["gzip", "-9c", str(web / "dist" / "scar.wasm")], capture_output=True, check=True).stdout
    assert len(packed) <= MODULE_BYTES


def declaration(kind: str, name: str, numbers: tuple[int, ...]) -> str:
    """An array in C, in lines of at most WIDTH characters."""
    lines, line = [], "   "
    for number in numbers:
        if len(line) + len(f" {number},") > WIDTH - 2:
            lines.append(line)
            line = "   "
        line += f" {number},"
    return f"static const {kind} {name}[{len(numbers)}] = {{\n" + "\n".join([*lines, line]) + "\n};\n"


def test_tables_are_those_of_the_definition() -> None:
    """The tables of SPEC §10.1 are declared in Python; the header is written here: SCAR_WRITE=1."""
    wanted = (
        "/* TANH, SIGMOID and EXP2 of SPEC 10.1. Written by tests/web/test_wasm.py from scarfmt.neural.tables. */\n\n"
        "#ifndef SCAR_INTEGER_TABLES_H\n#define SCAR_INTEGER_TABLES_H\n\n#include <stdint.h>\n\n"
        + "\n".join(
            [
                declaration("int16_t", "TANH", TANH),
                declaration("int16_t", "SIGMOID", SIGMOID),
                declaration("uint32_t", "EXP2", EXP2),
            ]
        )
        + "\n#endif\n"
    )
    if os.environ.get("SCAR_WRITE"):
        TABLES.write_text(wanted)
    assert TABLES.read_text() == wanted


def test_refusals_have_ids_of_the_format() -> None:
    """An id that SPEC §12.1 does not list could not be acted on. limit-memory is the module's own."""
    spec = (REPOSITORY / "SPEC.md").read_text()
    known = set(re.findall(r"^\| `([a-z0-9-]+)` \| (?:malformed|truncated|unsupported|limit) \|", spec, re.MULTILINE))
    assert len(known) > 80
    pattern = r'(?:"([a-z0-9-]+)"\)|#define BAD "([a-z0-9-]+)")'
    texts = [path.read_text() for path in SOURCES.glob("*.c")]
    used = {one or other for text in texts for one, other in re.findall(pattern, text)}
    assert len(used) > 30
    assert used - known == {"limit-memory"}


@pytest.mark.slow
def test_vectors_under_sanitizers(tmp_path: Path) -> None:
    """Neither sound nor hostile files make the C code read or write elsewhere: the same code, on this machine."""
    compiler = shutil.which("gcc") or shutil.which("clang-14")
    if compiler is None:
        pytest.skip("there is neither gcc nor clang-14")
    program = tmp_path / "host"
    flags = ["-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined"]
    build = [str(SOURCES / "host" / "build.sh"), str(program), *flags]
    subprocess.run(build, env={**os.environ, "CC": compiler}, check=True, timeout=600)
    environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1"}
    for file in sorted(VECTORS.rglob("input.scar")):
        run = subprocess.run([program, file], env=environment, capture_output=True, text=True, timeout=120, check=False)
        assert run.returncode == 0, f"{file.parent.name}: {run.stderr[:2000]}"
