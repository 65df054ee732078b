"""The programs that write and read rival formats, and what running them costs.

Everything comes from npm and PyPI at fixed versions and lies in `$SCAR_BENCH_CACHE`, or build/rivals/ without it.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmarks.encode_cache import file_key
from benchmarks.scenes import REPOSITORY

CACHE = Path(os.environ.get("SCAR_BENCH_CACHE", REPOSITORY / "build" / "rivals")).absolute()
SPLAT_TRANSFORM = "@playcanvas/splat-transform@3.7.0"
# Readers a user of Python would take; not needed, but faster than the importers of this repository in places.
GSPLY = ("gsply==0.4.6", "isal==1.9.1", "imagecodecs==2026.3.6")
PYTHON = CACHE / "python"

_DRIVER = CACHE / "driver.mjs"
_PACKAGE = CACHE / "node_modules" / "@playcanvas" / "splat-transform" / "dist"
# What the copy of the command line does differently: k-means may run elsewhere, and the bit depths of SPZ's spherical
# harmonics, options of its library that this tool does not pass on, come from the environment.
_EDITS = (
    (
        "        // recompute scratch (reused across iterations): per-cluster column sums\n",
        "        iterations = globalThis.hostKmeans(points, numRows, nc, centroids, k, labels, iterations);\n",
    ),
    ("        sh1Bits: 5,\n", "        sh1Bits: Number(process.env.SPZ_SH1_BITS ?? 5),\n"),
    ("        shRestBits: 4,\n", "        shRestBits: Number(process.env.SPZ_SH_REST_BITS ?? 4),\n"),
)
# The peak of a process counts from that of the process that started it: this one is small.
_LAUNCHER = """
import json, os, sys, time
start = time.perf_counter()
quiet = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
child = os.posix_spawnp(sys.argv[1], sys.argv[1:], os.environ, file_actions=quiet)
_, status, usage = os.wait4(child, 0)
seconds = time.perf_counter() - start
print(json.dumps([seconds, usage.ru_maxrss, os.waitstatus_to_exitcode(status)]))
"""


class ToolFailed(Exception):
    """A program is missing or failed; the message says which and what it said last."""


@dataclass(frozen=True)
class Command:
    """A program with its arguments, and what it needs in its environment."""

    words: tuple[str, ...]
    environment: Mapping[str, str]


def install() -> str | None:
    """Fetch what is not here yet; None, or why there is no splat-transform."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        return "node and npm are not installed"
    CACHE.mkdir(parents=True, exist_ok=True)
    try:
        if not _PACKAGE.exists():
            _quietly("npm", "install", "--silent", "--no-save", "--prefix", str(CACHE), SPLAT_TRANSFORM)
        _write_copy()
    except (OSError, ToolFailed) as error:
        return str(error)
    return None


def install_readers() -> str | None:
    """Fetch gsply; None, or why it is not here."""
    if (PYTHON / "gsply").exists():
        return None
    try:
        _quietly(sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(PYTHON), *GSPLY)
    except (OSError, ToolFailed) as error:
        return str(error)
    return None


def _quietly(*words: str) -> None:
    done = subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise ToolFailed(f"{words[0]} failed: {done.stderr.strip()[-300:]}")


def _write_copy() -> None:
    text = (_PACKAGE / "cli.mjs").read_text(encoding="utf-8")
    for old, new in _EDITS:
        if text.count(old) != 1:
            raise ToolFailed(f"{SPLAT_TRANSFORM} is not as expected: {old.strip()!r} occurs {text.count(old)} times")
        text = text.replace(old, new)
    (_PACKAGE / "cli-host-kmeans.mjs").write_text(text, encoding="utf-8")
    shutil.copyfile(Path(__file__).with_name("rivals_driver.mjs"), _DRIVER)


def tool_key() -> str:
    """Changes with whatever the files of splat-transform depend on but the scene and the arguments."""
    sources = [file_key(Path(__file__).with_name(name)) for name in ("rivals_driver.mjs", "rivals_kmeans.py")]
    return "\0".join([SPLAT_TRANSFORM, repr(_EDITS), *sources])


def splat_transform(*arguments: str, **environment: str) -> Command:
    """A call of splat-transform, overwriting its output, without a GPU."""
    here = {"HOST_KMEANS": f"{sys.executable} -m benchmarks.rivals_kmeans", **environment}
    return Command(("node", str(_DRIVER), "--quiet", "--overwrite", "--gpu", "cpu", *arguments), here)


def run_command(command: Command) -> tuple[float, int]:
    """Run `command` and wait for it; its output is dropped.

    Returns:
        Wall seconds and peak memory, bytes, of the process from start to end.

    Raises:
        ToolFailed: it cannot be started, or fails.
    """
    done = subprocess.run(
        [sys.executable, "-S", "-c", _LAUNCHER, *command.words],
        cwd=REPOSITORY,
        env={**os.environ, **command.environment},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise ToolFailed(f"{command.words[0]}: {done.stderr.strip()[-300:]}")
    seconds, peak, code = json.loads(done.stdout)
    if code:
        raise ToolFailed(f"{' '.join(command.words)[:200]} ended with {code}: {done.stderr.strip()[-300:]}")
    # Kibibytes on Linux, bytes on macOS.
    return seconds, peak if sys.platform == "darwin" else peak * 1024
