#!/usr/bin/env bash
# The Delta filter of numcodecs loses digits of floats, and an infinity makes NaN of all that follow.
#
# One would expect: a filter before a lossless compressor to give back the array: Delta takes float types, and its decoder
#   undoes its encoder.
# What happens: differences and their sums are rounded in the type of the array. After a large number, small ones keep the
#   digits of the large one; after an infinity every number is NaN. Integers, which wrap around, come back exactly.
# Package: numcodecs 0.16.6 (PyPI). Date: 2026-11-28.
# Why it matters: one far Gaussian in a column of positions spoils those after it, and logits of opaque Gaussians are
#   infinite in files of several exporters. Take Delta of the bits as integers, or of quantised values.
# Output seen:
#   float32 after a floater: 1e+06 0.1 0.2 0.3 comes back as 1e+06 0.125 0.225 0.325
#   float32 logits: inf 0.5 -1.0 2.0 comes back as inf nan nan nan
#   the bits as int32: inf 0.5 -1.0 2.0 comes back as inf 0.5 -1.0 2.0
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet numcodecs==0.16.6 numpy==2.4.6 2>pip.log
tools/bin/python -W ignore - <<'PY'
import sys

import numpy as np
from numcodecs import Delta


def there_and_back(values, dtype):
    codec = Delta(dtype=dtype)
    return codec.decode(codec.encode(values.view(dtype))).view("<f4")


floater, logits = np.array([1e6, 0.1, 0.2, 0.3], "<f4"), np.array([np.inf, 0.5, -1, 2], "<f4")
cases = [("float32 after a floater", floater, "<f4"), ("float32 logits", logits, "<f4"), ("the bits as int32", logits, "<i4")]
found = []
for title, values, dtype in cases:
    back = there_and_back(values, dtype)
    found.append(back)
    print(f"{title}: {' '.join(map(str, values))} comes back as {' '.join(map(str, back))}")
lost = np.abs(found[0][1:] - floater[1:]).max()
sys.exit(not (0.005 < lost < 0.1 and np.isnan(found[1][1:]).all() and np.array_equal(found[2], logits)))
PY
