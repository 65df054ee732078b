#!/usr/bin/env bash
# construct writes fewer bits than it read: FlagsEnum forgets those that have no name.
#
# One would expect: what a declaration parses and builds again is the same byte, as it is for Enum, which keeps a number
#   that it has no name for.
# What happens: the container of FlagsEnum holds the named flags alone. Building it sets the others to 0, and nothing is
#   raised. Nor can they be asked for: 0x81 and 0x01 parse to equal containers.
# Package: construct 2.10.70 (PyPI). Date: 2026-11-28.
# Why it matters: flags of SPZ and LAS gain bits with versions. A tool that changes one field of a header, and writes it
#   again, turns a tree of Spark (0x80) into a scene of parents and children, of half the opacity. Declare the byte as a
#   number beside the names, and refuse bits that have none.
# Output seen:
#   FlagsEnum: 0x81 becomes 0x01, equal to 0x01 when parsed: True
#   Enum: 0x81 becomes 0x81
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet construct==2.10.70 2>pip.log
tools/bin/python - <<'PY'
import sys

from construct import Byte, Enum, FlagsEnum

flags = FlagsEnum(Byte, antialiased=1, has_extensions=2)
kinds = Enum(Byte, antialiased=1, has_extensions=2)
parsed = flags.parse(b"\x81")
equal = {name: value for name, value in parsed.items() if name != "_flagsenum"} == {
    name: value for name, value in flags.parse(b"\x01").items() if name != "_flagsenum"
}
built, kept = flags.build(parsed), kinds.build(kinds.parse(b"\x81"))
print(f"FlagsEnum: 0x81 becomes 0x{built.hex()}, equal to 0x01 when parsed: {equal}")
print(f"Enum: 0x81 becomes 0x{kept.hex()}")
sys.exit((built, equal, kept) != (b"\x01", True, b"\x81"))
PY
