"""Compiled reading and writing of channels (SPEC §7.5, §10.3): a call reads or writes all steps of a layer."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from scarfmt.arrays import I32, I64, U16, Ints
from scarfmt.entropy.keys import CONTEXTS
from scarfmt.errors import InvalidInput
from scarfmt.kernel import structs
from scarfmt.kernel.cells import words_of_rows
from scarfmt.kernel.memory import address, check_symbols
from scarfmt.kernel.packed_predictors import PackedPredictorSteps, Surroundings
from scarfmt.kernel.packed_tables import PackedSteps
from scarfmt.kernel.scratch import SCRATCH
from scarfmt.kernel.stream_decoder import ALL_READ, KernelRansDecoder
from scarfmt.scene.model import NO_SOURCE, Channel, ContextRule

BAD_TRIT = -2
VALUE_RANGE = -3
MOST_PASSES = 4
"""As the library has it: where passes end is told for so many."""
# Anchors whose inputs lie side by side.
_BLOCK = 16


@lru_cache(maxsize=256)
def packed_rules(rules: tuple[ContextRule, ...], columns: tuple[int, ...]) -> tuple[Any, frozenset[int]]:
    """The rules of a channel, and the channels they look at; `columns`: components of each channel."""
    packed = (structs.Rule * len(rules))()
    sources = frozenset(rule.source_channel for rule in rules) - {NO_SOURCE}
    for out, rule in zip(packed, rules, strict=True):
        out.by_class, out.low, out.shift, out.source = rule.by_class, rule.low, rule.shift, -1
        if rule.source_channel != NO_SOURCE:
            out.source, out.component = rule.source_channel, rule.source_component
            out.columns = columns[rule.source_channel]
    return packed, sources


class KernelChannel:
    """One channel in one tile-layer.

    Args:
        library: the compiled library.
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
        rules, looked_at = packed_rules(channel.rules, tuple(array.shape[1] for array in first))
        sources = (ctypes.c_void_p * len(first))()
        for number in looked_at:
            sources[number] = address(first[number], np.int32)
        kinds = np.ascontiguousarray(classes, np.int64)
        self._kept: list[Any] = [kinds, values, *first, steps, rules, sources]
        check_symbols(len(classes) * channel.components)
        self._struct = structs.Channel(
            len(classes),
            channel.components,
            kinds.ctypes.data,
            address(values, np.int32),
            address(first[-1], np.int32),
            address(steps, np.int64),
            ctypes.addressof(rules),
            ctypes.addressof(sources),
        )

    def read(
        self,
        rans: KernelRansDecoder,
        coded: range,
        moves: tuple[I64, I64],
        tables: PackedSteps,
        around: Surroundings | None,
        predictors: PackedPredictorSteps | None,
    ) -> tuple[int, int, list[int]]:
        """Read the steps `coded` from a sub-stream, each of the anchors that receive it.

        Args:
            coded: the steps that some anchor may receive.
            moves: (n,) int64 steps before and after the layer.
            tables, predictors: of these steps.
            around: what the predictors look at, if there are any.

        Returns:
            ALL_READ, BAD_TRIT, VALUE_RANGE, or a kind that has no table; the step in which that is so, or the one
            after all; and how many anchors received each step.
        """
        symbols = self._count * self._channel.components
        self._struct.symbols, self._struct.order = SCRATCH.at("symbols", 4 * symbols), SCRATCH.at("order", 4 * symbols)
        self._struct.counts = SCRATCH.at("counts", 8 * (self._channel.components * CONTEXTS + 1))
        layer, received = self._layer(coded, moves, around, predictors)
        layer.tables = ctypes.addressof(tables.array)
        found = self._library.scar_channel_layer(rans.pointer, ctypes.byref(self._struct), ctypes.byref(layer))
        return int(found), int(self._struct.step), list(received)

    def write(
        self,
        coded: range,
        moves: tuple[I64, I64],
        final: tuple[Ints, I64],
        around: Surroundings | None = None,
        predictors: PackedPredictorSteps | None = None,
    ) -> tuple[list[tuple[int, int]], U16, I32]:
        """The steps `coded` of the anchors that receive each, as the groups in which they travel.

        Args:
            moves, around, predictors: as of :meth:`read`.
            final: (n, components) 32-bit values after all steps, and (n,) how many those are.

        Returns:
            Step of each group and how many symbols it has; the kinds of all, and the symbols.

        Raises:
            InvalidInput: ``input-symbol``: a value leaves 32 bits.
        """
        components, (before, after) = self._channel.components, moves
        total = int((after - before).sum()) * components
        kinds, symbols = np.empty(total, np.uint16), np.empty(total, np.int32)
        ends = np.zeros((len(coded), MOST_PASSES), np.int64)
        layer, received = self._layer(coded, moves, around, predictors)
        values, at = np.ascontiguousarray(final[0], np.int32), np.ascontiguousarray(final[1], np.int64)
        layer.last, layer.at, layer.ends = values.ctypes.data, at.ctypes.data, ends.ctypes.data
        layer.given = SCRATCH.at("given", 4 * self._count * components)
        self._struct.kinds_out, self._struct.symbols_out = kinds.ctypes.data, symbols.ctypes.data
        if self._library.scar_channel_layer(None, ctypes.byref(self._struct), ctypes.byref(layer)) != ALL_READ:
            raise InvalidInput("input-symbol", "a value leaves 32 bits", field=self._channel.stream.name)
        groups = []
        for step, here, passes in zip(coded, received, ends.tolist(), strict=True):
            # The components of a first step travel one after the other, those of a later one together.
            times, wide = (components, 1) if step == 1 else (1, components)
            sizes = [past - start for start, past in itertools.pairwise([0, *passes]) if past > start] if here else []
            groups += [(step, size * wide) for size in sizes for _ in range(times)]
        return groups, kinds, symbols

    def _layer(
        self,
        coded: range,
        moves: tuple[I64, I64],
        around: Surroundings | None,
        predictors: PackedPredictorSteps | None,
    ) -> tuple[structs.ChannelLayer, Any]:
        """The content of the layer, and the array that will hold how many anchors receive each step."""
        self._look_around(around, predictors is not None and coded.start == 1 and predictors.first)
        received = (ctypes.c_int64 * len(coded))()
        none = (ctypes.c_void_p * len(coded))()
        before, after = (np.ascontiguousarray(steps, np.int64) for steps in moves)
        layer = structs.ChannelLayer(coded.start, coded.stop, before.ctypes.data, after.ctypes.data)
        layer.predictors = ctypes.addressof(none if predictors is None else predictors.array)
        layer.chosen, layer.anchors = SCRATCH.at("chosen", 8 * self._count), SCRATCH.at("anchors", 8 * self._count)
        layer.read = ctypes.addressof(received)
        if around is not None:
            layer.by_code, layer.passes_log2 = address(around.by_code, np.int64), around.passes_log2
        self._kept += [before, after, none]
        return layer, received

    def _look_around(self, around: Surroundings | None, whole: bool) -> None:
        """Lend the library what predictors look at, and memory: for the inputs of a `whole` pass, or one block."""
        struct, components = self._struct, self._channel.components
        struct.kind = SCRATCH.at("kind", 2 * self._count * components)
        if around is None:
            return
        settled, depths = around.settled, around.cells.depths
        if settled.dtype != np.int32 or (settled.size and settled.strides[1] != 4) or len(settled) != self._count:
            raise TypeError(f"{settled.dtype} of strides {settled.strides} for settled values")
        struct.settled, struct.settled_columns = settled.ctypes.data, settled.shape[1]
        struct.settled_stride = settled.strides[0] // 4
        struct.cells = around.cells.scratch(components)
        pairs = (settled.shape[1] + 1) // 2
        words = 1 + pairs + (components + 1) // 2 + depths * ((components + 2) // 2) + components * ((depths + 1) // 2)
        blocks = -(-self._count // _BLOCK) if whole else 1
        struct.inputs = SCRATCH.at("inputs", 4 * _BLOCK * words * blocks)
        struct.rows = SCRATCH.at("rows", 4 * self._count * words_of_rows(1 + pairs + components))
        struct.rows_step = 0
