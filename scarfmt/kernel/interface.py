"""The compiled library: found, loaded and told which arguments its functions take."""

from __future__ import annotations

import ctypes
import importlib.util
from ctypes import POINTER, Structure, c_float, c_int64, c_uint32, c_uint64, c_void_p
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from scarfmt.errors import LimitExceeded

DEPTHS, HEADS, GRU_LAYERS = 4, 2, 4
MOST_SYMBOLS = (1 << 31) - 1
"""Of one call: their places are 32-bit numbers. Tiles ask for 2^26 at most, 64 components of 2^20 anchors."""


def address(array: NDArray[Any], dtype: DTypeLike) -> int:
    """Where the numbers of an array lie. The library relies on their type and order, and changes some in place.

    Raises:
        TypeError: they are not of `dtype`, or not in one piece in C order.
    """
    if array.dtype != dtype or not array.flags.c_contiguous:
        raise TypeError(f"{array.dtype} of strides {array.strides}, not {np.dtype(dtype)} in C order")
    return int(array.ctypes.data)


def check_symbols(count: int) -> None:
    """Check that one call may read so many symbols.

    Raises:
        LimitExceeded: ``limit-tile-anchors``.
    """
    if count > MOST_SYMBOLS:
        raise LimitExceeded("limit-tile-anchors", f"{count} symbols at once: decode with SCARFMT_KERNEL=0")


class Rans(Structure):
    """State of a rANS decoder."""

    _fields_ = (("state", c_uint64), ("left", c_uint64), ("words", c_void_p))


class Tables(Structure):
    """Static tables by kind."""

    _fields_ = (
        ("kinds", c_int64),
        ("number", c_void_p),
        ("starts", c_void_p),
        ("sums", c_void_p),
        ("values", c_void_p),
        ("used", c_void_p),
    )


class Members(Structure):
    """Codewords of the clusters of a two-level head."""

    _fields_ = (
        *((name, c_int64) for name in ("clusters", "width", "largest")),
        *((name, c_void_p) for name in ("starts", "places", "weights", "offsets")),
    )


class Cells(Structure):
    """Sums over the anchors of each cell."""

    _fields_ = (
        ("depths", c_int64),
        ("columns", c_int64),
        ("cell", c_void_p * DEPTHS),
        ("sums", c_void_p * DEPTHS),
        ("sizes", c_int64 * DEPTHS),
    )


class Predictor(Structure):
    """One component's predictor."""

    _fields_ = (
        ("units", c_int64),
        ("rows", c_int64),
        ("weights", c_void_p),
        ("biases", c_void_p),
        ("output", c_void_p),
        ("output_biases", c_float * 2),
        ("last", c_float * 2),
    )


class Rule(Structure):
    """One component's static context."""

    _fields_ = tuple((name, c_int64) for name in ("by_class", "low", "shift", "source", "component", "columns"))


class Channel(Structure):
    """One channel in one tile-layer."""

    _fields_ = (
        ("count", c_int64),
        ("components", c_int64),
        *((name, c_void_p) for name in ("classes", "values", "first", "steps", "rules", "sources", "settled")),
        ("settled_columns", c_int64),
        ("settled_stride", c_int64),
        ("cells", Cells),
        *((name, c_void_p) for name in ("inputs", "kind", "symbols", "order", "counts")),
        ("step", c_int64),
        *((name, c_void_p) for name in ("predictors", "tables", "given", "kinds_out", "symbols_out")),
    )


class Layer(Structure):
    """What a layer brings of a channel."""

    _fields_ = (
        ("start", c_int64),
        ("stop", c_int64),
        *((name, c_void_p) for name in ("before", "after", "by_code")),
        ("passes_log2", c_int64),
        *((name, c_void_p) for name in ("tables", "predictors", "chosen", "anchors", "read")),
    )


class Nodes(Structure):
    """Nodes of one level of the tree of positions."""

    _fields_ = (("start", c_void_p), ("count", c_void_p), ("prefix", c_void_p))


class Positions(Structure):
    """The positions of one tile-layer."""

    _fields_ = (
        ("total", c_int64),
        ("bits", c_int64),
        ("codes", c_void_p),
        ("open", c_void_p),
        ("here", Nodes),
        ("below", Nodes),
        *((name, c_void_p) for name in ("lower", "rest", "counts", "symbols", "order", "kind")),
        ("static_read", c_int64),
        ("uniform_read", c_int64),
    )


class GridLevel(Structure):
    """One level of a hash grid."""

    _fields_ = (
        ("dims", c_int64),
        ("axes", c_int64 * 3),
        *((name, c_int64) for name in ("resolution", "table_log2", "features", "dense")),
        ("bits", c_void_p),
    )


class Grid(Structure):
    """A hash grid."""

    _fields_ = (
        ("levels", c_int64),
        ("origin", c_int64 * 3),
        ("extent_bits", c_int64),
        ("width", c_int64),
        ("level", POINTER(GridLevel)),
    )


class Embedding(Structure):
    """What the embedding of the index network reads."""

    _fields_ = (
        *((name, c_int64) for name in ("classes", "own", "attributes", "latents", "latent_shift", "grid", "amax")),
        *((name, c_void_p) for name in ("anchor_class", "settled", "features")),
    )


