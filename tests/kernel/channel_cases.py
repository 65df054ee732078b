"""Channels under any tables, rules and predictors, for the tests of their compiled reading and writing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from scarfmt.arrays import I32, I64
from scarfmt.codecs.channels import coarsen
from scarfmt.coding.engine import Engine
from scarfmt.container.directory import TileFrame
from scarfmt.container.schema import Profile, Stream
from scarfmt.counters import Counters
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.layer_context import LayerContext
from scarfmt.neural.predicted import PredictedChannel, PredictorSet
from scarfmt.neural.predictors import AMAX, Predictor, input_width
from scarfmt.scene.model import MAX_CLASSES, MAX_STEPS, Channel, ContextRule, DecodedContext, LayerRow, SceneModel
from tests.kernel.samples import EXTREME, random_stream

BITS = 6


class Case:
    """The colours of a tile-layer, with scales before them, under any tables, rules and predictors.

    Args:
        components: of the colours; more than files may have.
        depths: of the decoded context.
        share: of components with a predictor, in each step.
        spoilt: of tables that are missing or hold values that are none.
        crowd: anchors.
    """

    def __init__(
        self, seed: int, components: int, depths: int, share: float, spoilt: float, crowd: int = 60, units: int = 5
    ) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.count, self.share, self.spoilt, self.units = int(rng.integers(0, crowd)), share, spoilt, units
        rules = tuple(self._rule(component) for component in range(components))
        channels = (
            Channel(Stream.SCALE, (1.0,) * 3, (ContextRule(),) * 3),
            Channel(Stream.COLOUR, (1.0,) * components, rules),
        )
        occupancies = tuple(sorted(rng.choice([1, 2, 3, 8, 300], depths, replace=False).tolist(), reverse=True))
        context = DecodedContext(int(rng.integers(0, 4)), occupancies)
        self.model = SceneModel(Profile.EXPLICIT, 1, channels, (LayerRow((0,), ((1, 1),)),), context)
        self.codes = rng.integers(0, 1 << 3 * BITS, self.count, np.uint64) >> rng.integers(0, 19, self.count, np.uint64)
        self.classes = rng.integers(0, MAX_CLASSES, self.count)
        lowest = int(rng.choice([0, 0, 1, 7, MAX_STEPS - 3]))
        self.before = lowest + rng.integers(0, 3, self.count)
        self.after = np.minimum(self.before + rng.integers(0, 3, self.count), MAX_STEPS)
        self.steps = range(lowest + 1, min(lowest + 4, MAX_STEPS) + 1)
        self.scales = self._spread((self.count, 3), EXTREME).astype(np.int32)
        reach = int(rng.choice([3, 3000, EXTREME // 30, EXTREME]))
        self.values = (self._spread((self.count, components), reach) * (self.before > 0)[:, None]).astype(np.int32)
        self.predictors = self._predictors()
        self.tables = self._tables()
        words = int(rng.choice([0, 1, 2, 40, 4 * self.count * components]))
        self.data = random_stream(rng, words)
        self.final = self._spread((self.count, components), reach).astype(np.int32)

    def _spread(self, shape: tuple[int, ...], top: int) -> I64:
        out = np.rint(np.exp2(self.rng.uniform(0, np.log2(top), shape))).astype(np.int64)
        out[self.rng.random(shape) < 0.1] = top
        return np.minimum(out, top) * self.rng.integers(-1, 2, shape)

    def _rule(self, component: int) -> ContextRule:
        by_class = bool(self.rng.integers(2))
        sources = [(0, int(self.rng.integers(3))), *([(1, int(self.rng.integers(component)))] if component else [])]
        if self.rng.random() < 0.3:
            return ContextRule(by_class)
        channel, source = sources[int(self.rng.integers(len(sources)))]
        low = int(self.rng.choice([-7, 0, 3, -(2**32), 2**32 - 1, EXTREME, -EXTREME]))
        return ContextRule(by_class, channel, source, low, int(self.rng.choice([0, 1, 4, 28, 31])))

    def _linear(self, rows: int, columns: int) -> Linear:
        top = int(self.rng.choice([1, 20, (1 << 23) // AMAX // columns]))
        weights = self.rng.integers(-top, top + 1, (rows, columns)).astype(np.int32)
        shift = int(self.rng.integers(0, 20))
        return Linear(weights, self.rng.integers(-(1 << 22), 1 << 22, rows) >> self.rng.integers(0, 22, rows), shift)

    def _predictors(self) -> dict[tuple[int, int, int], Predictor]:
        found, inputs = {}, input_width(self.model, 1)
        for step in self.steps:
            share = self.share if self.rng.random() < 0.7 else 0
            for component in range(self.model.channels[1].components):
                if self.rng.random() < share:
                    units = int(self.rng.choice([0, 1, 2, 3, self.units]))
                    hidden = self._linear(units, inputs) if units else None
                    buckets = ((16, 16), (256, 1), (1, 256), (1, 1), (7, 5))[int(self.rng.integers(5))]
                    made = Predictor(Stream.COLOUR, component, step, hidden, self._linear(2, inputs + units), buckets)
                    made.check()
                    found[made.key] = made
        return found

    def _tables(self) -> Mapping[TableKey, SymbolTable]:
        tables = {}
        for step in self.steps:
            pool = [self._table(step) for _ in range(12)]
            for component in range(self.model.channels[1].components):
                chosen = self.rng.integers(0, len(pool), 256)
                there = self.rng.random(256) >= self.spoilt / 8
                for context in np.flatnonzero(there).tolist():
                    tables[TableKey(Stream.COLOUR, component, step, context)] = pool[chosen[context]]
        return tables

    def _table(self, step: int) -> SymbolTable:
        alphabet = np.array([-1, 0, 1])
        if step == 1:
            alphabet = np.unique(self._spread((int(self.rng.integers(1, 40)),), int(self.rng.choice([5, EXTREME]))))
        elif self.rng.random() < self.spoilt / 4:
            alphabet = np.unique([*alphabet, self.rng.choice([-2, 2, EXTREME, -EXTREME])])
        elif self.rng.random() < 0.2:
            alphabet = alphabet[:1]
        return SymbolTable(alphabet, self.rng.integers(1, 1 << 24, len(alphabet)))

    def read(self, engine: Engine) -> Any:
        """All that a layer's reading changes."""
        counters, values = Counters(), self.values.copy()
        first = [(self.scales >> 3).copy(), (self.values >> 5).copy()]
        reader, predicted = engine.symbol_reader(self.data, self.tables), self._predicted(engine, values, counters)
        given = self.before.copy(), self.after.copy()
        engine.get_channel(reader, self.model.channels[1], self.classes, given, values, first, predicted)
        assert np.array_equal(given[0], self.before)
        # What the stream has left: a few symbols more.
        return values, first, reader.static, counters, reader.read_uniform(4096, 6)

    def write(self, engine: Engine, emitter: Emitter, more: I64 | int = 0) -> None:
        """Emit the layer of anchors whose final values are those after it, or `more` steps later."""
        at = np.minimum(self.after + more, MAX_STEPS)
        final = self.final * (at > 0)[:, None].astype(np.int32)
        first = np.where(at[:, None] > 0, coarsen(final, np.maximum(at - 1, 0)[:, None]), 0).astype(np.int32)
        known = np.where(self.before[:, None] > 0, coarsen(final, (at - self.before)[:, None]), 0).astype(np.int32)
        given = self.classes, (self.before, self.after), (final, at), [self.scales >> 3, first]
        kept = [final.copy(), at.copy(), self.before.copy(), first.copy()]
        engine.put_channel(emitter, self.model.channels[1], *given, self._predicted(engine, known, None))
        assert all(map(np.array_equal, kept, [final, at, self.before, first]))

    def _predicted(self, engine: Engine, values: I32, counters: Counters | None) -> PredictedChannel | None:
        if not self.predictors:
            return None
        given = self.model, TileFrame(BITS), self.codes, self.classes
        context = LayerContext(*given, counters=counters, operations=engine)
        context.settle(0, self.scales, np.full(self.count, 3))
        return PredictedChannel(context, 1, PredictorSet(self.predictors), values, self.before)
