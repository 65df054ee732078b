"""The compiled library is optional: left out by a variable, and missed by nobody where it was not built."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from conformance.generate import VECTORS
from scarfmt import kernel
from scarfmt.kernel.loading import INTERFACE, Absent, load

_DECODE = """
import hashlib, sys
{before}
from scarfmt.coding.reader import SceneReader
from scarfmt.container.source import BytesSource
from scarfmt.engines import best_engine, described
reader = SceneReader(BytesSource(open(sys.argv[1], "rb").read()), engine=best_engine())
found = hashlib.sha256()
for _, content in reader.tiles(reader.models()):
    for array in (content.codes, content.classes, *content.values, *content.first, content.indices):
        found.update(array.tobytes())
print(found.hexdigest(), described())
"""


def decoded(before: str = "", **environment: str) -> tuple[str, str]:
    """A hash of what was decoded, in a process of its own, and what engine it says it had."""
    path = next(path for path in sorted(VECTORS.glob("valid/*/input.scar")) if "neural" in str(path.parent))
    kept = {name: value for name, value in os.environ.items() if name != "SCARFMT_KERNEL"}
    command = [sys.executable, "-c", _DECODE.format(before=before), str(path)]
    run = subprocess.run(command, env={**kept, **environment}, capture_output=True, text=True, check=True)
    digest, engine = run.stdout.strip().split(" ", 1)
    return digest, engine


def there() -> bool:
    """Whether the library can be used."""
    try:
        return bool(load())
    except Absent:
        return False


def test_files_decode_alike_with_the_library_without_and_where_it_was_not_built() -> None:
    """SCARFMT_KERNEL=0 leaves it unused; a module that is not there stops nothing; each says so."""
    used, unused = decoded(), decoded(SCARFMT_KERNEL="0")
    missing = decoded('sys.modules["scarfmt.kernel.native"] = None')
    assert used[0] == unused[0] == missing[0]
    assert (used[1] == "kernel") == there()
    assert unused[1] == "numpy (no kernel: it is turned off by SCARFMT_KERNEL=0)"
    assert missing[1].startswith("numpy (no kernel: it was not built")


def absence() -> str:
    """Why the library cannot be used."""
    with pytest.raises(Absent) as caught:
        load.__wrapped__()
    return str(caught.value)


@pytest.mark.parametrize("content", [b"", b"no library at all", b"\x7fELF" + bytes(60)])
def test_a_file_that_is_no_library_counts_as_none(
    content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file is of another machine, or half written."""
    path = tmp_path / "native.so"
    path.write_bytes(content)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: SimpleNamespace(origin=str(path)))
    assert "another machine" in absence()


def test_a_library_without_our_functions_counts_as_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """The library was built from an older version."""
    other: Any = importlib.util.find_spec("_ctypes")
    if other is None or not str(other.origin).endswith(".so"):
        pytest.skip("no shared library at hand to mistake for ours")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: other)
    assert "another version: a function is missing" in absence()


def test_the_interface_is_that_of_the_header(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both places are changed together; a library of another interface counts as none."""
    header = Path(kernel.__file__).with_name("kernel.h").read_text()
    assert re.findall(r"^#define INTERFACE (\d+)$", header, re.MULTILINE) == [str(INTERFACE)]
    if there():
        monkeypatch.setitem(load.__wrapped__.__globals__, "INTERFACE", INTERFACE + 1)
        assert "another version: interface" in absence()
