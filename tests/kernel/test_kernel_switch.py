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
from scarfmt.kernel.interface import INTERFACE, load
from tests.kernel.samples import needs_kernel

_DECODE = """
import hashlib, sys
{before}
from scarfmt import kernel
from scarfmt.coding.reader import SceneReader
from scarfmt.container.source import BytesSource
reader = SceneReader(BytesSource(open(sys.argv[1], "rb").read()))
found = hashlib.sha256()
for _, content in reader.tiles(reader.models()):
    for array in (content.codes, content.classes, *content.values, *content.first, content.indices):
        found.update(array.tobytes())
print(kernel.available(), kernel.enabled(), found.hexdigest())
"""


def decoded(before: str = "", **environment: str) -> list[str]:
    """Whether the library was there and used, and a hash of what was decoded, in a process of its own."""
    path = next(path for path in sorted(VECTORS.glob("valid/*/input.scar")) if "neural" in str(path.parent))
    kept = {name: value for name, value in os.environ.items() if name != "SCARFMT_KERNEL"}
    command = [sys.executable, "-c", _DECODE.format(before=before), str(path)]
    run = subprocess.run(command, env={**kept, **environment}, capture_output=True, text=True, check=True)
    return run.stdout.split()


def test_files_decode_alike_with_the_library_without_and_where_it_was_not_built() -> None:
    """SCARFMT_KERNEL=0 leaves it unused; a module that is not there stops nothing."""
    there = str(load() is not None)
    used, unused = decoded(), decoded(SCARFMT_KERNEL="0")
    missing = decoded('sys.modules["scarfmt.kernel.native"] = None')
    assert used[:2] == [there, there]
    assert unused[:2] == [there, "False"]
    assert missing[:2] == ["False", "False"]
    assert used[2] == unused[2] == missing[2]


@pytest.mark.parametrize("content", [b"", b"no library at all", b"\x7fELF" + bytes(60)])
def test_a_file_that_is_no_library_counts_as_none(
    content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of another machine, or half written."""
    path = tmp_path / "native.so"
    path.write_bytes(content)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: SimpleNamespace(origin=str(path)))
    assert load.__wrapped__() is None


def test_a_library_without_our_functions_counts_as_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """As one built from an older version."""
    other: Any = importlib.util.find_spec("_ctypes")
    if other is None or not str(other.origin).endswith(".so"):
        pytest.skip("no shared library at hand to mistake for ours")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: other)
    assert load.__wrapped__() is None


def test_the_interface_is_that_of_the_header(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both places are changed together; a library of another interface counts as none."""
    header = Path(kernel.__file__).with_name("kernel.h").read_text()
    assert re.findall(r"^#define INTERFACE (\d+)$", header, re.MULTILINE) == [str(INTERFACE)]
    monkeypatch.setitem(load.__wrapped__.__globals__, "INTERFACE", INTERFACE + 1)
    assert load.__wrapped__() is None


@needs_kernel
def test_the_switch_can_be_nested_and_survives_errors() -> None:
    """Used again only when everybody is done without it."""
    with kernel.disabled():
        with pytest.raises(ZeroDivisionError), kernel.disabled():
            raise ZeroDivisionError
        assert not kernel.enabled()
        assert kernel.available()
    assert kernel.enabled()


def test_the_variable_is_read_whenever_it_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also after the package was imported."""
    monkeypatch.setenv("SCARFMT_KERNEL", "0")
    assert not kernel.enabled()
    monkeypatch.setenv("SCARFMT_KERNEL", "1")
    assert kernel.enabled() == kernel.available()
