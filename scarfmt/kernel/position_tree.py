"""Compiled reading of positions: the tree of splits in one call (SPEC §7.2)."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import U64
from scarfmt.codecs.positions import KEY, bad_bin, bad_rest, too_many_below
from scarfmt.entropy.symbol_tables import missing_table
from scarfmt.kernel.memory import check_symbols
from scarfmt.kernel.packed_tables import PackedTables
from scarfmt.kernel.stream_decoder import ALL_READ, KernelRansDecoder
from scarfmt.kernel.structs import Nodes, Positions
from scarfmt.kernel.symbols import KernelSymbolReader

BAD_BIN, BAD_REST, BAD_SPLIT = -2, -3, -4
_FAULTS = {BAD_BIN: bad_bin, BAD_REST: bad_rest, BAD_SPLIT: too_many_below}


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


def get_positions(reader: KernelSymbolReader, total: int, bits: int) -> U64:
    """What :func:`scarfmt.codecs.positions.get_positions` reads, of one anchor or more.

    Raises:
        Malformed: ``bad-split``, ``missing-table``.
    """
    found = KernelPositions(reader.rans, reader.packed.step(KEY), total, bits)
    if found.read in _FAULTS:
        raise _FAULTS[found.read]()
    if found.read != ALL_READ:
        raise missing_table(KEY.table(found.read))
    reader.static += found.static
    reader.uniform += found.uniform
    return found.codes
