"""Small files that claim much: refused under a hard limit of memory, before anything of that size is allocated."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable

import pytest
import zstandard

from scarfmt.formats.source import FREE_NUMBERS
from tests.formats.rad_files import chunk, entry, file, plain
from tests.formats.scene_files import anchor_arrays, npy, sog_files, zipped

ROOM = 350 << 20
"""Memory that a refusal may take beside the interpreter and its libraries."""

_LOADS = f"""
import resource, sys
import numpy, zstandard, PIL.Image, PIL.WebPImagePlugin
from scarfmt.errors import ScarError
from scarfmt.formats import load
data = sys.stdin.buffer.read()
size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + {ROOM}, size + {ROOM}))
try:
    print("accepted", len(load(data)))
except ScarError as error:
    print(error.refusal)
"""


def _spz(count: int) -> bytes:
    """SPZ version 4 of `count` equal Gaussians of degree 3."""
    sizes = [9 * count, count, 3 * count, 3 * count, 4 * count, 45 * count]
    frames = [zstandard.ZstdCompressor().compress(bytes(size)) for size in sizes]
    head = struct.pack("<4sIIBBBBI12x", b"NGSP", 4, count, 3, 12, 0, 6, 32)
    table = b"".join(struct.pack("<QQ", len(frame), size) for frame, size in zip(frames, sizes, strict=True))
    return head + table + b"".join(frames)


def _npz(name: str, content: bytes) -> bytes:
    members = {f"{known}.npy": npy(array) for known, array in anchor_arrays().items()}
    return zipped(members | {name: content}, zipfile.ZIP_DEFLATED)


def _npz_of_zeros() -> bytes:
    """A whole, right array of 200 MiB in 200 KB."""
    head = b"{'descr': '<f4', 'fortran_order': False, 'shape': (5, 10485760)}\n"
    return _npz("feat.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + bytes(200 << 20))


def _sog(**meta: object) -> bytes:
    files = sog_files()
    return zipped(files | {"meta.json": json.dumps(json.loads(files["meta.json"]) | meta).encode()})


FREE = FREE_NUMBERS // 59
"""Gaussians of degree 3."""

BOMBS: dict[str, tuple[Callable[[], bytes], str]] = {
    "three million Gaussians in an .spz of 27 kB": (lambda: _spz(3_000_000), "input-limit"),
    "an array of 200 MiB": (_npz_of_zeros, "input-limit"),
    "200 MiB without an array's header": (lambda: _npz("anchor.npy", bytes(200 << 20)), "input-limit"),
    "60 MiB without an array's header": (lambda: _npz("anchor.npy", bytes(60 << 20)), "input-corrupt"),
    "200 MiB of metadata": (
        lambda: zipped(sog_files() | {"meta.json": bytes(200 << 20)}, zipfile.ZIP_DEFLATED),
        "input-limit",
    ),
    "a million Gaussians in a .sog of 2 kB": (lambda: _sog(count=1_000_000), "input-corrupt"),
    "200 MiB where a .rad needs one byte": (
        lambda: file([chunk(0, 1, plain(1, alpha=entry("alpha", "r8", bytes(200 << 20), 0, 1)))], count=1),
        "input-corrupt",
    ),
    "what any file may declare": (lambda: _spz(FREE), f"accepted {FREE}"),
}


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="RLIMIT_AS and /proc")
@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused_in_the_memory_that_what_any_file_may_declare_is_read_in(name: str) -> None:
    build, refusal = BOMBS[name]
    done = subprocess.run([sys.executable, "-c", _LOADS], input=build(), capture_output=True, check=False, timeout=120)
    assert done.stdout.decode().strip() == refusal, done.stderr.decode()[-500:]
