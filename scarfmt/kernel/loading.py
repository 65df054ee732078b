"""The compiled library: found, loaded, and its functions declared (docs/decisions/0016)."""

from __future__ import annotations

import ctypes
import importlib.util
from ctypes import POINTER, c_char_p, c_int64, c_uint32, c_void_p
from functools import cache
from pathlib import Path

from scarfmt.kernel.layout import declared, difference, layout_in, layout_of
from scarfmt.kernel.structs import (
    Activation,
    Cells,
    Channel,
    ChannelLayer,
    Codewords,
    Embedding,
    Frame,
    Grid,
    Indices,
    Layer,
    Members,
    Network,
    Positions,
    Rans,
    Tables,
    Tile,
    TileModel,
    WrittenPositions,
)

INTERFACE = 6
"""The number of the interface in kernel.h. It stands for the arguments of the functions below; structs are
compared field by field."""

_SIGNATURES: dict[str, tuple[type | None, list[type]]] = {
    "scar_interface": (c_int64, []),
    "scar_rans_open": (None, [POINTER(Rans)]),
    "scar_rans_table": (None, [POINTER(Rans), c_void_p, c_uint32, c_int64, c_void_p]),
    "scar_rans_grouped": (c_int64, [POINTER(Rans), POINTER(Tables), c_void_p, c_int64, c_void_p, c_void_p, c_void_p]),
    "scar_rans_uniform": (None, [POINTER(Rans), c_uint32, c_int64, c_void_p]),
    "scar_rans_rows": (None, [POINTER(Rans), c_void_p, c_int64, c_int64, c_void_p]),
    "scar_rans_logits": (None, [POINTER(Rans), c_void_p, c_int64, c_int64, *[c_void_p] * 3]),
    "scar_spans_grouped": (c_int64, [POINTER(Tables), c_void_p, c_void_p, c_int64, *[c_void_p] * 4]),
    "scar_spans_groups": (c_int64, [*[c_void_p] * 3, c_int64, *[c_void_p] * 6]),
    "scar_spans_rows": (None, [c_void_p, c_void_p, c_int64, c_int64, c_void_p, c_void_p]),
    "scar_spans_logits": (None, [c_void_p, c_void_p, c_int64, c_int64, *[c_void_p] * 4]),
    "scar_rans_encode": (c_int64, [c_void_p, c_void_p, c_int64, c_void_p]),
    "scar_rans_members": (None, [POINTER(Rans), POINTER(Members), c_void_p, c_void_p, c_int64, *[c_void_p] * 6]),
    "scar_fine": (None, [c_void_p, c_void_p, c_int64, c_int64, c_int64, c_void_p]),
    "scar_cells_names": (None, [c_void_p, c_void_p, c_int64, c_int64, c_void_p, c_int64, c_void_p, c_void_p]),
    "scar_cells_add": (None, [POINTER(Cells), c_void_p, c_int64, c_void_p]),
    "scar_cells_around": (None, [POINTER(Cells), c_void_p, c_int64, c_void_p, c_void_p]),
    "scar_positions": (c_int64, [POINTER(Rans), POINTER(Positions), POINTER(Tables)]),
    "scar_positions_groups": (None, [POINTER(WrittenPositions)]),
    "scar_grid": (None, [POINTER(Grid), c_void_p, c_int64, c_void_p]),
    "scar_embedding_inputs": (None, [POINTER(Embedding), POINTER(Cells), c_void_p, c_void_p, c_int64, c_void_p]),
    "scar_indices": (c_int64, [POINTER(Rans), POINTER(Network), POINTER(Indices)]),
    "scar_products": (c_char_p, [c_int64]),
    "scar_layer": (None, [POINTER(Layer), c_void_p, c_int64, c_void_p]),
    "scar_world_positions": (None, [POINTER(Frame), c_void_p, c_void_p, c_int64, c_void_p, c_int64, c_void_p]),
    "scar_values": (None, [c_void_p, c_int64, *[c_void_p] * 2, c_int64, c_int64, c_void_p]),
    "scar_activate": (None, [POINTER(Activation), c_void_p]),
    "scar_codewords": (None, [POINTER(Codewords), *[c_void_p] * 4, c_int64, c_void_p]),
    "scar_tile_memory": (c_int64, [POINTER(TileModel), c_int64, c_int64]),
    "scar_tile": (c_int64, [POINTER(TileModel), POINTER(Tile), c_int64, c_void_p]),
    "scar_channel_layer": (c_int64, [POINTER(Rans), POINTER(Channel), POINTER(ChannelLayer)]),
}


FAILURE = Path(__file__).with_name("native.failed.txt")
"""Left by a build that failed."""


class Absent(Exception):
    """No compiled library can be used; the message gives the reason."""


@cache
def load() -> ctypes.CDLL:
    """The library with its functions declared.

    Raises:
        Absent: it was not built, or for another machine or version.
    """
    spec = importlib.util.find_spec("scarfmt.kernel.native")
    if spec is None or spec.origin is None:
        raise Absent(f"it was not built: {_failure()}")
    return opened(spec.origin)


def _failure() -> str:
    """Why the build made no library, if it left word of that (setup.py)."""
    try:
        return FAILURE.read_text().strip()
    except OSError:
        return "perhaps there was no C compiler when scarfmt was installed"


def opened(path: str) -> ctypes.CDLL:
    """The library in a file, as :func:`load` gives it."""
    try:
        library = ctypes.CDLL(path)
    except OSError as error:
        raise Absent(f"it cannot be loaded, perhaps it was built for another machine: {error}") from error
    try:
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except AttributeError as error:
        raise Absent("it was built from another version: a function is missing") from error
    found = library.scar_interface()
    if found != INTERFACE:
        raise Absent(f"it was built from another version: interface {found}, not {INTERFACE}")
    other = difference(layout_of(declared()), layout_in(library))
    if other is not None:
        raise Absent(f"it was built from another version: the layout of {other} differs")
    return library
