"""The C units compile for every processor that a compiler is told to aim at, and a build that fails says so."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).parents[2]
COMPILER = shutil.which(os.environ.get("CC", "gcc")) or shutil.which("clang")
MARCHES = [
    *("x86-64-v4", "native", "skylake-avx512"),
    # Each unit is compiled three times over, as in the build itself, which the installation has tried already.
    *(pytest.param(march, marks=pytest.mark.slow) for march in ("x86-64", "x86-64-v2", "x86-64-v3")),
]


def extension() -> dict[str, Any]:
    """How the package's metadata builds the library."""
    with (REPOSITORY / "pyproject.toml").open("rb") as file:
        found: dict[str, Any] = tomllib.load(file)["tool"]["setuptools"]["ext-modules"][0]
    return found


def test_every_unit_and_header_is_told_to_the_build() -> None:
    """A header left out would not be in the source distribution."""
    folder = REPOSITORY / "scarfmt" / "kernel"
    told = extension()
    assert {Path(path).name for path in told["sources"]} == {path.name for path in folder.glob("*.c")}
    assert {Path(path).name for path in told["depends"]} == {path.name for path in folder.glob("*.h")}


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.skipif(platform.machine() != "x86_64", reason="processors of another kind")
@pytest.mark.parametrize("march", MARCHES)
def test_units_compile_for_every_processor(march: str, tmp_path: Path) -> None:
    """Also where the whole unit has AVX-512: GCC 12 fails on narrower clones in it."""
    told = extension()
    sources = [str(REPOSITORY / source) for source in told["sources"]]
    command = [str(COMPILER), "-shared", "-fPIC", *told["extra-compile-args"], f"-march={march}"]
    run = subprocess.run([*command, "-o", str(tmp_path / "native.so"), *sources], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_a_build_without_a_compiler_says_so(tmp_path: Path) -> None:
    """Where people look, and in the package, so that `scarfmt --version` can repeat it; it is no failure."""
    pytest.importorskip("setuptools", minversion="77")
    told = extension()
    for path in ("setup.py", "pyproject.toml", "README.md", "LICENSE", "NOTICE", "scarfmt/__init__.py"):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        shutil.copy(REPOSITORY / path, tmp_path / path)
    (tmp_path / "scarfmt" / "kernel").mkdir()
    for path in (*told["sources"], *told["depends"], "scarfmt/kernel/__init__.py"):
        shutil.copy(REPOSITORY / path, tmp_path / path)
    environment = {**os.environ, "CC": str(tmp_path / "no-compiler"), "PYTHONPATH": ""}
    command = [sys.executable, "setup.py", "build_ext", "--inplace"]
    run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "the compiled kernel could not be built" in run.stderr
    assert "no-compiler" in (tmp_path / "scarfmt" / "kernel" / "native.failed.txt").read_text()
    assert not (tmp_path / "scarfmt" / "kernel" / "native.so").exists()
