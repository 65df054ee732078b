"""The description of a machine and the result of decoding there, as JSON: run in the emulated system."""

from __future__ import annotations

import json
import platform
import sys

import numpy as np

from scarfmt.native.binding import absence


def machine() -> dict[str, str | bool]:
    """Processor, byte order, versions, and whether the C library decodes."""
    return {
        "processor": platform.machine(),
        "byteorder": sys.byteorder,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "native": absence() is None,
    }


if __name__ == "__main__":
    print(json.dumps(machine()))
