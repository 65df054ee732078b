"""The predictors of one channel at work in one tile-layer (SPEC §10.3); encoder and decoder alike."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.neural.layer_context import LayerContext
from scarfmt.neural.predictors import PassInputs, Predictor, StepContext
from scarfmt.schema import Stream

I64 = NDArray[np.int64]
Ints = NDArray[np.integer[Any]]
Predictors = Mapping[tuple[int, int, int], Predictor]
"""By (stream, component, step)."""


class PredictedChannel:
    """Context numbers of a channel's symbols, from what is decoded around them.

    Args:
        context: of the tile-layer, with the channels before this one settled.
        channel: index of the channel.
        predictors: of the file, by key.
        values: (n, components) values before this layer.
        steps: (n,) steps they are at.
    """

    def __init__(
        self, context: LayerContext, channel: int, predictors: Predictors, values: Ints, steps: I64
    ) -> None:
        self._context = context
        self._predictors = predictors
        self._stream = context.model.channels[channel].stream
        self._settled = context.settled(before=channel)
        self._values = values.astype(np.int64)
        self._steps = steps.copy()
        self._step = 0
        self._inputs: PassInputs | None = None
        self._covered = {step for stream, _, step in predictors if stream == self._stream}

    def covers(self, step: int) -> bool:
        """Whether a component has a predictor for `step`."""
        return step in self._covered

    def parts(self, step: int, chosen: I64) -> Iterator[I64]:
        """The anchors `chosen` pass by pass. Each pass must be coded before the next is asked for."""
        context, self._step = self._context, step
        around = StepContext(context.cells, step, self._values.shape[1])
        known = np.flatnonzero(self._steps >= step)
        around.add(context.rows(known), self._values[known], self._steps[known])
        for part in context.parts(chosen):
            rows = context.rows(part)
            self._part = part
            self._inputs = around.inputs(rows, context.classes[part], self._settled[part], self._values[part])
            yield part
            self._steps[part] = step
            around.add(rows, self._values[part], self._steps[part])

    def settle(self, step: int, chosen: I64, values: Ints) -> None:
        """Take the (m, components) `values` of anchors that received a step without predictors."""
        self._values[chosen], self._steps[chosen] = values, step

    def contexts(self, component: int) -> I64 | None:
        """(w,) context numbers of the pass's symbols of a component; None where static contexts apply."""
        predictor = self._predictors.get((self._stream, component, self._step))
        assert self._inputs is not None
        return None if predictor is None else predictor.contexts(self._inputs.of(component))

    def know(self, component: int, values: I64) -> None:
        """Take the (w,) values of a component at this step."""
        assert self._inputs is not None
        self._values[self._part, component] = values
        if self._step == 1:
            self._inputs.first_known(component, values)


def predicted_streams(predictors: Predictors) -> frozenset[Stream]:
    """The channels that have a predictor."""
    return frozenset(Stream(stream) for stream, _, _ in predictors)
