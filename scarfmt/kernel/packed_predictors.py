"""Predictors as the compiled library reads them, and what they look at (SPEC §10.3)."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I32, I64
from scarfmt.container.schema import Stream
from scarfmt.kernel import structs
from scarfmt.kernel.cells import CellNames
from scarfmt.neural.predicted import PredictorSet
from scarfmt.neural.predictors import Predictor

ROWS = 5
"""Rows of weights that are multiplied at once."""


class PackedPredictors:
    """The predictors of one step of one channel, as the library reads them.

    Args:
        predictors: by component.
        components: of the channel.
    """

    def __init__(self, predictors: Mapping[int, Predictor], components: int) -> None:
        self._arrays: list[NDArray[np.float32]] = []
        self.array = (structs.Predictor * components)()
        for component, predictor in predictors.items():
            self._fill(self.array[component], predictor)

    def _fill(self, out: structs.Predictor, predictor: Predictor) -> None:
        units, inputs = predictor.units, predictor.inputs
        weights = np.zeros((-(-(units + 2) // ROWS) * ROWS, inputs), np.float32)
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
    """What predictors look at.

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

    To be kept with the set: :meth:`scarfmt.kept.Keeper.kept`.
    """

    def __init__(self, predictors: PredictorSet) -> None:
        self._set = predictors
        self._packed: dict[tuple[int, int], PackedPredictors] = {}
        self._steps: dict[tuple[int, range], PackedPredictorSteps] = {}

    def step(self, stream: Stream, step: int, components: int) -> PackedPredictors | None:
        """The predictors of a step; None where static contexts apply."""
        found = {c: p for c, p in self._set.step(stream, step).items() if isinstance(p, Predictor)}
        if found and (stream, step) not in self._packed:
            self._packed[stream, step] = PackedPredictors(found, components)
        return self._packed.get((stream, step))

    def steps(self, stream: Stream, steps: range, components: int) -> PackedPredictorSteps:
        """Packed predictors of some steps."""
        if (stream, steps) not in self._steps:
            packed = [self.step(stream, step, components) for step in steps]
            self._steps[stream, steps] = PackedPredictorSteps(packed)
        return self._steps[stream, steps]
