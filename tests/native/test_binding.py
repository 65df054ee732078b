"""The C library is built for every processor, found, and optional."""

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
from scarfmt_conformance.archive import read

from scarfmt.native.binding import Absent, library, open_library
from tests.conftest import REPOSITORY

COMPILER = shutil.which(os.environ.get("CC", "gcc")) or shutil.which("clang")
MARCHES = [
    "native",
    # Each unit is compiled three times over, as in the build itself, which the installation has tried already.
    *(pytest.param(march, marks=pytest.mark.slow) for march in ("x86-64", "x86-64-v2", "x86-64-v3", "x86-64-v4")),
]
EXTENSIONS: list[dict[str, Any]] = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["setuptools"][
    "ext-modules"
]
"""How the package's metadata builds the libraries."""


def test_every_unit_and_header_is_built_and_shipped() -> None:
    """A header left out would not be in the source distribution."""
    for extension in EXTENSIONS:
        folder = REPOSITORY.joinpath(*extension["name"].split(".")).parent
        assert {path.name for path in folder.glob("*.c")} <= {Path(path).name for path in extension["sources"]}
        assert {path.name for path in folder.glob("*.h")} <= {Path(path).name for path in extension["depends"]}


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.skipif(platform.machine() != "x86_64", reason="processors of another kind")
@pytest.mark.parametrize("march", MARCHES)
def test_units_compile_for_every_processor(march: str, tmp_path: Path) -> None:
    """Units compile even where the whole unit has AVX-512: GCC 12 fails on narrower clones in it."""
    for extension in EXTENSIONS:
        sources = [str(REPOSITORY / source) for source in extension["sources"]]
        command = [str(COMPILER), "-shared", "-fPIC", *extension["extra-compile-args"], f"-march={march}"]
        run = subprocess.run([*command, "-o", str(tmp_path / "native.so"), *sources], capture_output=True, text=True)
        assert run.returncode == 0, run.stderr


def test_a_build_without_a_compiler_says_so(tmp_path: Path) -> None:
    """The build reports it on the terminal and in the package, so that `scarfmt --version` can repeat it. It is not a
    failure."""
    pytest.importorskip("setuptools", minversion="77")
    paths = [path for extension in EXTENSIONS for path in (*extension["sources"], *extension["depends"])]
    metadata = ("setup.py", "pyproject.toml", "README.md", "LICENSE", "NOTICE", "scarfmt/__init__.py")
    for path in (*metadata, "scarfmt/native/__init__.py", *paths):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(REPOSITORY / path, tmp_path / path)
    environment = {**os.environ, "CC": str(tmp_path / "no-compiler"), "PYTHONPATH": ""}
    command = [sys.executable, "setup.py", "build_ext", "--inplace"]
    run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    for extension in EXTENSIONS:
        assert f"{extension['name']} could not be built" in run.stderr
        folder = tmp_path.joinpath(*extension["name"].split(".")).parent
        assert "no-compiler" in (folder / "native.failed.txt").read_text()
        assert not (folder / "native.so").exists()


def _decoded(path: Path, before: str = "", **environment: str) -> list[str]:
    """Decoder, positions and classes of a file in a process of its own."""
    code = f"""import sys
{before}
import scarfmt
from scarfmt.native.binding import describe
found = scarfmt.decode(sys.argv[1])
print(describe())
print(found.positions.tobytes().hex(), found.classes.tolist())"""
    kept = {name: value for name, value in os.environ.items() if name != "SCARFMT_NATIVE"}
    command = [sys.executable, "-c", code, str(path)]
    run = subprocess.run(command, env={**kept, **environment}, capture_output=True, text=True, check=True)
    return run.stdout.splitlines()


@pytest.mark.skipif(library() is None, reason="no C library")
def test_the_library_can_be_left_unused(tmp_path: Path) -> None:
    """SCARFMT_NATIVE=0 leaves it unused; a module that is not there stops nothing; each says so; values are equal."""
    path = tmp_path / "input.scar"
    path.write_bytes(read("worked"))
    used, unused = _decoded(path), _decoded(path, SCARFMT_NATIVE="0")
    missing = _decoded(path, 'sys.modules["scarfmt.native.native"] = None')
    assert used[0] == "native"
    assert unused[0] == "numpy (no native library: it is turned off by SCARFMT_NATIVE=0)"
    assert missing[0].startswith("numpy (no native library: it was not built")
    assert used[1] == unused[1] == missing[1]


def test_files_that_are_no_library_are_not_used(tmp_path: Path) -> None:
    """Neither what cannot be loaded nor a library of other functions."""
    (tmp_path / "native.so").write_bytes(b"text")
    with pytest.raises(Absent, match="cannot be loaded"):
        open_library(str(tmp_path / "native.so"), {})
    if COMPILER is not None:
        (tmp_path / "other.c").write_text("int scar_interface(void) { return -1; }\n")
        other = tmp_path / "other.so"
        subprocess.run([COMPILER, "-shared", "-fPIC", "-o", str(other), str(tmp_path / "other.c")], check=True)
        with pytest.raises(Absent, match="another version"):
            open_library(str(other), {"scar_open": (None, [])})
