"""The predictors of one channel at work in one tile-layer (SPEC §10.3); encoder and decoder alike."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property

import numpy as np

from scarfmt.arrays import I32, I64, Ints
from scarfmt.neural.context import fine
from scarfmt.neural.layer_context import LayerContext
from scarfmt.neural.predictors import PassInputs, Predictor

Predictors = Mapping[tuple[int, int, int], Predictor]
"""By (stream, component, step). An encoder puts others in their place, to see what they are shown."""


class PredictedChannel:
    """Context numbers of a channel's symbols, from what is decoded around them.

    Args:
        context: of the tile-layer, with the channels before this one settled.
        channel: index of the channel.
        predictors: in force.
        values: (n, components) values before this layer.
        steps: (n,) steps they are at.

    Attributes:
        context, predictors: as given.
        components: of the channel.
    """

    def __init__(self, context: LayerContext, channel: int, predictors: Predictors, values: Ints, steps: I64) -> None:
        self.context = context
        self.predictors = predictors
        self._stream = context.model.channels[channel].stream
        self._channel = channel
        self.components = values.shape[1]
        self._given = values
        self._given_steps = steps
        self._step = 0
        self._inputs: PassInputs | None = None

    # A layer's last steps may need none.
    @cached_property
    def _values(self) -> I64:
        return self._given.astype(np.int64)

    @cached_property
    def _steps(self) -> I64:
        return self._given_steps.copy()

    @cached_property
    def settled(self) -> I32:
        """(n, a) int32 fine values of the attribute channels before this one."""
        return self.context.list_settled(before=self._channel)

    def covers(self, step: int) -> bool:
        """Whether a component has a predictor for `step`."""
        return any((self._stream, component, step) in self.predictors for component in range(self.components))

    def parts(self, step: int, chosen: I64) -> Iterator[I64]:
        """The anchors `chosen` pass by pass. Each pass must be coded before the next is asked for."""
        context, self._step = self.context, step
        sums = context.sums(self.components)
        known = np.flatnonzero(self._steps >= step)
        sums.add(context.rows(known), fine(self._values[known], self._steps[known]))
        for part in context.parts(chosen):
            if not len(part):
                continue
            rows = context.rows(part)
            self._part = part
            here = context.classes[part], self.settled[part], self._values[part]
            self._inputs = PassInputs(step, *here, sums.around(rows))
            yield part
            self._steps[part] = step
            sums.add(rows, fine(self._values[part], np.array([step])))

    def settle(self, step: int, chosen: I64, values: Ints) -> None:
        """Take the (m, components) `values` of anchors that received a step without predictors."""
        self._values[chosen], self._steps[chosen] = values, step

    def contexts(self, component: int) -> I64 | None:
        """(w,) context numbers of the pass's symbols of a component; None where static contexts apply."""
        predictor = self.predictors.get((self._stream, component, self._step))
        if predictor is None:
            return None
        assert self._inputs is not None
        found = predictor.contexts(self._inputs.of(component))
        if self.context.observer is not None:
            self.context.observer.contexts(self._stream, component, self._step, found)
        return found

    def know(self, component: int, values: I64) -> None:
        """Take the (w,) values of a component at this step."""
        assert self._inputs is not None
        self._values[self._part, component] = values
        if self._step == 1:
            self._inputs.first_known(component, values)
