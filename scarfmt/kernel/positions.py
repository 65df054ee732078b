"""Compiled reading of positions (SPEC §7.2)."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.kernel.interface import Nodes, Positions, check_symbols
from scarfmt.kernel.rans import KernelRansDecoder, PackedTables

U64 = NDArray[np.uint64]

BAD_BIN, BAD_REST, BAD_SPLIT = -2, -3, -4


class KernelPositions:
    """The Morton codes of the new anchors of a tile-layer.

    Args:
        rans: of the sub-stream.
        tables: of its splits.
        total: anchors, at least one.
        bits: local bits per axis, 0..21.

    Attributes:
        read: ALL_READ, BAD_BIN, BAD_REST, BAD_SPLIT, or a kind that has no table.
        codes: (total,) uint64, ascending, once all were read.
        static, uniform: symbols read.
    """

    def __init__(self, rans: KernelRansDecoder, tables: PackedTables, total: int, bits: int) -> None:
        check_symbols(total)
        self.codes = np.zeros(total, np.uint64)
        scratch: list[NDArray[Any]] = [np.zeros(total, np.uint8), *np.empty((8, total), np.int64)]
        scratch += [np.empty(tables.kinds + 1, np.int64), *np.empty((2, total), np.int32), np.empty(total, np.uint16)]
        open_bits, *rest = (array.ctypes.data for array in scratch)
        struct = Positions(
            total, bits, self.codes.ctypes.data, open_bits, Nodes(*rest[:3]), Nodes(*rest[3:6]), *rest[6:]
        )
        read = rans.functions.scar_positions(rans.pointer, ctypes.byref(struct), tables.pointer)
        self.read, self.static, self.uniform = int(read), int(struct.static_read), int(struct.uniform_read)
