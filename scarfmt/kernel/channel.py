"""Compiled reading and writing of channel steps: all passes of a step in one call (SPEC §7.5, §10.3)."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.errors import InvalidInput
from scarfmt.kernel.cells import KernelCellSums
from scarfmt.kernel.interface import Cells, Predictor, Rule, Step, address, check_symbols
from scarfmt.kernel.rans import ALL_READ, KernelRansDecoder, PackedTables
from scarfmt.model import NO_SOURCE, Channel
from scarfmt.neural import predictors as definition

I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
U16 = NDArray[np.uint16]

BAD_TRIT = -2
VALUE_RANGE = -3
# Anchors whose inputs lie side by side, and rows of weights that are multiplied at once.
_BLOCK, _ROWS = 16, 4


class PackedPredictors:
    """The predictors of one step of one channel, as the library reads them.

    Args:
        predictors: by component.
        components: of the channel.
    """

    def __init__(self, predictors: Mapping[int, definition.Predictor], components: int) -> None:
        self._arrays: list[NDArray[np.float32]] = []
        self.array = (Predictor * components)()
        for component, predictor in predictors.items():
            self._fill(self.array[component], predictor)
        self.inputs = next(iter(predictors.values())).inputs

    def _fill(self, out: Predictor, predictor: definition.Predictor) -> None:
        units, inputs = predictor.units, predictor.inputs
        weights = np.zeros((-(-(units + 2) // _ROWS) * _ROWS, inputs), np.float32)
        biases = np.zeros(units, np.float32)
        if predictor.hidden is not None:
            hidden, biases = predictor.hidden.folded
            weights[:units] = hidden.T
        last, last_biases = predictor.output.folded
        weights[units : units + 2] = last[:inputs].T
        out.units, out.rows = units, len(weights)
        out.weights, out.biases, out.output = map(self._kept, (weights, biases, last[inputs:].T))
        out.output_biases[:] = last_biases.tolist()
        out.last[:] = [bucket - 1 for bucket in predictor.buckets]

    def _kept(self, array: NDArray[np.float32]) -> int:
        self._arrays.append(np.ascontiguousarray(array))
        return self._arrays[-1].ctypes.data


@dataclass
class Surroundings:
    """What predictors look at.

    Attributes:
        settled: (n, a) int64 fine values of the attribute channels before.
        cells: with no anchors yet.
        predictors: of the step.
    """

    settled: I64
    cells: KernelCellSums
    predictors: PackedPredictors


class KernelChannel:
    """One channel in one tile-layer.

    Args:
        library: from :func:`scarfmt.kernel.functions`.
        channel: its model.
        classes: (n,) int64.
        values: (n, components) int32, changed in place.
        first: first-step values of the channels up to and including this one; the last is changed.
        steps: (n,) int64 steps that `values` are at, changed in place.
    """

    def __init__(
        self,
        library: ctypes.CDLL,
        channel: Channel,
        classes: I64,
        values: I32,
        first: Sequence[I32],
        steps: I64,
    ) -> None:
        self._library, self._channel, self._count = library, channel, len(classes)
        self._rules = (Rule * channel.components)()
        for out, rule in zip(self._rules, channel.rules, strict=True):
            out.by_class, out.low, out.shift = rule.by_class, rule.low, rule.shift
            if rule.source_channel != NO_SOURCE:
                source = first[rule.source_channel]
                out.source_columns = source.shape[1]
                out.source = address(source, np.int32) + source.itemsize * rule.source_component
        kinds = np.ascontiguousarray(classes, np.int64)
        self._kept: list[NDArray[Any]] = [kinds, values, *first, steps]
        self._struct = Step(components=channel.components, rules=self._rules)
        self._struct.classes, self._struct.values = kinds.ctypes.data, address(values, np.int32)
        self._struct.first, self._struct.steps = address(first[-1], np.int32), address(steps, np.int64)

    def read(
        self,
        rans: KernelRansDecoder,
        step: int,
        parts: Sequence[I64],
        tables: PackedTables,
        around: Surroundings | None,
    ) -> int:
        """Read a step of the anchors of each part, one after the other, from a sub-stream.

        Returns:
            ALL_READ, BAD_TRIT, VALUE_RANGE, or a kind that has no table.
        """
        symbols = self._together(step, parts)
        check_symbols(symbols)
        scratch: list[NDArray[Any]] = [*np.empty((2, symbols), np.int32), np.empty(tables.kinds + 1, np.int64)]
        struct = self._struct
        struct.tables, struct.given = tables.pointer, None
        struct.symbols, struct.order, struct.counts = (array.ctypes.data for array in scratch)
        return self._coded(rans.pointer, step, parts, around)

    def write(
        self, step: int, parts: Sequence[I64], given: I32, around: Surroundings | None
    ) -> list[tuple[U16, I32]]:
        """Kinds and symbols of a step of the anchors of each part, in the groups in which they travel.

        Args:
            given: (n, components) int32 values after the step; those of other anchors do not matter.
        """
        components = self._channel.components
        total = sum(map(len, parts)) * components
        kinds, symbols = np.empty(total, np.uint16), np.empty(total, np.int32)
        struct = self._struct
        struct.given, struct.kinds_out = address(given, np.int32), kinds.ctypes.data
        struct.symbols_out = symbols.ctypes.data
        if self._coded(None, step, parts, around) != ALL_READ:
            raise InvalidInput("input-symbol", "a step of more than one trit", field=self._channel.stream.name)
        # The components of a first step travel one after the other, those of a later one together.
        groups = components if step == 1 else 1
        sizes = [len(part) * components // groups for part in parts for _ in range(groups)]
        ends = np.cumsum(sizes)[:-1]
        return list(zip(np.split(kinds, ends), np.split(symbols, ends), strict=True))

    def _together(self, step: int, parts: Sequence[I64]) -> int:
        """Most symbols of one group."""
        return max(map(len, parts)) * (1 if step == 1 else self._channel.components)

    def _coded(self, rans: Any, step: int, parts: Sequence[I64], around: Surroundings | None) -> int:
        struct, components = self._struct, self._channel.components
        anchors, ends = np.concatenate(parts), np.cumsum([len(part) for part in parts])
        kind = np.empty(self._together(step, parts), np.uint16)
        struct.step, struct.passes, struct.predicted = step, len(parts), around is not None
        struct.anchors, struct.ends, struct.kind = anchors.ctypes.data, ends.ctypes.data, kind.ctypes.data
        struct.predictors, struct.cells = self._no_predictors, Cells()
        inputs = np.empty(0, np.float32)
        if around is not None:
            struct.predictors, struct.cells = around.predictors.array, around.cells.struct
            struct.settled_columns, struct.settled = around.settled.shape[1], address(around.settled, np.int64)
            depths = around.cells.struct.depths
            struct.shared = around.predictors.inputs - depths
            width = struct.shared + components * depths
            inputs = np.empty(-(-max(map(len, parts)) // _BLOCK) * _BLOCK * width, np.float32)
        struct.inputs = inputs.ctypes.data
        return int(self._library.scar_channel_step(rans, ctypes.byref(struct), self._count))

    @property
    def _no_predictors(self) -> Any:
        return (Predictor * self._channel.components)()

