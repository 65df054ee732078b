"""Reading and writing sub-streams with the compiled coders (SPEC §8)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from scarfmt.arrays import F32, F64, I32, I64, U16, Ints
from scarfmt.entropy.emitters import Group, SymbolWriter
from scarfmt.entropy.keys import StepKey, TableKey
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.entropy.symbol_tables import StaticTables, SymbolTable, missing_table
from scarfmt.kernel.members import PackedMembers
from scarfmt.kernel.packed_tables import PackedStaticTables
from scarfmt.kernel.stream_decoder import KernelRansDecoder
from scarfmt.kernel.stream_encoder import KernelRansEncoder


class KernelSymbolReader(SymbolReader):
    """Reads one sub-stream, many groups in one call.

    Args:
        library: the compiled library.
        data: the sub-stream.
        tables: static tables in force.

    Attributes:
        rans: the decoder.
        packed: the tables.
    """

    def __init__(self, library: ctypes.CDLL, data: bytes, tables: Mapping[TableKey, SymbolTable]) -> None:
        self.rans = KernelRansDecoder(library, data)
        super().__init__(data, tables, self.rans)

    @property
    def packed(self) -> PackedStaticTables:
        """The tables in force, as the library reads them."""
        if not isinstance(self._tables, StaticTables):
            self._tables = StaticTables(self._tables)
        return self._tables.kept(PackedStaticTables)

    def read_grouped(self, key: StepKey, kinds: Ints) -> I32:
        found = self.rans.grouped(self.packed.step(key), kinds.astype(np.uint16, copy=False))
        if isinstance(found, int):
            raise missing_table(key.table(found))
        self.static += len(kinds)
        return found

    def read_uniform(self, size: int, count: int) -> I64:
        self.uniform += count
        return self.rans.uniform(size, count).astype(np.int64)

    def read_logits(self, logits: F32 | None, weights: Callable[[], F64], stage: int) -> I64:
        if logits is None:
            return self.read_rows(weights(), stage)
        self.modelled += logits.shape[1]
        return self.rans.decode_logits(logits).astype(np.int64)

    def read_members(self, members: PackedMembers, clusters: I64, o: F32) -> I32:
        """The members, (n,) int32, that follow (n,) `clusters` in a two-level head, of (n, R) projections `o`."""
        self.modelled += int(np.count_nonzero(members.sizes[clusters] > 1))
        return self.rans.decode_members(members, clusters, o)


class KernelSymbolWriter(SymbolWriter):
    """Codes one sub-stream, many groups in one call; the same bytes.

    Args:
        library: the compiled library.
        tables: static tables in force.
    """

    def __init__(self, library: ctypes.CDLL, tables: Mapping[TableKey, SymbolTable]) -> None:
        self._compiled = KernelRansEncoder(library)
        self._static = StaticTables.of(tables)
        super().__init__(self._static, self._compiled)

    def emit_grouped(self, key: StepKey, kinds: Ints, values: Ints) -> None:
        self._compiled.encode_grouped(self._static.kept(PackedStaticTables).step(key), kinds, values)

    def emit_groups(self, groups: Sequence[Group], kinds: U16, values: Ints) -> None:
        packed = self._static.kept(PackedStaticTables)
        coders = [name if isinstance(name, int) else packed.step(name) for name, _ in groups]
        self._compiled.encode_groups(coders, [length for _, length in groups], kinds, values)

    def emit_logits(self, logits: F32 | None, weights: Callable[[], F64], values: Ints) -> None:
        if logits is None:
            self.emit_rows(weights(), values)
        else:
            self._compiled.encode_logits(values, logits)
