"""The WebAssembly decoder against the conformance suite and the definition."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from fuzz.corpus import corpus
from fuzz.target import decode_all
from fuzz.testing.mutators import mutate
from tests.conftest import REPOSITORY


@pytest.fixture(scope="module")
def session(web: Path) -> str:
    """The command of a decoder that answers the protocol."""
    return f"node {web / 'dist' / 'tests' / 'conformance.mjs'} --session"


def test_conformance(session: str) -> None:
    """A viewer shows what the format says, and refuses by its ids; but for METADATA, nothing to a decoder of tiles."""
    command = [sys.executable, "-m", "scarfmt", "conformance", "run", "--session", session, "--format", "json"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, timeout=600, check=False)
    outcomes = [vector["outcome"] for vector in json.loads(done.stdout)["vectors"]]
    assert set(outcomes) == {"passed", "skipped"}
    assert outcomes.count("passed") > 800
    assert outcomes.count("skipped") <= 40


def test_damaged_files_are_refused_as_by_the_definition(session: str, tmp_path: Path) -> None:
    """Both refuse with the same id or both accept, but for METADATA and the limits of a decoder (SPEC §13.2)."""
    files = corpus()
    datas = [file.data for file in files]
    path = tmp_path / "mutant.scar"
    differ = []
    with subprocess.Popen(session.split(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as decoder:
        assert decoder.stdin is not None
        assert decoder.stdout is not None
        for seed in range(150):
            mutant = mutate(datas[seed % len(datas)], seed, datas)
            path.write_bytes(mutant.data)
            decoder.stdin.write(json.dumps({"file": str(path), "layers": 0, "stage": "all"}) + "\n")
            decoder.stdin.flush()
            found = json.loads(decoder.stdout.readline()).get("refused", "")
            wanted = decode_all(mutant.data).replace("bad-metadata", "")
            limits = wanted.startswith("limit-") or found.startswith("limit-")
            if wanted != found and not limits:
                differ.append((files[seed % len(files)].name, seed, mutant.operators, wanted, found))
        decoder.stdin.close()
    assert differ == []
