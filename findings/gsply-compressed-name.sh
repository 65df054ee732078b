#!/usr/bin/env bash
# gsply writes a compressed PLY under another name than asked, and calls a missing file an unsupported format.
#
# One would expect: a writer puts a file under the name it is given; a reader of a name that is not there raises
#   FileNotFoundError.
# What happens: plywrite("a.ply", scene, compressed=True) writes a.compressed.ply and no a.ply, and returns nothing that
#   says so. plyread("a.ply") then raises ValueError, "Unsupported PLY format or invalid file", as for a damaged file.
#   read_spz of the same package raises FileNotFoundError.
# Package: gsply 0.4.6 (PyPI). Date: 2026-11-27.
# Why it matters: who writes and reads back under one name, or catches OSError, is sent to look for damage in a file
#   that does not exist.
# Output seen:
#   gsply 0.4.6
#   files: a.compressed.ply
#   plyread a.ply: ValueError: Unsupported PLY format or invalid file: a.ply.
#   read_spz none.spz: FileNotFoundError
set -euo pipefail
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
python3 -m venv "$place/venv"
"$place/venv/bin/pip" install --quiet --disable-pip-version-check 'gsply==0.4.6'
cd "$place"
mkdir work && cd work
"$place/venv/bin/python" - <<'PYTHON'
import os
import sys

import gsply
import numpy as np

numbers = np.random.default_rng(0)
count = 1000


def values(*shape: int) -> np.ndarray:
    return numbers.normal(size=(count, *shape)).astype(np.float32)


scene = gsply.GSData(means=values(3), scales=values(3), quats=values(4), opacities=values(), sh0=values(3), shN=values(15, 3))
gsply.plywrite("a.ply", scene, compressed=True)
files = os.listdir()
print(f"gsply {gsply.__version__}")
print(f"files: {', '.join(files)}")


def failure(call, name: str) -> BaseException | None:
    try:
        call(name)
    except Exception as error:
        return error
    return None


ply, spz = failure(gsply.plyread, "a.ply"), failure(gsply.read_spz, "none.spz")
print(f"plyread a.ply: {type(ply).__name__}: {str(ply).partition('. ')[0]}.")
print(f"read_spz none.spz: {type(spz).__name__}")
as_seen = (
    files == ["a.compressed.ply"]
    and type(ply) is ValueError
    and "Unsupported PLY format" in str(ply)
    and isinstance(spz, FileNotFoundError)
)
sys.exit(not as_seen)
PYTHON
