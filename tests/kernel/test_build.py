"""The C units compile for every processor that a compiler can aim at, and a build that fails says so."""

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


EXTENSIONS: list[dict[str, Any]] = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["setuptools"][
    "ext-modules"
]
"""How the package's metadata builds the libraries."""
EACH = pytest.mark.parametrize("told", EXTENSIONS, ids=lambda told: told["name"])


@EACH
def test_every_unit_and_header_is_told_to_the_build(told: dict[str, Any]) -> None:
    """A header left out would not be in the source distribution."""
    folder = REPOSITORY.joinpath(*told["name"].split(".")).parent
    assert {path.name for path in folder.glob("*.c")} <= {Path(path).name for path in told["sources"]}
    assert {path.name for path in folder.glob("*.h")} <= {Path(path).name for path in told["depends"]}


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.skipif(platform.machine() != "x86_64", reason="processors of another kind")
@EACH
@pytest.mark.parametrize("march", MARCHES)
def test_units_compile_for_every_processor(march: str, told: dict[str, Any], tmp_path: Path) -> None:
    """Units compile even where the whole unit has AVX-512: GCC 12 fails on narrower clones in it."""
    sources = [str(REPOSITORY / source) for source in told["sources"]]
    command = [str(COMPILER), "-shared", "-fPIC", *told["extra-compile-args"], f"-march={march}"]
    run = subprocess.run([*command, "-o", str(tmp_path / "native.so"), *sources], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_a_build_without_a_compiler_says_so(tmp_path: Path) -> None:
    """The build reports it on the terminal and in the package, so that `scarfmt --version` can repeat it. It is not a
    failure."""
    pytest.importorskip("setuptools", minversion="77")
    paths = [path for told in EXTENSIONS for path in (*told["sources"], *told["depends"])]
    metadata = ("setup.py", "pyproject.toml", "README.md", "LICENSE", "NOTICE", "scarfmt/__init__.py")
    for path in (*metadata, "scarfmt/kernel/__init__.py", *paths):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(REPOSITORY / path, tmp_path / path)
    environment = {**os.environ, "CC": str(tmp_path / "no-compiler"), "PYTHONPATH": ""}
    command = [sys.executable, "setup.py", "build_ext", "--inplace"]
    run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    for told in EXTENSIONS:
        assert f"{told['name']} could not be built" in run.stderr
        folder = tmp_path.joinpath(*told["name"].split(".")).parent
        assert "no-compiler" in (folder / "native.failed.txt").read_text()
        assert not (folder / "native.so").exists()
