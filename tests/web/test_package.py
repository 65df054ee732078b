"""The browser package: its tests in Node pass, and it needs nothing at run time."""

from __future__ import annotations

import gzip
import json
import re
import subprocess
from pathlib import Path

MOST_GZIPPED = 40_000
"""Bytes of what a page loads before it decodes, and again of the decoder in JavaScript."""
MOST_OF_AN_ADAPTER = 8_000
"""Bytes of what an adapter adds to the stream."""
MOST_BESIDE_MODULE = 15_000
"""Bytes of the script that the decoder in WebAssembly has beside its module."""


def test_its_own_tests_pass(web: Path) -> None:
    """Decoders, packing and streaming; each file of web/test says what it protects."""
    found = subprocess.run(
        ["npm", "test", "--silent"], cwd=web, capture_output=True, text=True, timeout=600, check=False
    )
    assert found.returncode == 0, found.stdout[-6000:] + found.stderr[-2000:]
    assert "# skipped 0" in found.stdout


def test_it_depends_on_nothing(web: Path) -> None:
    """Packages that build and check it have exact versions. A user of the package needs no other, an adapter only its
    viewer."""
    package = json.loads((web / "package.json").read_text())
    assert package.keys().isdisjoint({"dependencies", "optionalDependencies"})
    assert {name: {"optional": True} for name in package["peerDependencies"]} == package["peerDependenciesMeta"]
    assert all(version[0].isdigit() for version in package["devDependencies"].values())
    locked = json.loads((web / "package-lock.json").read_text())["packages"][""]
    assert locked["devDependencies"] == package["devDependencies"]


def _loaded(dist: Path, name: str, lazy: bool) -> set[str]:
    """A script and what it imports at once; with `lazy`, what it imports later too."""
    pattern = r"""(?:from|import)\s*["']\./([\w.-]+\.js)["']""" if not lazy else r"""["']\./([\w.-]+\.js)["']"""
    found = {name}
    queue = [name]
    while queue:
        for other in re.findall(pattern, (dist / queue.pop()).read_text()):
            if other not in found:
                found.add(other)
                queue.append(other)
    return found


def _gzipped(dist: Path, names: set[str]) -> int:
    return sum(len(gzip.compress((dist / name).read_bytes(), 9)) for name in names)


def test_it_is_small(web: Path) -> None:
    """A page loads the stream alone; decoders are chunks of their own, for workers; an adapter has no viewer in it."""
    dist = web / "dist"
    stream = _loaded(dist, "scar-stream.js", lazy=False)
    assert _gzipped(dist, stream) <= MOST_GZIPPED
    for adapter in ("spark.js", "playcanvas.js"):
        assert _gzipped(dist, _loaded(dist, adapter, lazy=False) - stream) <= MOST_OF_AN_ADAPTER
    for pattern, most in (("js-*.js", MOST_GZIPPED), ("wasm-*.js", MOST_BESIDE_MODULE)):
        (chunk,) = dist.glob(pattern)
        assert chunk.name not in stream
        assert chunk.name in _loaded(dist, "worker.js", lazy=True)
        assert _gzipped(dist, _loaded(dist, chunk.name, lazy=False)) <= most
