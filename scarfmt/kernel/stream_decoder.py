"""The compiled rANS decoder (SPEC §8.2)."""

from __future__ import annotations

import ctypes
from ctypes import byref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, I32, I64, U16
from scarfmt.entropy.rans import FrequencyTable, seal_error, words_of
from scarfmt.kernel.members import EXP2_WEIGHTS, LANES, PackedMembers
from scarfmt.kernel.memory import check_symbols
from scarfmt.kernel.packed_tables import PackedTables
from scarfmt.kernel.structs import Rans
from scarfmt.kernel.words import paired

ALL_READ = -1


class KernelRansDecoder:
    """A rANS decoder equal to :class:`scarfmt.entropy.rans.RansDecoder`, and faster where many tables take turns.

    Args:
        library: the compiled library.
        data: the stream.

    Raises:
        Malformed: ``rans-length``, ``rans-last-word``.
    """

    def __init__(self, library: ctypes.CDLL, data: bytes) -> None:
        self.functions = library
        self._words = np.ascontiguousarray(words_of(data))
        self._rans = Rans(0, len(self._words), self._words.ctypes.data)
        self.pointer = byref(self._rans)
        library.scar_rans_open(self.pointer)

    def decode(self, table: FrequencyTable, count: int) -> I32:
        """The next `count` symbols, (count,) int32."""
        out = np.zeros(count, np.int32)
        if len(table) > 1 and count:
            sums = table.cumulative.astype(np.uint32)
            self.functions.scar_rans_table(self.pointer, sums.ctypes.data, len(table), count, out.ctypes.data)
        return out

    def uniform(self, size: int, count: int) -> I32:
        """The next `count` symbols of a uniform table of `size`, 1..4096."""
        out = np.zeros(count, np.int32)
        if size > 1:
            self.functions.scar_rans_uniform(self.pointer, size, count, out.ctypes.data)
        return out

    def grouped(self, tables: PackedTables, kinds: U16) -> I32 | int:
        """The next values, (n,) int32, grouped by ascending kind; a kind that has no table where there is one."""
        check_symbols(len(kinds))
        short = np.ascontiguousarray(kinds, np.uint16)
        out, order = np.empty((2, len(kinds)), np.int32)
        counts = np.empty(tables.kinds + 1, np.int64)
        addresses = (array.ctypes.data for array in (counts, order, out))
        read = self.functions.scar_rans_grouped(self.pointer, tables.pointer, short.ctypes.data, len(short), *addresses)
        return out if read == ALL_READ else int(read)

    def decode_rows(self, weights: F64) -> I32:
        """The next len(weights) symbols, (n,) int32, each with the frequencies weights[i] + 1."""
        out = np.zeros(len(weights), np.int32)
        if weights.shape[1] > 1 and len(weights):
            rows = np.ascontiguousarray(weights, np.float64)
            self.functions.scar_rans_rows(self.pointer, rows.ctypes.data, *rows.shape, out.ctypes.data)
        return out

    def decode_logits(self, logits: F32) -> I32:
        """The next n symbols, (n,) int32, of (k, n) float32 integer `logits` (SPEC §10.5)."""
        size, count = logits.shape
        out = np.zeros(count, np.int32)
        if size > 1 and count:
            rows = np.ascontiguousarray(logits, np.float32)
            scratch = np.empty((size + 1) * 2 * LANES, np.uint32)
            addresses = (array.ctypes.data for array in (EXP2_WEIGHTS, scratch, out))
            self.functions.scar_rans_logits(self.pointer, rows.ctypes.data, size, count, *addresses)
        return out

    def decode_members(self, members: PackedMembers, clusters: I64, o: F32) -> I32:
        """The member, (n,) int32, that each of n anchors chose in its cluster.

        Args:
            clusters: (n,) int64, of the head.
            o: (n, width) float32 outputs of the second projection.
        """
        out = np.empty(len(clusters), np.int32)
        struct, rows = members.struct, paired(o.astype(np.int64))
        scratch: list[NDArray[Any]] = [np.empty(struct.clusters + 1, np.int64), np.empty(len(out), np.int64)]
        scratch += [np.empty(struct.largest * LANES, np.int32), np.empty(struct.largest * LANES, np.uint32)]
        arrays = [array.ctypes.data for array in (EXP2_WEIGHTS, *scratch, out)]
        chosen = np.ascontiguousarray(clusters, np.int64)
        pointers = self.pointer, byref(struct), chosen.ctypes.data, rows.ctypes.data
        self.functions.scar_rans_members(*pointers, len(out), *arrays)
        return out

    def finish(self) -> None:
        """Check the end state (SPEC §8.2).

        Raises:
            Malformed: ``rans-seal`` when words or state are left.
        """
        if self._rans.state or self._rans.left:
            raise seal_error()
