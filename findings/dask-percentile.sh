#!/usr/bin/env bash
# Percentiles of a dask array come from a few percentiles of each chunk: a tail that lies in one chunk is lost, or grows.
#
# One would expect: da.percentile of a million numbers to be near NumPy's: its documentation speaks of an approximation.
# What happens: each chunk gives the percentiles that are asked for, and these are merged, weighted by the size of chunks.
#   Of a scene whose far Gaussians come last, as trainers append them, the 1st percentile is one of the near ones, and the
#   99th too far out. The same numbers in any order give 2 %.
# Package: dask 2026.8.0 (PyPI). Date: 2026-11-28.
# Why it matters: such percentiles frame a scene, cut floaters and set ranges of quantisation. A range from them may miss
#   half of the scene. Shuffle before, or count with da.histogram.
# Output seen:
#   in order: 1st percentile -0.02, NumPy -79.73; 99th 88.97, NumPy 80.25
#   shuffled: 1st percentile -78.04, NumPy -79.73; 99th 80.76, NumPy 80.25
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet 'dask[array]==2026.8.0' numpy==2.4.6 2>pip.log
tools/bin/python - <<'PY'
import sys

import dask.array as da
import numpy as np

rng = np.random.default_rng(0)
near, far = rng.normal(size=900_000) * 0.01, rng.uniform(-100, 100, 100_000)
x = np.concatenate([near, far])
low, high = np.percentile(x, [1, 99])
found = []
for title, order in (("in order", x), ("shuffled", rng.permutation(x))):
    first, last = da.percentile(da.from_array(order, chunks=100_000), [1, 99]).compute()
    found.append((abs(first / low - 1) < 0.05, abs(last / high - 1) < 0.05))
    print(f"{title}: 1st percentile {first:.2f}, NumPy {low:.2f}; 99th {last:.2f}, NumPy {high:.2f}")
sys.exit(found != [(False, False), (True, True)])
PY
