"""The description of a machine and the result of decoding there, as JSON: run in the emulated system."""

from __future__ import annotations

import json
import platform
import sys

import numpy as np

from scarfmt.engines import absence


def machine() -> dict[str, str | bool]:
    """Processor, byte order, versions, and whether the compiled kernel decodes."""
    return {
        "processor": platform.machine(),
        "byteorder": sys.byteorder,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "kernel": absence() is None,
    }


if __name__ == "__main__":
    print(json.dumps(machine()))
