#!/usr/bin/env bash
# The BitRound filter of numcodecs makes -0 of the NaN that CUDA writes, and keeps the one that NumPy writes.
#
# One would expect: a float that is not a number to stay one, whatever its lower bits are, as in every cast of NumPy to fewer bits.
# What happens: BitRound rounds by adding half a step to the bits as an integer. A NaN whose bits are all ones, as 0x7fffffff, by
#   which NVIDIA's GPUs answer, carries over into the sign and becomes -0. One with the sign, 0xffffffff, becomes 0. NumPy's
#   own NaN, 0x7fc00000, has zeros to carry into and stays, so that a test with it passes.
# Package: numcodecs 0.16.6 (PyPI). Date: 2026-11-30.
# Why it matters: a training that fails on the GPU leaves such NaN in opacities and positions. After this filter, by which stores of
#   Zarr shrink floats, isfinite finds nothing: a broken Gaussian is one at the origin, of opacity 0.5. Look for NaN before.
# Output seen (bits, number, and what is left with 10 bits of mantissa; for half floats with 7):
#   float32: 0x7fffffff nan becomes -0, 0xffffffff nan becomes 0, 0x7fc00000 nan becomes nan, 0x7f800000 inf becomes inf
#   float16: 0x7fff nan becomes -0, 0xffff nan becomes 0, 0x7e00 nan becomes nan, 0x7c00 inf becomes inf
#   float64: 0x7fffffffffffffff nan becomes -0, 0xffffffffffffffff nan becomes 0, 0x7ff8000000000000 nan becomes nan
#   0x7fffffff as a half float by NumPy's cast: nan
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet numcodecs==0.16.6 numpy==2.4.6 2>pip.log
tools/bin/python - <<'PY'
import sys

import numpy as np
from numcodecs import BitRound

WORDS = {
    np.float32: [0x7FFFFFFF, 0xFFFFFFFF, 0x7FC00000, 0x7F800000],
    np.float16: [0x7FFF, 0xFFFF, 0x7E00, 0x7C00],
    np.float64: [0x7FFFFFFFFFFFFFFF, 0xFFFFFFFFFFFFFFFF, 0x7FF8000000000000],
}
as_told = True
for kind, words in WORDS.items():
    numbers = np.array(words, f"u{np.dtype(kind).itemsize}").view(kind)
    codec = BitRound(keepbits=7 if kind is np.float16 else 10)
    left = codec.decode(codec.encode(numbers.copy())).view(kind)
    print(f"{kind.__name__}: " + ", ".join(f"{word:#x} {a:g} becomes {b:g}" for word, a, b in zip(words, numbers, left)))
    as_told &= bool(np.isnan(numbers[:3]).all() and (left[:2] == 0).all() and np.signbit(left[0]) and np.isnan(left[2]))
half = np.array([0x7FFFFFFF], np.uint32).view(np.float32).astype(np.float16)
print(f"0x7fffffff as a half float by NumPy's cast: {half[0]:g}")
sys.exit(not (as_told and np.isnan(half[0])))
PY
