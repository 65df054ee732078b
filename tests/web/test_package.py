"""The browser package: its tests in Node pass, it needs nothing at run time, and it is small."""

from __future__ import annotations

import gzip
import json
import re
import subprocess
from pathlib import Path

MOST_GZIPPED = 36_000
"""Bytes of what a page loads before it decodes."""
MOST_OF_AN_ADAPTER = 8_000
"""Bytes of what an adapter adds to the stream."""
MOST_OF_A_VIEWER = 48_000
"""Bytes of viewer, element, stream, adapter and worker together: all but three.js, Spark and the module."""
MOST_OF_A_WORKER = 10_000
"""Bytes of the script that a worker loads beside the module."""
MOST_OF_THE_MODULE = 60_000
"""Bytes of the decoder, which a page loads once."""


def test_its_own_tests_pass(web: Path) -> None:
    """Decoder, planning and streaming; each file of web/test says what it protects."""
    done = subprocess.run(
        ["npm", "test", "--silent"], cwd=web, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    assert "skipped 0\n" in done.stdout


def test_it_depends_on_nothing(web: Path) -> None:
    """Packages that build and check it have exact versions. A user of the package needs no other, an adapter only its
    viewer."""
    package = json.loads((web / "package.json").read_text())
    assert package.keys().isdisjoint({"dependencies", "optionalDependencies"})
    assert {name: {"optional": True} for name in package["peerDependencies"]} == package["peerDependenciesMeta"]
    assert all(version[0].isdigit() for version in package["devDependencies"].values())


def _loaded(dist: Path, name: str) -> set[str]:
    """A script and what it imports at once."""
    found = {name}
    queue = [name]
    while queue:
        imported = set(re.findall(r"""(?:from|import)\s*["']\./([\w.-]+\.js)["']""", (dist / queue.pop()).read_text()))
        queue += imported - found
        found |= imported
    return found


def _gzipped(dist: Path, names: set[str]) -> int:
    return sum(len(gzip.compress((dist / name).read_bytes(), 9)) for name in names)


def test_it_is_small(web: Path) -> None:
    """A page waits for the stream, a worker for the decoder; an adapter has no viewer in it."""
    dist = web / "dist"
    stream = _loaded(dist, "scar-stream.js")
    assert _gzipped(dist, stream) <= MOST_GZIPPED
    (stage,) = (path.name for path in dist.glob("stage-*.js"))
    whole = set().union(*(_loaded(dist, name) for name in ("element.js", stage, "worker.js")))
    assert _gzipped(dist, whole) <= MOST_OF_A_VIEWER
    assert _gzipped(dist, _loaded(dist, "worker.js")) <= MOST_OF_A_WORKER
    assert _gzipped(dist, {"scar.wasm"}) <= MOST_OF_THE_MODULE
    for adapter in ("loaders.js", "three.js", "playcanvas.js"):
        assert _gzipped(dist, _loaded(dist, adapter) - stream) <= MOST_OF_AN_ADAPTER
