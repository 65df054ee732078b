"""What computes a file's symbols and values: the protocol of engines, and the one that is the definition.

A reader or writer is given an engine once and asks it for all that can be done in more ways than one. All engines give
equal integers and bytes; they differ in speed. :class:`NumpyEngine` runs the codecs and networks of this package as
they stand. Others take over what they can do faster and leave it the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from scarfmt.arrays import F32, I16, I32, I64, U64, Ints
from scarfmt.codecs import channels, neural_indices, positions
from scarfmt.codecs.neural_indices import IndexCoder
from scarfmt.entropy.emitters import Emitter, SymbolWriter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import RansDecoder, SymbolSource
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.entropy.symbol_tables import StaticTables, SymbolTable
from scarfmt.neural.context_operations import ContextOperations, NumpyContext
from scarfmt.neural.layer_context import LayerContext
from scarfmt.neural.operations import NUMPY, Operations
from scarfmt.neural.predicted import PredictedChannel
from scarfmt.scene.model import Channel


class Engine(ContextOperations, Protocol):
    """One way to compute what a file's symbols and values are. Threads may share one."""

    @property
    def name(self) -> str:
        """Names it in reports: "numpy", "kernel"."""

    @property
    def operations(self) -> Operations:
        """Array arithmetic of the index network."""

    def rans_decoder(self, data: bytes) -> SymbolSource:
        """A decoder of a stream's symbols, group by group (SPEC §8.2).

        Raises:
            Malformed: ``rans-length``, ``rans-last-word``.
        """

    def symbol_reader(self, data: bytes, tables: Mapping[TableKey, SymbolTable]) -> SymbolReader:
        """A reader of a sub-stream under static tables; refuses as :meth:`rans_decoder`."""

    def symbol_writer(self, tables: Mapping[TableKey, SymbolTable]) -> SymbolWriter:
        """A writer of a sub-stream under static tables."""

    def tables_read(self, tables: StaticTables) -> set[TableKey]:
        """Keys of tables that readers of this engine have used without looking them up one by one."""

    def get_positions(self, reader: SymbolReader, total: int, bits: int) -> U64:
        """Read Morton codes: :func:`scarfmt.codecs.positions.get_positions` (SPEC §7.2)."""

    def put_channel(
        self,
        emitter: Emitter,
        channel: Channel,
        classes: I64,
        steps: tuple[I64, I64],
        final: tuple[Ints, I64],
        first: Sequence[I32],
        predicted: PredictedChannel | None,
    ) -> None:
        """Emit steps of a channel: :func:`scarfmt.codecs.channels.put_channel` (SPEC §7.5)."""

    def get_channel(
        self,
        reader: SymbolReader,
        channel: Channel,
        classes: I64,
        steps: tuple[I64, I64],
        values: I32,
        first: Sequence[I32],
        predicted: PredictedChannel | None,
    ) -> None:
        """Read steps of a channel: :func:`scarfmt.codecs.channels.get_channel` (SPEC §7.5)."""

    def put_neural_indices(
        self, emitter: Emitter, coder: IndexCoder, context: LayerContext, indices: Ints, stages: tuple[I64, I64]
    ) -> None:
        """Emit indices: :func:`scarfmt.codecs.neural_indices.put_neural_indices` (SPEC §10.5)."""

    def get_neural_indices(
        self, reader: SymbolReader, coder: IndexCoder, context: LayerContext, indices: I16, stages: tuple[I64, I64]
    ) -> None:
        """Read indices: :func:`scarfmt.codecs.neural_indices.get_neural_indices` (SPEC §10.5)."""

    def channel_values(self, values: Ints, widths: Sequence[float], steps: I64) -> F32:
        """Values of a channel: :func:`scarfmt.codecs.channels.channel_values` (SPEC §9.2)."""


class NumpyEngine(NumpyContext):
    """The definition: codecs and networks as they stand, on NumPy and constriction.

    Args:
        operations: array arithmetic of the index network; whichever it is, the result is the same.
    """

    name = "numpy"

    def __init__(self, operations: Operations = NUMPY) -> None:
        self.operations = operations

    def rans_decoder(self, data: bytes) -> SymbolSource:
        return RansDecoder(data)

    def symbol_reader(self, data: bytes, tables: Mapping[TableKey, SymbolTable]) -> SymbolReader:
        return SymbolReader(data, tables, self.rans_decoder(data))

    def symbol_writer(self, tables: Mapping[TableKey, SymbolTable]) -> SymbolWriter:
        return SymbolWriter(tables)

    def tables_read(self, tables: StaticTables) -> set[TableKey]:
        return set()

    def get_positions(self, reader: SymbolReader, total: int, bits: int) -> U64:
        return positions.get_positions(reader, total, bits)

    def put_channel(
        self,
        emitter: Emitter,
        channel: Channel,
        classes: I64,
        steps: tuple[I64, I64],
        final: tuple[Ints, I64],
        first: Sequence[I32],
        predicted: PredictedChannel | None,
    ) -> None:
        channels.put_channel(emitter, channel, classes, *steps, final, first, predicted)

    def get_channel(
        self,
        reader: SymbolReader,
        channel: Channel,
        classes: I64,
        steps: tuple[I64, I64],
        values: I32,
        first: Sequence[I32],
        predicted: PredictedChannel | None,
    ) -> None:
        channels.get_channel(reader, channel, classes, *steps, values, first, predicted)

    def put_neural_indices(
        self, emitter: Emitter, coder: IndexCoder, context: LayerContext, indices: Ints, stages: tuple[I64, I64]
    ) -> None:
        neural_indices.put_neural_indices(emitter, coder, context, indices, *stages)

    def get_neural_indices(
        self, reader: SymbolReader, coder: IndexCoder, context: LayerContext, indices: I16, stages: tuple[I64, I64]
    ) -> None:
        neural_indices.get_neural_indices(reader, coder, context, indices, *stages)

    def channel_values(self, values: Ints, widths: Sequence[float], steps: I64) -> F32:
        return channels.channel_values(values, widths, steps)


NUMPY_ENGINE = NumpyEngine()
