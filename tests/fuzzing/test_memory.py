"""Bombs under a hard limit of memory, and interrupted writes: neither leaves anything behind."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from conformance.surgery.files import change_block
from conformance.surgery.parts import block_added, change_pages, remake
from conformance.surgery.reseal import reseal
from conformance.writer.pages import Pages
from fuzz.bombs import build, scales
from scarfmt.blocks.tables import pack_tables
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable

ROOM = 100 << 20
"""Memory that a refusal may take beside the interpreter and its libraries."""

_REFUSES = f"""
import resource, sys, time
from fuzz.target import decode_all, validate_all
data = sys.stdin.buffer.read()
size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + {ROOM}, size + {ROOM}))
start = time.process_time()
print(decode_all(data) or "accepted", validate_all(data) or "accepted", time.process_time() - start)
"""


def _base() -> bytes:
    return build(scales(), [3, 3])


def _large_tables() -> bytes:
    """More than 2^20 numbers in a few bytes."""
    table = SymbolTable(np.arange(4096), np.ones(4096, np.int64))
    return pack_tables({TableKey(Stream.SCALE, j, 1, 0): table for j in range(130)})


def _with_tables(payload: bytes) -> bytes:
    return change_block(_base(), BlockKind.TABLES, 1, lambda _: payload)


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
    "a million numbers of tables": (lambda: _with_tables(_large_tables()), "limit-expansion"),
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


@pytest.mark.parametrize("name", BOMBS)
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs RLIMIT_AS and /proc")
def test_a_bomb_is_refused_within_100_mib(name: str) -> None:
    """By decode and by validate, under a limit of address space; the time is bounded loosely, as machines differ."""
    make, refusal = BOMBS[name]
    data = make()
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, "-c", _REFUSES], input=data, capture_output=True, cwd=root, timeout=120, check=True
    )
    decoding, validating, seconds = done.stdout.split()
    assert (decoding.decode(), validating.decode()) == (refusal, refusal)
    assert float(seconds) < 30  # a hang, not a slow machine, is what this tells apart