class Linear(Structure):
    """One rounded layer of the index network."""

    _fields_ = (
        ("inputs", c_int64),
        ("outputs", c_int64),
        ("weights", c_void_p),
        ("biases", c_void_p),
        ("low", c_float),
        ("high", c_float),
    )


class Recurrence(Structure):
    """One recurrent layer of the index network."""

    _fields_ = (
        ("tokens", c_void_p * HEADS),
        *((name, c_void_p) for name in ("inputs", "biases", "recurrent", "offsets")),
    )


class Head(Structure):
    """The head of one codebook."""

    _fields_ = (("first", Linear), ("second", Linear), ("top", Linear), ("members", POINTER(Members)))


class Network(Structure):
    """The index network, without attention."""

    _fields_ = (
        *((name, c_int64) for name in ("classes", "own", "attributes", "latents", "latent_shift", "grid")),
        *((name, c_int64) for name in ("amax", "hidden", "mixed", "layers")),
        ("embed", Linear * 2),
        ("mix_embedding", Linear),
        ("mix_state", Linear),
        *((name, c_void_p) for name in ("mix_start", "after_first", "sigmoid", "tanh", "exp2")),
        ("gru", Recurrence * GRU_LAYERS),
        ("heads", Head * HEADS),
        ("books", c_void_p * HEADS),
        ("sizes", c_int64 * HEADS),
    )


class Indices(Structure):
    """The indices of one tile-layer."""

    _fields_ = (
        ("count", c_int64),
        ("stages", c_int64),
        *((name, c_void_p) for name in ("classes", "settled", "features", "indices", "before", "after", "by_code")),
        ("passes_log2", c_int64),
        ("cells", Cells),
        *((name, c_void_p) for name in ("chosen", "anchors", "means", "lanes", "shares", "states", "weights")),
        *((name, c_void_p) for name in ("coded", "clusters", "outputs", "counts", "order", "logits")),
        *((name, c_void_p) for name in ("member_weights", "found")),
        ("modelled", c_int64),
    )


INTERFACE = 2
"""That of kernel.h: a library built before its last change would be called with wrong arguments."""

_SIGNATURES: dict[str, tuple[type | None, list[type]]] = {
    "scar_interface": (c_int64, []),
    "scar_rans_open": (None, [POINTER(Rans)]),
    "scar_rans_table": (None, [POINTER(Rans), c_void_p, c_uint32, c_int64, c_void_p]),
    "scar_rans_grouped": (c_int64, [POINTER(Rans), POINTER(Tables), c_void_p, c_int64, c_void_p, c_void_p, c_void_p]),
    "scar_rans_uniform": (None, [POINTER(Rans), c_uint32, c_int64, c_void_p]),
    "scar_rans_rows": (None, [POINTER(Rans), c_void_p, c_int64, c_int64, c_void_p]),
    "scar_rans_logits": (None, [POINTER(Rans), c_void_p, c_int64, c_int64, *[c_void_p] * 3]),
    "scar_spans_grouped": (c_int64, [POINTER(Tables), c_void_p, c_void_p, c_int64, *[c_void_p] * 4]),
    "scar_spans_rows": (None, [c_void_p, c_void_p, c_int64, c_int64, c_void_p, c_void_p]),
    "scar_spans_logits": (None, [c_void_p, c_void_p, c_int64, c_int64, *[c_void_p] * 4]),
    "scar_rans_encode": (c_int64, [c_void_p, c_void_p, c_int64, c_void_p]),
    "scar_rans_members": (None, [POINTER(Rans), POINTER(Members), c_void_p, c_void_p, c_int64, *[c_void_p] * 6]),
    "scar_fine": (None, [c_void_p, c_void_p, c_int64, c_int64, c_int64, c_void_p]),
    "scar_cells_names": (None, [c_void_p, c_void_p, c_int64, c_int64, c_void_p, c_int64, c_void_p, c_void_p]),
    "scar_cells_add": (None, [POINTER(Cells), c_void_p, c_int64, c_void_p]),
    "scar_cells_around": (None, [POINTER(Cells), c_void_p, c_int64, c_void_p, c_void_p]),
    "scar_positions": (c_int64, [POINTER(Rans), POINTER(Positions), POINTER(Tables)]),
    "scar_grid": (None, [POINTER(Grid), c_void_p, c_int64, c_void_p]),
    "scar_embedding_inputs": (None, [POINTER(Embedding), POINTER(Cells), c_void_p, c_void_p, c_int64, c_void_p]),
    "scar_indices": (c_int64, [POINTER(Rans), POINTER(Network), POINTER(Indices)]),
    "scar_values": (None, [c_void_p, c_void_p, c_void_p, c_int64, c_int64, c_void_p]),
    "scar_channel_step": (c_int64, [POINTER(Rans), POINTER(Channel), c_void_p, c_void_p, c_int64]),
    "scar_channel_layer": (c_int64, [POINTER(Rans), POINTER(Channel), POINTER(Layer)]),
}


@cache
def load() -> ctypes.CDLL | None:
    """The library with its functions declared; None where it was not built, or for another machine or version."""
    spec = importlib.util.find_spec("scarfmt.kernel.native")
    if spec is None or spec.origin is None:
        return None
    try:
        library = ctypes.CDLL(spec.origin)
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError):
        return None
    return library if library.scar_interface() == INTERFACE else None
