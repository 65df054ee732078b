"""The stages of PROTOCOL.md and the arrays that belong to each, as ``expect.json`` pins them."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from conformance.decoders.python.tile import NAMES, Trace
from conformance.expect.expectations import Arrays

EXACT = ("models", "context", "frequencies", "indices", "integers", "sums", "values")
"""The stages whose arrays are hashed, in the order in which a decoder comes to them."""

_PREFIXES = {
    "codebook": "models",
    "grid.bits": "models",
    "grid.features": "context",
    "embedding": "context",
    "context": "context",
    "frequencies": "frequencies",
    "index": "indices",
    "tile": "integers",
    "code": "integers",
    "class": "integers",
    "slot_layer": "integers",
    "v": "integers",
    "codeword_sum": "sums",
    "position": "values",
    "value": "values",
    "latent": "values",
}
_FIRST = 8


def stage_of(name: str) -> str:
    """The stage of an array."""
    parts = name.split(".")
    return _PREFIXES[name if name in _PREFIXES else parts[0] if parts[0] in _PREFIXES else ".".join(parts[:2])]


def pinned(array: NDArray[Any]) -> dict[str, Any]:
    """Type, shape, SHA-256 of the C-order little-endian bytes, and the first numbers of an array."""
    little = array.astype(array.dtype.newbyteorder("<"))  # NumPy's functions give the byte order of the machine
    return {
        "dtype": little.dtype.str,
        "shape": list(little.shape),
        "sha256": hashlib.sha256(little.tobytes()).hexdigest(),
        "first": little.ravel()[:_FIRST].tolist(),
    }


def pinned_stages(arrays: Arrays) -> dict[str, Any]:
    """Every array, by stage in order, then by name; stages without arrays are left out."""
    out: dict[str, Any] = {}
    for stage in EXACT:
        names = sorted(name for name in arrays if stage_of(name) == stage)
        if names:
            out[stage] = {"arrays": {name: pinned(arrays[name]) for name in names}}
    return out


def traced_arrays(trace: Trace) -> Arrays:
    """The arrays of what one layer's decoding went through: predictors' contexts, embeddings, frequencies."""
    out: Arrays = {f"frequencies.{name}": np.array(f, "<u4") for name, f in trace.frequencies.items()}
    if trace.embedded:
        out["embedding"] = np.array(trace.embedded, "<i4")
    for (stream, component, step), contexts in trace.contexts.items():
        if contexts:
            out[f"context.{NAMES[stream]}.{component}.{step}"] = np.array(contexts, "<i4")
    return out
