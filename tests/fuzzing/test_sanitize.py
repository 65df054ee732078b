"""A fault in the C code that no test of values would show is found by `make sanitize`."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from fuzz.sanitize import build, run_under_sanitizers
from tests.conftest import REPOSITORY

SOURCES = REPOSITORY / "scarfmt" / "native"
SOUND, BROKEN = "const int64_t past = counts[k];", "const int64_t past = counts[k] + 4096;"
"""A change of `scar_rans_grouped` after which it reads symbols beyond those asked for."""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_a_write_beyond_an_array_is_caught(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    sources = tmp_path / "native"
    shutil.copytree(SOURCES, sources)
    text = (sources / "rans.c").read_text()
    assert text.count(SOUND) == 1, "choose another line to break"
    (sources / "rans.c").write_text(text.replace(SOUND, BROKEN))
    folder = tmp_path / "broken"
    build(sources, folder)
    assert run_under_sanitizers(["--count", "0"], folder) != 0
    assert "ERROR: AddressSanitizer" in capfd.readouterr().err
