"""The browser package: its tests in Node pass, and it needs nothing at run time."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path


def test_its_own_tests_pass(web: Path) -> None:
    """Decoders, packing and streaming; each file of web/test says what it protects."""
    found = subprocess.run(
        ["npm", "test", "--silent"], cwd=web, capture_output=True, text=True, timeout=600, check=False
    )
    assert found.returncode == 0, found.stdout[-6000:] + found.stderr[-2000:]
    assert "# skipped 0" in found.stdout


def test_it_depends_on_nothing(web: Path) -> None:
    """What builds and checks it is named exactly; who uses it needs nothing, an adapter its viewer."""
    package = json.loads((web / "package.json").read_text())
    assert package.keys().isdisjoint({"dependencies", "optionalDependencies"})
    assert {name: {"optional": True} for name in package["peerDependencies"]} == package["peerDependenciesMeta"]
    assert all(version[0].isdigit() for version in package["devDependencies"].values())
    locked = json.loads((web / "package-lock.json").read_text())["packages"][""]
    assert locked["devDependencies"] == package["devDependencies"]
