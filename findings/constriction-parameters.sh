#!/usr/bin/env bash
# constriction codes with a NaN mean as if it were a model, and says a width of 0 by what is no Exception.
#
# One would expect: parameters of an entropy model that are not finite to be refused, and refusals to be ValueErrors, as
#   those of Categorical are.
# What happens: QuantizedGaussian checks only that the width is above 0. A mean that is NaN gives a table in which the
#   highest number has nearly all of the probability: every other costs 24 bits, and decodes. A width of 0 or NaN raises a
#   PanicException, which `except Exception` does not catch, and prints to standard error from Rust.
# Package: constriction 0.5.0 (PyPI). Date: 2026-11-28.
# Why it matters: means and widths of learned codecs come from networks. One NaN makes a file many times longer, without a
#   word and without a wrong value that a test of round trips would find; a width that underflows to 0 ends a program
#   that thought it caught everything. Check both before.
# Output seen:
#   mean 5: 0 costs 18.1 bits, 5 costs 1.4 bits, 10 costs 18.1 bits
#   mean nan: 0 costs 24.0 bits, 5 costs 24.0 bits, 10 costs 0.0 bits
#   nan decodes: [5 7 3]
#   width 0: PanicException, an Exception: False
#   no probabilities: ValueError, an Exception: True
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet constriction==0.5.0 numpy 2>pip.log
tools/bin/python - <<'PY' 2>panic.log
import sys

import numpy as np
from constriction import stream

COPIES = 1000


def coder(numbers, model):
    # An empty coder takes the lowest number for nothing: so there are others in it before.
    coder = stream.stack.AnsCoder()
    coder.encode_reverse(np.array([7] * 8, np.int32), stream.model.Uniform(11))
    before = coder.num_bits()
    coder.encode_reverse(np.array(numbers, np.int32), model)
    return coder, coder.num_bits() - before


def refusal(make):
    try:
        make()
    except BaseException as error:
        return f"{type(error).__name__}, an Exception: {isinstance(error, Exception)}"
    return "accepted"


costs = {}
for mean in (5.0, float("nan")):
    model = stream.model.QuantizedGaussian(0, 10, mean, 1.0)
    costs[mean] = [coder([number] * COPIES, model)[1] / COPIES for number in (0, 5, 10)]
    print(f"mean {mean:g}: " + ", ".join(f"{n} costs {cost:.1f} bits" for n, cost in zip((0, 5, 10), costs[mean])))
decoded = coder([5, 7, 3], model)[0].decode(model, 3)
print(f"nan decodes: {decoded}")
width = refusal(lambda: stream.model.QuantizedGaussian(0, 10, 5.0, 0.0))
none = refusal(lambda: stream.model.Categorical(np.zeros(2), perfect=False))
print(f"width 0: {width}\nno probabilities: {none}")
lowest, middle, highest = costs[mean]
as_described = highest < 0.1 and middle > 23 and lowest > 23 and list(decoded) == [5, 7, 3]
sys.exit(not (as_described and width.endswith("False") and none.endswith("True")))
PY
