"""Bombs, and files that once took too long or too much memory, are refused or read under a hard limit of memory."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable

import pytest

from conformance.surgery.parts import block_added, change_pages, remake
from conformance.surgery.reseal import reseal
from conformance.writer.pages import Pages
from fuzz.bombs import build, scales
from scarfmt.container.schema import BlockKind
from tests.conftest import REPOSITORY

ROOM = 100 << 20
"""Memory that a refusal may take beside the interpreter and its libraries."""
FOLDER = REPOSITORY / "fuzz" / "regressions"
TABLE = (FOLDER / "README.md").read_text()
ROWS = dict(re.findall(r"^\| `([\w-]+)\.scar` \| (?:`([\w-]+)`)? *\|", TABLE, re.MULTILINE))

_REFUSES = f"""
import json, sys, time
from pathlib import Path
from fuzz.target import decode_all, validate_all
if Path("/proc/self/statm").exists():
    import resource
    size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize() + {ROOM}
    resource.setrlimit(resource.RLIMIT_AS, (size, size))
found = {{}}
for path in map(Path, sys.argv[1:]):
    data, start = path.read_bytes(), time.process_time()
    try:
        found[path.stem] = decode_all(data), validate_all(data), time.process_time() - start
    except MemoryError:
        found[path.stem] = "out of memory", "", 0.0
print(json.dumps(found))
"""


def _base() -> bytes:
    return build(scales(), [3, 3])


def _with_count(offset: int, size: int, value: int) -> bytes:
    data = bytearray(_base())
    data[offset : offset + size] = value.to_bytes(size, "little")
    return reseal(bytes(data))


def _with_root(change: Callable[[Pages], object]) -> bytes:
    """The file with pages of one tile, and numbers of ROOT changed."""
    return change_pages(remake(_base(), lambda parts: setattr(parts, "page_bits", 0)), root=change)


def _overlapping() -> bytes:
    return _with_root(lambda pages: vars(pages.root.pages[0].rows[0]).update(row_bytes=17))


def _base_cycle() -> bytes:
    return _with_root(lambda pages: vars(pages.root.pages[1]).update(gap=0))


def _endless_block(pages: Pages) -> None:
    pages.root.models[0][0].length = (1 << 53) - 1


def _many_metadata() -> bytes:
    return remake(_base(), block_added(b"[" * 1_000_000, kind=BlockKind.METADATA, flags=2))


BOMBS: dict[str, tuple[Callable[[], bytes], str]] = {
    "2^63 anchors": (lambda: _with_count(40, 8, 1 << 63), "limit-anchors"),
    "2^32 - 1 tiles": (lambda: _with_count(32, 4, (1 << 32) - 1), "limit-tiles"),
    "2^20 tiles in a ROOT of one page": (lambda: _with_count(32, 4, 1 << 20), "payload-short"),
    "a ROOT of 2^32 - 1 bytes": (lambda: _with_count(36, 4, (1 << 32) - 1), "limit-root"),
    "a ROOT of a megabyte": (lambda: _with_count(36, 4, 1 << 20), "layer-offset"),
    "a block of 2^53 - 1 bytes": (lambda: _with_root(_endless_block), "entry-length"),
    "a page of 2^53 - 1 bytes of blocks": (
        lambda: _with_root(lambda pages: vars(pages.root.pages[0].rows[0]).update(block_bytes=(1 << 53) - 1)),
        "layer-directory-bytes",
    ),
    "a file of 2^53 bytes": (lambda: _with_count(16, 8, (1 << 53) - 1), "bad-file-length"),
    "pages that overlap": (_overlapping, "directory-length"),
    "pages in a circle": (_base_cycle, "tile-order"),
    "metadata a million deep": (_many_metadata, "limit-metadata"),
}


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, str, float]]:
    """What decode and validate say to each file, and their seconds, under a limit of memory where there is one."""
    files, folder = sorted(FOLDER.glob("*.scar")), tmp_path_factory.mktemp("bombs")
    for number, (make, _) in enumerate(BOMBS.values()):
        files.append(folder / f"{number}.scar")
        files[-1].write_bytes(make())
    command = [sys.executable, "-c", _REFUSES, *map(str, files)]
    done = subprocess.run(command, stdout=subprocess.PIPE, cwd=REPOSITORY, timeout=600, check=True)
    answers: dict[str, tuple[str, str, float]] = json.loads(done.stdout)
    return answers


WANTED = ROWS | {str(number): refusal for number, (_, refusal) in enumerate(BOMBS.values())}


def test_no_file_is_forgotten(found: dict[str, tuple[str, str, float]]) -> None:
    assert found.keys() == WANTED.keys()


@pytest.mark.parametrize("name", WANTED, ids=[*ROWS, *BOMBS])
def test_a_bomb_is_refused_within_100_mib(found: dict[str, tuple[str, str, float]], name: str) -> None:
    """By decode and by validate, and what once took minutes at once; the time is bounded loosely."""
    decoding, validating, seconds = found[name]
    assert decoding == validating == WANTED[name]
    assert seconds < 30  # a hang, not a slow machine, is what this tells apart
