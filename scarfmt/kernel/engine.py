"""The engine that runs compiled inner loops, and leaves what it lacks to the definition."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from scarfmt.arrays import F32, F64, I16, I32, I64, U64, Ints
from scarfmt.codecs import neural_indices
from scarfmt.codecs.channels import width_table
from scarfmt.codecs.neural_indices import IndexCoder
from scarfmt.coding.engine import NumpyEngine, WholeTiles
from scarfmt.entropy.emitters import Emitter, SymbolWriter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import SymbolSource
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.entropy.symbol_tables import StaticTables, SymbolTable
from scarfmt.kernel import channel_codec, index_layer, position_tree
from scarfmt.kernel.activation import KernelActivation, world_positions
from scarfmt.kernel.cells import KernelCellSums, kernel_fine
from scarfmt.kernel.index_inputs import embedding_inputs, grid_features
from scarfmt.kernel.packed_network import packed_network
from scarfmt.kernel.packed_tables import PackedStaticTables
from scarfmt.kernel.stream_decoder import KernelRansDecoder
from scarfmt.kernel.symbols import KernelSymbolReader, KernelSymbolWriter
from scarfmt.kernel.tiles import KernelTiles, can_read
from scarfmt.kernel.values import kernel_values
from scarfmt.neural.context import CellMeans, Sums
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.layer_context import LayerContext
from scarfmt.neural.operations import NUMPY, Operations
from scarfmt.neural.predicted import PredictedChannel
from scarfmt.scene.model import Channel, Lattice

if TYPE_CHECKING:
    from scarfmt.coding.models import SceneModels
    from scarfmt.coding.tile import NeuralModels
    from scarfmt.container.directory import TileFrame


class KernelEngine(NumpyEngine):
    """Codecs and networks by the compiled library.

    Left to :class:`NumpyEngine`: a reader that somebody observes, an index network with attention, and its arithmetic
    where something else than NumPy does it, stand-ins for predictors.

    Args:
        library: the compiled library (:func:`scarfmt.kernel.loading.load`).
        operations: array arithmetic of the index network, where the library does not do it.
    """

    name = "kernel"

    def __init__(self, library: ctypes.CDLL, operations: Operations = NUMPY) -> None:
        super().__init__(operations)
        self._library = library

    def rans_decoder(self, data: bytes) -> SymbolSource:
        return KernelRansDecoder(self._library, data)

    def symbol_reader(self, data: bytes, tables: Mapping[TableKey, SymbolTable]) -> SymbolReader:
        return KernelSymbolReader(self._library, data, tables)

    def symbol_writer(self, tables: Mapping[TableKey, SymbolTable]) -> SymbolWriter:
        return KernelSymbolWriter(self._library, tables)

    def tables_read(self, tables: StaticTables) -> set[TableKey]:
        return tables.kept(PackedStaticTables).used

    def put_positions(self, emitter: Emitter, codes: U64, bits: int) -> None:
        position_tree.put_positions(self._library, emitter, codes, bits)

    def get_positions(self, reader: SymbolReader, total: int, bits: int) -> U64:
        if total and isinstance(reader, KernelSymbolReader):
            return position_tree.get_positions(reader, total, bits)
        return super().get_positions(reader, total, bits)

    def whole_tiles(self, models: SceneModels, neural: Sequence[NeuralModels]) -> WholeTiles | None:
        return KernelTiles(self._library, models, neural) if can_read(models, neural) else None

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
        if predicted is None or predicted.predictors.genuine:
            channel_codec.put_channel(self._library, emitter, channel, classes, steps, final, first, predicted)
        else:
            super().put_channel(emitter, channel, classes, steps, final, first, predicted)

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
        if isinstance(reader, KernelSymbolReader) and (predicted is None or predicted.predictors.genuine):
            channel_codec.get_channel(reader, channel, classes, steps, values, first, predicted)
        else:
            super().get_channel(reader, channel, classes, steps, values, first, predicted)

    def put_neural_indices(
        self, emitter: Emitter, coder: IndexCoder, context: LayerContext, indices: Ints, stages: tuple[I64, I64]
    ) -> None:
        neural_indices.put_neural_indices(emitter, coder, context, indices, *stages, columns=embedding_inputs)

    def get_neural_indices(
        self, reader: SymbolReader, coder: IndexCoder, context: LayerContext, indices: I16, stages: tuple[I64, I64]
    ) -> None:
        symbols = neural_indices.read_symbols
        if isinstance(reader, KernelSymbolReader):
            packed = coder.evaluator.kept(packed_network)
            if packed is not None and packed.codes(int(stages[1].max(initial=0))):
                index_layer.get_indices(reader, packed, coder, context, indices, stages)
                return
            symbols = index_layer.read_symbols
        neural_indices.get_neural_indices(
            reader, coder, context, indices, *stages, columns=embedding_inputs, symbols=symbols
        )

    def channel_values(self, values: Ints, widths: Sequence[float], steps: I64) -> F32:
        if values.dtype != np.int32:
            return super().channel_values(values, widths, steps)
        return kernel_values(self._library, values.astype(np.int32, copy=False), steps, width_table(tuple(widths)))

    def world_positions(
        self, lattice: Lattice, frame: TileFrame, codes: U64, residuals: tuple[Channel, I32, I64] | None
    ) -> F64 | None:
        out = np.empty((len(codes), 3))
        world_positions(self._library, lattice, frame, codes, residuals, out)
        return out

    def activation(self, models: SceneModels) -> KernelActivation:
        return models.kept(KernelActivation, self._library)

    def put_fine(self, values: Ints, steps: Ints, out: I32) -> None:
        each = steps if len(steps) == len(values) else np.broadcast_to(steps, len(values))
        kernel_fine(self._library, values, each, out)

    def cell_sums(self, cells: CellMeans, columns: int) -> Sums:
        return KernelCellSums(self._library, cells.compact, cells.sizes, columns)

    def grid_features(self, grid: HashGrid, positions: Ints) -> I16:
        return grid_features(self._library, grid, positions)
