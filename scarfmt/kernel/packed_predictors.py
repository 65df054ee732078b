"""Predictors as the compiled library reads them, and what they look at (SPEC §10.3)."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import I32, I64, Ints
from scarfmt.container.schema import Stream
from scarfmt.kernel import structs
from scarfmt.kernel.cells import CellNames
from scarfmt.kernel.words import PackedLayers, paired
from scarfmt.neural.arithmetic import half_step
from scarfmt.neural.predicted import PredictorSet
from scarfmt.neural.predictors import CLASS_INPUT, Predictor
from scarfmt.scene.model import MAX_CLASSES

CLASS_STARTS = 16
"""Sums start at one of so many numbers, by class."""


class PackedPredictors:
    """The predictors of one step of one channel, as the library reads them.

    Args:
        predictors: by component.
        components: of the channel.
        depths: of the decoded context.
    """

    def __init__(self, predictors: Mapping[int, Predictor], components: int, depths: int) -> None:
        self._kept = PackedLayers()
        self._components, self._depths = components, depths
        self.array = (structs.Predictor * components)()
        for component, predictor in predictors.items():
            self._fill(self.array[component], predictor)

    def _fill(self, out: structs.Predictor, predictor: Predictor) -> None:
        units, inputs = predictor.units, predictor.inputs
        output, hidden = predictor.output, predictor.hidden
        weights = np.zeros((2 + units + units % 2, inputs), np.int64)
        biases = np.zeros(len(weights), np.int64)
        weights[:2], biases[:2] = output.weights[:, :inputs], output.biases + half_step(output.shift)
        if hidden is not None:
            weights[2 : 2 + units], biases[2 : 2 + units] = hidden.weights, hidden.biases + half_step(hidden.shift)
            out.shift = hidden.shift
        starts = np.repeat(biases[:, None], CLASS_STARTS, axis=1)
        starts[:, :MAX_CLASSES] += CLASS_INPUT * weights[:, :MAX_CLASSES]
        shared, own = self._words(weights)
        out.rows, out.shared, out.own, out.output_shift = len(weights), shared.shape[1], own.shape[1], output.shift
        out.starts, out.weights = self._kept.words(starts), self._kept.words(np.concatenate([shared, own], axis=1))
        out.output = self._kept.words(paired(output.weights[:, inputs:]))
        out.last[:] = [bucket - 1 for bucket in predictor.buckets]

    def _words(self, weights: Ints) -> tuple[I32, I32]:
        """Weights of the words that the components share, and of those of one, in the order of their inputs.

        Args:
            weights: (rows, inputs) by SPEC §10.3.
        """
        components, depths = self._components, self._depths
        own = weights.shape[1] - depths
        counts = own - depths
        means = [counts - (depths - depth) * components for depth in range(depths)]
        known = (means[0] if depths else counts) - components
        parts = [weights[:, MAX_CLASSES:known], weights[:, known : known + components]]
        for depth, start in enumerate(means):
            columns = weights[:, start : start + components], weights[:, counts + depth, None]
            parts.append(np.concatenate(columns, axis=1))
        return np.concatenate([paired(part) for part in parts], axis=1), paired(weights[:, own:])


class PackedPredictorSteps:
    """The predictors of consecutive steps of a channel.

    Args:
        steps: of each step, None where static contexts apply.

    Attributes:
        first: whether the first of these steps has any.
    """

    def __init__(self, steps: Sequence[PackedPredictors | None]) -> None:
        self._kept, self.first = steps, steps[0] is not None
        addresses = (None if step is None else ctypes.addressof(step.array) for step in steps)
        self.array = (ctypes.c_void_p * len(steps))(*addresses)


@dataclass(frozen=True)
class Surroundings:
    """The values that predictors read.

    Attributes:
        settled: (n, a) int32 fine values of the attribute channels before; leading columns of a wider array.
        cells: of the anchors.
        by_code: (n,) int64 anchors by (code, index).
        passes_log2: of the scene.
    """

    settled: I32
    cells: CellNames
    by_code: I64
    passes_log2: int


class PackedPredictorSet:
    """The predictors in force in a layer, packed step by step when they are first asked for.

    Threads may share them: what one has packed stays, as others have its address. To be kept with
    the set: :meth:`scarfmt.kept.Keeper.kept`.
    """

    def __init__(self, predictors: PredictorSet) -> None:
        self._set = predictors
        self._packed: dict[tuple[int, int], PackedPredictors] = {}
        self._steps: dict[tuple[int, range], PackedPredictorSteps] = {}

    def step(self, stream: Stream, step: int, components: int, depths: int) -> PackedPredictors | None:
        """The predictors of a step; None where static contexts apply.

        Args:
            depths: of the decoded context.
        """
        found = {c: p for c, p in self._set.step(stream, step).items() if isinstance(p, Predictor)}
        if found and (stream, step) not in self._packed:
            self._packed.setdefault((stream, step), PackedPredictors(found, components, depths))
        return self._packed.get((stream, step))

    def steps(self, stream: Stream, steps: range, components: int, depths: int) -> PackedPredictorSteps:
        """Packed predictors of some steps."""
        if (stream, steps) not in self._steps:
            packed = [self.step(stream, step, components, depths) for step in steps]
            self._steps.setdefault((stream, steps), PackedPredictorSteps(packed))
        return self._steps[stream, steps]
