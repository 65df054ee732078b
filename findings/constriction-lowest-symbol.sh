#!/usr/bin/env bash
# constriction's AnsCoder takes the lowest symbol of any model for 0 bits as long as nothing else came before.
#
# One would expect: a symbol of probability p to cost about -log2 p bits, wherever it stands, as its RangeEncoder has it.
# What happens: an empty AnsCoder holds the number 0, and the lowest symbol maps 0 to 0. So 1,000 copies of the rarest
#   symbol take no byte at all, and `is_empty` stays true; after one other symbol they cost what they should. Decoding is
#   right: an empty coder yields the lowest symbol for ever.
# Package: constriction 0.5.0 (PyPI). Date: 2026-11-28.
# Why it matters: costs of a model that are measured by coding copies of one symbol come out as 0 for the lowest, which
#   is often the rarest. A stream of symbols cannot be told from one that was never written: keep their number, and a
#   check of the content, beside it.
# Output seen:
#   AnsCoder: 1000 symbols of 16.6 bits take 0 bits, empty: True, decoded right: True
#   AnsCoder after one other symbol: 16.6 bits each
#   RangeEncoder: 16.6 bits each
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet constriction==0.5.0 numpy 2>pip.log
tools/bin/python - <<'PY'
import sys

import numpy as np
from constriction import stream

COUNT, RARE = 1000, 1e-5
model = stream.model.Categorical(np.array([RARE, 1 - RARE]), perfect=False)
message = np.zeros(COUNT, np.int32)
bits = -np.log2(RARE)

empty = stream.stack.AnsCoder()
empty.encode_reverse(message, model)
nothing, is_empty = empty.num_bits(), empty.is_empty()
right = np.array_equal(empty.decode(model, COUNT), message)
print(f"AnsCoder: {COUNT} symbols of {bits:.1f} bits take {nothing} bits, empty: {is_empty}, decoded right: {right}")

other = stream.stack.AnsCoder()
other.encode_reverse(np.array([1], np.int32), stream.model.Uniform(2))
other.encode_reverse(message, model)
after = other.num_bits() / COUNT
print(f"AnsCoder after one other symbol: {after:.1f} bits each")

queue = stream.queue.RangeEncoder()
queue.encode(message, model)
ranged = queue.num_bits() / COUNT
print(f"RangeEncoder: {ranged:.1f} bits each")
sys.exit(not (nothing == 0 and is_empty and right and abs(after - bits) < 0.5 and abs(ranged - bits) < 0.5))
PY
