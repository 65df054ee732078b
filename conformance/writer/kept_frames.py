"""Frames that libzstd made once, with Huffman and FSE codes, which :mod:`conformance.writer.frames` does not write.

They are kept in ``kept_frames.json``, by the SHA-256 of their content, so that vectors do not change with libzstd.
With the environment variable ``SCAR_ADD_FRAMES=1`` a frame that is missing is made and added.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
from pathlib import Path

import zstandard

PLACE = Path(__file__).with_name("kept_frames.json")
ADD = "SCAR_ADD_FRAMES"
_LEVEL = 19


def kept_frame(content: bytes) -> bytes:
    """The frame kept of a content; a :data:`~conformance.writer.frames.Frame`.

    Raises:
        LookupError: when there is none.
    """
    frames: dict[str, str] = json.loads(PLACE.read_text()) if PLACE.exists() else {}
    name = hashlib.sha256(content).hexdigest()
    if name not in frames and os.environ.get(ADD) == "1":
        frames[name] = base64.b64encode(zstandard.ZstdCompressor(level=_LEVEL).compress(content)).decode()
        PLACE.write_text(json.dumps(frames, indent=1, sort_keys=True) + "\n")
    if name not in frames:
        raise LookupError(f"no frame of this content of {len(content)} bytes is kept: add it with {ADD}=1")
    return base64.b64decode(frames[name])
