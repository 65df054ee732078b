"""Nanoseconds of a multiply-add in the kernel, beside the peaks of this machine.

    python -m benchmarks.integer_peak     half a minute; prints a table and writes nothing

Layers of the shapes that files have are evaluated over blocks that stay in the cache: by every kind of vectors that
the processor has, and as the kernel did it before, in float32 rows (decision 0032). The peaks are loops of products and
sums in registers alone. Needs a C compiler, for benchmarks/integer_peak.c; peaks are those of x86-64 with AVX2.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.report import table
from scarfmt.kernel.loading import load
from scarfmt.kernel.words import PackedLayers, paired

SOURCE = Path(__file__).with_suffix(".c")
# As the kernel is compiled (pyproject.toml).
FLAGS = ("-O3", "-fno-trapping-math", "-fno-math-errno", "-fPIC", "-shared", "-w")
SHAPES = (
    ("predictor of 8 units, 20 inputs", 10, 20),
    ("predictor of 32 units, 40 inputs", 34, 40),
    ("predictor of 64 units, 100 inputs", 66, 100),
    ("network, 32 by 64", 32, 64),
    ("network, gates of 32 units", 96, 32),
    ("network, 64 by 64", 64, 64),
)
"""Shapes of the products: rows and inputs. Classes are no inputs of a predictor in the kernel."""
BLOCK, BLOCKS, FLOAT_ROWS, CHAINS = 16, 8, 5, 10
KINDS = 4
_ROUNDS = 2_000_000
_WORK = 30_000_000
_REPEATS = 5


def helper(folder: Path) -> ctypes.CDLL:
    """The compiled measurements of integer_peak.c.

    Raises:
        subprocess.CalledProcessError: the compiler refuses it.
    """
    out = folder / "peak.so"
    subprocess.run([os.environ.get("CC", "cc"), *FLAGS, "-o", str(out), str(SOURCE)], check=True)
    library = ctypes.CDLL(str(out))
    for name in ("integer_peak", "float_peak", "float_rows"):
        getattr(library, name).restype = ctypes.c_double
    return library


def best(measured: Callable[[], float]) -> float:
    """The least of some measurements, whatever else the machine does."""
    return min(measured() for _ in range(_REPEATS))


def peaks(library: ctypes.CDLL) -> tuple[float, float] | None:
    """Nanoseconds of a multiply-add of 16-bit pairs and of one in float32, in registers; None without AVX2."""
    if not library.has_peaks():
        return None
    rounds = ctypes.c_int64(_ROUNDS)
    products = _ROUNDS * CHAINS
    integer = best(lambda: float(library.integer_peak(rounds))) / (16 * products)
    return integer, best(lambda: float(library.float_peak(rounds))) / (8 * products)


def float_time(library: ctypes.CDLL, rows: int, inputs: int) -> float:
    """Nanoseconds of a multiply-add in float32 rows."""
    filled = -(-rows // FLOAT_ROWS) * FLOAT_ROWS
    weights, x = np.ones((filled, inputs), np.float32), np.ones((BLOCKS, inputs, BLOCK), np.float32)
    out, times = np.empty((filled, BLOCK), np.float32), max(1, _WORK // (rows * inputs * BLOCK * BLOCKS) // 4)
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (weights, x, out)]
    sizes = [ctypes.c_int64(size) for size in (rows, inputs, BLOCKS, times)]
    arguments = pointers[0], *sizes[:2], pointers[1], *sizes[2:], pointers[2]
    return best(lambda: float(library.float_rows(*arguments))) / (rows * inputs * BLOCK * BLOCKS * times)


def integer_time(rows: int, inputs: int) -> float:
    """Nanoseconds of a multiply-add of a layer in the kernel, biases, rounding and limits with it."""
    library, memory = load(), PackedLayers()
    layer = memory.layer(np.ones((rows, inputs), np.int64), np.zeros(rows, np.int64), 3, 0, 511)
    # The same blocks many times: one call should take longer than calling does.
    blocks = 64
    words = np.ascontiguousarray(
        np.broadcast_to(paired(np.ones((1, inputs), np.int64))[:, :, None], (blocks, layer.words, BLOCK))
    )
    out, times = np.empty((blocks, layer.rows, BLOCK), np.int32), max(1, _WORK // (rows * inputs * BLOCK * blocks))
    arguments = ctypes.byref(layer), words.ctypes.data, blocks, out.ctypes.data

    def measured() -> float:
        start = time.thread_time_ns()
        for _ in range(times):
            library.scar_layer(*arguments)
        return time.thread_time_ns() - start

    return best(measured) / (rows * inputs * BLOCK * blocks * times)


def kinds() -> list[tuple[int, str]]:
    """The kinds of products that this machine has, the fastest first: how many are passed over, and the name."""
    found: dict[str, int] = {}
    for some in range(KINDS):
        found.setdefault(load().scar_products(some).decode(), some)
    load().scar_products(0)
    return [(some, name) for name, some in found.items()]


def report(library: ctypes.CDLL) -> str:
    """The table, and the peaks under it."""
    here, rows = kinds(), []
    for name, outputs, inputs in SHAPES:
        before, times = float_time(library, outputs, inputs), []
        for some, _ in here:
            load().scar_products(some)
            times.append(integer_time(outputs, inputs))
        load().scar_products(0)
        cells = [f"{1000 * ns:.0f}" for ns in (before, *times)]
        rows.append([name, f"{outputs} x {inputs}", *cells, f"{before / times[0]:.1f}"])
    head = ["layer", "rows x inputs", "float32 rows", *(name for _, name in here), "times as fast"]
    text = "Picoseconds of a multiply-add:\n\n" + table(head, rows)
    found = peaks(library)
    if found is not None:
        text += (
            f"\n\nPeaks with AVX2, in registers: {1000 * found[0]:.1f} (16-bit pairs), {1000 * found[1]:.1f} (float32)."
        )
    return text


def main() -> None:
    """The command line."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        print(report(helper(Path(folder))))


if __name__ == "__main__":
    main()
