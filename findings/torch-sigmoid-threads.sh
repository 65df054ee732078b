#!/usr/bin/env bash
# torch.sigmoid and softplus of the same numbers have other bits with another number of threads.
#
# One would expect: sums over rows to depend on the number of threads, as every note on reproducibility says, and functions
#   of one number not to; and torch.use_deterministic_algorithms(True) to see to what is left.
# What happens: each thread's share is computed by vectors but for its last few numbers, which another formula computes.
#   With other shares those are other numbers. exp and tanh have the same bits.
# Package: torch 2.13.0 (PyPI, CPU, x86-64). Date: 2026-11-29.
# Why it matters: opacities and scales of Gaussians are sigmoids. A training with the same seed may part after one iteration
#   where the machine has another number of processors. 1 / (1 + exp(-x)) has the same bits everywhere.
# Output seen:
#   torch 2.13.0, numbers of 100003 that differ from those of one thread, with 2, 3 and 4 threads:
#   exp       [0, 0, 0]
#   tanh      [0, 0, 0]
#   sigmoid   [0, 2, 0]
#   softplus  [4, 4, 4]
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet torch==2.13.0 numpy 2>pip.log
venv/bin/python - <<'PY'
import sys

import torch

torch.use_deterministic_algorithms(True)
numbers = 4 * torch.randn(100_003, generator=torch.Generator().manual_seed(1))
print("torch 2.13.0, numbers of 100003 that differ from those of one thread, with 2, 3 and 4 threads:")
differ = {}
for function in (torch.exp, torch.tanh, torch.sigmoid, torch.nn.functional.softplus):
    found = []
    for threads in (1, 2, 3, 4):
        torch.set_num_threads(threads)
        found.append(function(numbers))
    differ[function.__name__] = [int((one != found[0]).sum()) for one in found[1:]]
    print(f"{function.__name__:<9} {differ[function.__name__]}")
as_told = not any(differ["exp"] + differ["tanh"]) and any(differ["sigmoid"]) and any(differ["softplus"])
sys.exit(not as_told)
PY
