#!/usr/bin/env bash
# python-zstandard reads no field of a frame header whose window is above 2^31 bytes.
#
# One would expect: get_frame_parameters parses a header and decodes nothing, so it gives the fields of every header that
#   RFC 8878 allows (windows up to 3.75 TB); frame_content_size gives the size that the header states.
# What happens: with a window of 2^31 bytes both give the content size. With 2^32 get_frame_parameters raises ZstdError
#   "Frame requires too much memory for decoding", frame_content_size "error when determining content size". What the
#   header states cannot be had; the content is 1000 bytes in both.
# Package: zstandard 0.25.0 (PyPI). Date: 2026-11-27.
# Why it matters: a reader that checks the stated size against its own limit before the window, or that lists the fields
#   of a damaged file, must parse the header itself.
# Output seen:
#   zstandard 0.25.0
#   window 2^31: content 1000, window 2147483648
#   window 2^32: ZstdError: cannot get frame parameters: Frame requires too much memory for decoding
#   window 2^32, size alone: ZstdError: error when determining content size
set -euo pipefail
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
python3 -m venv "$place/venv"
"$place/venv/bin/pip" install --quiet --disable-pip-version-check 'zstandard==0.25.0'
cd "$place"
"$place/venv/bin/python" - <<'PYTHON'
import struct
import sys

import zstandard

print("zstandard", zstandard.__version__)


def header(log2: int) -> bytes:
    """A frame header with a window of 2^log2 bytes and a content size of 1000 in four bytes."""
    return bytes.fromhex("28b52ffd") + bytes([0x80, (log2 - 10) << 3]) + struct.pack("<I", 1000)


small = zstandard.get_frame_parameters(header(31))
print(f"window 2^31: content {small.content_size}, window {small.window_size}")
refused = 0
for what, read in (("", zstandard.get_frame_parameters), (", size alone", zstandard.frame_content_size)):
    try:
        print(f"window 2^32{what}: {read(header(32))}")
    except zstandard.ZstdError as error:
        refused += 1
        print(f"window 2^32{what}: ZstdError: {error}")
sys.exit(0 if small.content_size == 1000 and refused == 2 else 1)
PYTHON
