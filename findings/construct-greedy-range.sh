#!/usr/bin/env bash
# construct's GreedyRange ends at the first record that breaks its own rules, and returns those before it.
#
# One would expect: "as many records as there are" ends where the data ends; a record in the middle with a wrong magic or
#   a failed Check raises an error, as it does in an Array.
# What happens: any error within a record ends the range as the end of data does: a wrong Const, a failed Check, a number
#   out of an enumeration. The records after it are lost, and nothing is said.
# Package: construct 2.10.70 (PyPI). Date: 2026-11-28.
# Why it matters: chunks of splat files are such records: one of a newer kind, or one flipped bit, and a scene is read
#   that lacks the rest. Put Terminated after the range: then the leftover raises.
# Output seen:
#   GreedyRange: 2 of 4 records
#   Array: ConstError
#   GreedyRange with Terminated: TerminatedError
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet construct==2.10.70 2>pip.log
tools/bin/python - <<'PY'
import sys

from construct import Array, Byte, Const, ConstructError, GreedyRange, Struct, Terminated

record = Struct("magic" / Const(b"R"), "value" / Byte)
data = b"R\1R\2X\3R\4"


def outcome(declaration):
    try:
        return f"{len(declaration.parse(data))} of 4 records"
    except ConstructError as error:
        return type(error).__name__


found = [
    ("GreedyRange", outcome(GreedyRange(record))),
    ("Array", outcome(Array(4, record))),
    ("GreedyRange with Terminated", outcome(Struct("records" / GreedyRange(record), Terminated))),
]
for title, what in found:
    print(f"{title}: {what}")
sys.exit([what for _, what in found] != ["2 of 4 records", "ConstError", "TerminatedError"])
PY
