"""A fault in the C code that no test of values would show is found by `make sanitize`."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import pytest

from fuzz.corpus import encoded
from fuzz.sanitize import build, inputs, run_under_sanitizers
from fuzz.testing.parts import is_file, resealed
from tests.conftest import REPOSITORY

KERNEL = REPOSITORY / "scarfmt" / "kernel"
SOUND, BROKEN = "const int64_t past = counts[k];", "const int64_t past = counts[k] + 4096;"
"""A change of `scar_rans_grouped` after which it reads symbols beyond those asked for."""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_a_write_beyond_an_array_is_caught(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    sources = tmp_path / "kernel"
    shutil.copytree(KERNEL, sources)
    text = (sources / "rans.c").read_text()
    assert text.count(SOUND) == 1, "choose another line to break"
    (sources / "rans.c").write_text(text.replace(SOUND, BROKEN))
    folder = tmp_path / "broken"
    build(sources, folder)
    assert run_under_sanitizers(["--minutes", "0"], folder) != 0
    assert "ERROR: AddressSanitizer" in capfd.readouterr().err
    assert (folder / "current.scar").exists()


def test_inputs_are_the_corpus_then_mutants_and_every_second_one_is_sealed() -> None:
    """Unsealed, nearly all would be refused for a checksum before C code sees them."""
    files = encoded()
    found = list(itertools.islice(inputs(files, 1), len(files) + 60))
    assert [data for _, data in found[: len(files)]] == [file.data for file in files]
    deep = [data for _, data in found[len(files) + 1 :: 2]]
    assert all(resealed(data) == data for data in deep if is_file(data))
    assert sum(map(is_file, deep)) > 20
    again = list(itertools.islice(inputs(files, 1), len(files) + 60))
    assert found == again
