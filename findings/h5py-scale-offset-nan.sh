#!/usr/bin/env bash
# The scale-offset filter of HDF5 makes a NaN the smallest number of its chunk, or makes the chunk unreadable.
#
# One would expect: a NaN to stay one among the rounded numbers, as an infinity does, or to be refused when it is written.
# What happens: h5py's scaleoffset=3 keeps three decimals of floats, as distances from the smallest number of each chunk. A NaN gets
#   distance 0. Where it comes first, it is the smallest number: of float32 the chunk is written without an error, and reading
#   it raises OSError, for all of its numbers; of float64 it stays. A chunk that has an infinity is kept unrounded.
# Package: h5py 3.16.0, whose wheel for x86-64 holds HDF5 2.0.0 (PyPI). Date: 2026-11-30.
# Why it matters: depth maps and normals have NaN where there is no surface, mostly in the corner where a chunk starts. Such a
#   hole is the nearest point of the map, or the map is lost, found out when the capture is over. Keep holes as infinity or
#   0, and read a file back before its source goes.
# Output seen (1000 depths of 2.0 m to 6.0 m in one chunk, one of them replaced; what is read there):
#   float32: inf first inf, nan in the middle 2.0, nan first OSError
#   float64: inf first inf, nan in the middle 2.0, nan first nan
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet h5py==3.16.0 numpy 2>pip.log
tools/bin/python - <<'PY'
import sys

import h5py
import numpy as np


def read_back(depths, place):
    with h5py.File("depths.h5", "w") as file:
        file.create_dataset("depths", data=depths, chunks=depths.shape, scaleoffset=3)
    with h5py.File("depths.h5") as file:
        try:
            read = file["depths"][:]
        except OSError:
            return "OSError"
    others = np.arange(depths.size) != place
    if not np.abs(read[others] - depths[others]).max() < 0.00051:
        sys.exit("other numbers differ")
    return f"{read[place]:.1f}"


seen = []
for kind in (np.float32, np.float64):
    told = []
    for title, number, place in [("inf first", np.inf, 0), ("nan in the middle", np.nan, 500), ("nan first", np.nan, 0)]:
        depths = np.random.default_rng(1).uniform(2, 6, 1000).astype(kind)
        depths[100], depths[place] = 2, number
        told.append(read_back(depths, place))
        told[-1] = f"{title} {told[-1]}"
    seen.append(f"{kind.__name__}: {', '.join(told)}")
    print(seen[-1])
sys.exit(
    seen
    != ["float32: inf first inf, nan in the middle 2.0, nan first OSError", "float64: inf first inf, nan in the middle 2.0, nan first nan"]
)
PY
