"""Compiled reading of the indices of a tile-layer by the index network (SPEC §10.5)."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np

from scarfmt.arrays import I16, I32, I64
from scarfmt.codecs import neural_indices
from scarfmt.codecs.neural_indices import IndexCoder, count_pass, grid_features, read_first
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.errors import InvalidInput
from scarfmt.kernel.cells import CellNames, cell_names
from scarfmt.kernel.memory import address, shaped
from scarfmt.kernel.packed_network import PackedNetwork, packed_members
from scarfmt.kernel.stream_decoder import KernelRansDecoder
from scarfmt.kernel.structs import Indices
from scarfmt.kernel.symbols import KernelSymbolReader
from scarfmt.neural.layer_context import LayerContext

BAD_INDEX = -2


@dataclass(frozen=True)
class Known:
    """The known values of the n anchors of a tile-layer.

    Attributes:
        classes: (n,) int64.
        settled: (n, A) int32 fine values of the attribute channels.
        features: (n, grid) int16 of the hash grid.
        by_code: (n,) int64 anchors by (code, index).
        cells: of the anchors.
        passes_log2: of the scene.
    """

    classes: I64
    settled: I32
    features: I16
    by_code: I64
    cells: CellNames
    passes_log2: int


def read_indices(
    rans: KernelRansDecoder,
    packed: PackedNetwork,
    known: Known,
    indices: I16,
    before: I64,
    after: I64,
) -> int:
    """Read stages before+1..after into `indices`, (n, stages) int16, in place; returns how many symbols.

    Raises:
        InvalidInput: ``input-stage`` for more stages than there are columns, or indices known that are none.
    """
    count, inputs = len(indices), packed.network.inputs
    stages = int(after.max(initial=0))
    if stages > indices.shape[1] or not packed.codes(stages):
        raise InvalidInput("input-stage", f"{stages} stages do not fit the array", field="stage")
    struct = Indices(
        count,
        indices.shape[1],
        shaped(known.classes, np.int64, (count,)),
        shaped(known.settled, np.int32, (count, inputs.attributes)),
        shaped(known.features, np.int16, (count, inputs.grid)),
        address(indices, np.int16),
        shaped(before, np.int64, (count,)),
        shaped(after, np.int64, (count,)),
        shaped(known.by_code, np.int64, (count,)),
        known.passes_log2,
    )
    struct.cells = known.cells.scratch(inputs.attributes + inputs.latents)
    packed.lend(struct, count, stages)
    if rans.functions.scar_indices(rans.pointer, ctypes.byref(packed.struct), ctypes.byref(struct)) == BAD_INDEX:
        raise InvalidInput("input-stage", "an index known is not that of a codeword", field="stage")
    return int(struct.modelled)


def get_indices(
    reader: KernelSymbolReader,
    packed: PackedNetwork,
    coder: IndexCoder,
    context: LayerContext,
    indices: I16,
    stages: tuple[I64, I64],
) -> None:
    """The version of :func:`scarfmt.codecs.neural_indices.get_neural_indices` that calls the library once.

    Args:
        packed: the coder's network, with a head for every stage.
        stages: (n,) before and after this layer.
    """
    before, after = stages
    features = grid_features(coder, context, before < after)
    settled = np.ascontiguousarray(context.settled())
    cells, log2 = context.kept(cell_names, reader.rans.functions), context.model.context.passes_log2
    known = Known(context.classes, settled, features, context.by_code, cells, log2)
    reader.modelled += read_indices(reader.rans, packed, known, indices, before, after)
    if context.counters is not None:
        for part in context.parts(np.flatnonzero(before < after)):
            count_pass(coder, context, part, indices, (before[part], after[part]))


def read_symbols(reader: SymbolReader, coder: IndexCoder, stage: int, mixed: Any, count: int) -> I64:
    """The version of :func:`scarfmt.codecs.neural_indices.read_symbols` that reads all members in one call of the
    library.

    Left to that function where something else than NumPy's float32 holds (count, Y) `mixed`.
    """
    if not isinstance(mixed, np.ndarray) or mixed.dtype != np.float32:
        return neural_indices.read_symbols(reader, coder, stage, mixed, count)
    book, evaluator = int(stage > 1), coder.evaluator
    head, first = coder.network.heads[book], read_first(reader, coder, stage, mixed, count)
    if not head.two_level:
        return first
    assert isinstance(reader, KernelSymbolReader)
    members = evaluator.kept(packed_members, book)
    return head.starts[first] + reader.read_members(members, first, evaluator.member_outputs(book, mixed))
