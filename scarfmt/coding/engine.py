"""Engines, which compute the symbols and values of a file: their protocol, and the engine that is the definition.

A reader or writer is given an engine once and asks it for all that can be done in more ways than one. All engines give
equal integers and bytes; they differ in speed. :class:`NumpyEngine` runs the codecs and networks of this package as
they stand. Others take over what they can do faster and leave it the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from scarfmt.arrays import F32, F64, I16, I32, I64, U64, Ints
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
from scarfmt.scene.model import Channel, Lattice

if TYPE_CHECKING:
    from scarfmt.coding.models import SceneModels
    from scarfmt.coding.tile import NeuralModels, TileContent
    from scarfmt.container.directory import TileFrame
    from scarfmt.container.schema import Stream
    from scarfmt.counters import Counters
    from scarfmt.scene.gaussians import GaussianScene


class WholeTiles(Protocol):
    """Reads all layers of a tile at once. Threads may share one."""

    def read(
        self, frame: TileFrame, blocks: Sequence[tuple[int, bytes | None]], counters: Counters | None, *, brief: bool
    ) -> TileContent | None:
        """The content of a tile after the last layer; None where it must be read layer by layer to say what is wrong.

        Args:
            frame: of the tile.
            blocks: per layer, the anchors that appear and the block, if there is one, its checksum right.
            counters: of symbols and multiply-adds.
            brief: whether the content is looked at only until the thread's next tile, and first-step values only where
                a rule looks at them.
        """


class Activation(Protocol):
    """Makes Gaussians of exact values (SPEC §9.3-9.5). Threads may share one."""

    def fill(self, out: GaussianScene, values: Mapping[Stream, F32], indices: I16, stages: I64) -> None:
        """Fill in rotations, logits and spherical harmonics of `out`, float32, from the values of its n anchors.

        Args:
            values: exact channel values, (n, components) float32; those that are not there count as 0.
            indices: (n, M) int16 codeword numbers.
            stages: (n,) int64 stages received.
        """

    def put_tile(self, out: GaussianScene, lattice: Lattice, frame: TileFrame, content: TileContent) -> None:
        """Fill in all of `out`, float32 but for positions, from the integers of a tile."""


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

    def put_positions(self, emitter: Emitter, codes: U64, bits: int) -> None:
        """Emit Morton codes: :func:`scarfmt.codecs.positions.put_positions` (SPEC §7.2)."""

    def get_positions(self, reader: SymbolReader, total: int, bits: int) -> U64:
        """Read Morton codes: :func:`scarfmt.codecs.positions.get_positions` (SPEC §7.2)."""

    def whole_tiles(self, models: SceneModels, neural: Sequence[NeuralModels]) -> WholeTiles | None:
        """The function that reads all layers of a tile at once; None if layers are read one after the other."""

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

    def world_positions(
        self, lattice: Lattice, frame: TileFrame, codes: U64, residuals: tuple[Channel, I32, I64] | None
    ) -> F64 | None:
        """(n, 3) float64 positions of a tile's anchors (SPEC §9.1); None where the decoder computes them itself.

        Args:
            codes: (n,) uint64 local Morton codes.
            residuals: their channel, its values, checked to be within reach, and the (n,) steps these are at.
        """

    def activation(self, models: SceneModels) -> Activation | None:
        """The function that turns exact values of explicit anchors into Gaussians; None if the decoder does so
        itself."""


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

    def put_positions(self, emitter: Emitter, codes: U64, bits: int) -> None:
        positions.put_positions(emitter, codes, bits)

    def get_positions(self, reader: SymbolReader, total: int, bits: int) -> U64:
        return positions.get_positions(reader, total, bits)

    def whole_tiles(self, models: SceneModels, neural: Sequence[NeuralModels]) -> WholeTiles | None:
        return None

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

    def world_positions(
        self, lattice: Lattice, frame: TileFrame, codes: U64, residuals: tuple[Channel, I32, I64] | None
    ) -> F64 | None:
        return None

    def activation(self, models: SceneModels) -> Activation | None:
        return None


NUMPY_ENGINE = NumpyEngine()
