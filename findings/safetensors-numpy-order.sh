#!/usr/bin/env bash
# safetensors writes the memory of a NumPy array, so that a transposed one comes back with its numbers in other places.
#
# One would expect: an array to come back as it was, as from 0.7.0, or to be refused, as safetensors.torch refuses a
#   tensor that is not contiguous.
# What happens: since 0.8.0, save and save_file of safetensors.numpy take the bytes from the address of the array, and the
#   shape from the array. Of a transposed one the shape is right and the numbers are not; nothing is said.
# Package: safetensors 0.7.0 and 0.8.0 (PyPI). Date: 2026-11-28.
# Why it matters: harmonics are colour by colour in PLY and coefficient by coefficient in memory, so scenes hold transposed
#   arrays. A file of them loads, renders, and has wrong colours. Call np.ascontiguousarray before.
# Output seen:
#   0.7.0: row [0. 2. 4.] comes back as [0. 2. 4.]
#   0.8.0: row [0. 2. 4.] comes back as [0. 1. 2.]
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for version in 0.7.0 0.8.0; do
  python3 -m venv "$version"
  "$version/bin/pip" install --quiet "safetensors==$version" numpy 2>pip.log
  "$version/bin/python" - "$version" <<'PY'
import sys

import numpy as np
from safetensors.numpy import load, save

version = sys.argv[1]
harmonics = np.arange(6, dtype=np.float32).reshape(3, 2).T
back = load(save({"harmonics": harmonics}))["harmonics"]
print(f"{version}: row {harmonics[0]} comes back as {back[0]}")
wrong = np.array_equal(back.ravel(), np.arange(6))
sys.exit(back.shape != harmonics.shape or (not wrong if version == "0.8.0" else not np.array_equal(back, harmonics)))
PY
done
