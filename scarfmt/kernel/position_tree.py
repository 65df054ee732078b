"""Compiled reading and writing of positions: the tree of splits in one call (SPEC §7.2)."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import U64
from scarfmt.codecs.positions import KEY, bad_bin, bad_rest, too_many_below
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.symbol_tables import missing_table
from scarfmt.kernel.memory import address, check_symbols
from scarfmt.kernel.packed_tables import PackedTables
from scarfmt.kernel.scratch import SCRATCH
from scarfmt.kernel.stream_decoder import ALL_READ, KernelRansDecoder
from scarfmt.kernel.structs import Nodes, Positions, WrittenPositions
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
    """The version of :func:`scarfmt.codecs.positions.get_positions` that calls the library, for one anchor or more.

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


def put_positions(library: ctypes.CDLL, emitter: Emitter, codes: U64, bits: int) -> None:
    """Emit what :func:`scarfmt.codecs.positions.put_positions` emits.

    Args:
        codes: (n,) uint64, ascending, each below 2^(3 * bits).
        bits: local bits per axis, 0..21.
    """
    total = len(codes)
    if not total:
        return
    check_symbols(total)
    nodes = [SCRATCH.at(f"nodes-{place}", 8 * total) for place in range(7)]
    struct = WrittenPositions(total, bits, address(codes, np.uint64), SCRATCH.at("open", total))
    struct.here, struct.below = Nodes(*nodes[:2]), Nodes(*nodes[2:4])
    struct.lower, struct.rest, struct.width = nodes[4:]
    # Once to count, once to write.
    library.scar_positions_groups(ctypes.byref(struct))
    # A group that turns out to be empty is begun where the next one will be.
    sizes, lengths = np.empty((2, struct.groups + 1), np.int64)
    kinds, values = np.empty(struct.statics, np.uint16), np.empty(struct.symbols, np.int32)
    struct.sizes, struct.lengths, struct.kinds = sizes.ctypes.data, lengths.ctypes.data, kinds.ctypes.data
    struct.values = values.ctypes.data
    library.scar_positions_groups(ctypes.byref(struct))
    told = zip(sizes.tolist(), lengths[: struct.groups].tolist(), strict=False)
    emitter.emit_groups([(size or KEY, length) for size, length in told], kinds, values)
