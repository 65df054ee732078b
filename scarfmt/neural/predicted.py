"""The predictors of one channel at work in one tile-layer (SPEC §10.3); encoder and decoder alike."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Protocol

import numpy as np

from scarfmt.arrays import F32, I32, I64, Ints
from scarfmt.container.schema import Stream
from scarfmt.neural.layer_context import LayerContext
from scarfmt.neural.predictor_group import PredictorGroup
from scarfmt.neural.predictors import PassInputs, Predictor, StepContext


class Contexts(Protocol):
    """The interface of a predictor. An encoder can pass its own implementation to see the inputs."""

    def contexts(self, x: F32) -> I64: ...


Predictors = Mapping[tuple[int, int, int], Contexts]
"""By (stream, component, step)."""


class PredictorSet:
    """The predictors in force in a layer, sorted by what is evaluated together.

    Args:
        predictors: by key.

    Attributes:
        streams: those with predictors.
    """

    def __init__(self, predictors: Predictors) -> None:
        self._steps: dict[tuple[int, int], dict[int, Contexts]] = {}
        for (stream, component, step), predictor in predictors.items():
            self._steps.setdefault((stream, step), {})[component] = predictor
        self.streams = frozenset(Stream(stream) for stream, _ in self._steps)
        self._groups: dict[tuple[int, int], list[PredictorGroup]] = {}

    def __bool__(self) -> bool:
        return bool(self._steps)

    def step(self, stream: Stream, step: int) -> dict[int, Contexts]:
        """The predictors of a step of a channel, by component; empty where static contexts apply."""
        return self._steps.get((stream, step), {})

    def groups(self, stream: Stream, step: int, components: int, depths: int) -> list[PredictorGroup] | None:
        """The predictors of a step, evaluated together where no input is decoded in between; None for stand-ins."""
        found = {c: p for c, p in self.step(stream, step).items() if isinstance(p, Predictor)}
        if len(found) < len(self.step(stream, step)):
            return None
        if (stream, step) not in self._groups:
            # The components of a first step see each other.
            parts = [{c: p} for c, p in sorted(found.items())] if step == 1 else [found]
            self._groups.setdefault((stream, step), [PredictorGroup(part, components, depths) for part in parts])
        return self._groups[stream, step]


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

    def __init__(self, context: LayerContext, channel: int, predictors: PredictorSet, values: Ints, steps: I64) -> None:
        self.context = context
        self.predictors = predictors
        self._stream = context.model.channels[channel].stream
        self._channel = channel
        self.components = values.shape[1]
        self._given = values
        self._given_steps = steps
        self._step = 0
        self._inputs: PassInputs | None = None
        self._found: dict[int, I64] = {}

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
        return self.context.settled(before=self._channel)

    def covers(self, step: int) -> bool:
        """Whether a component has a predictor for `step`."""
        return bool(self.predictors.step(self._stream, step))

    def parts(self, step: int, chosen: I64) -> Iterator[I64]:
        """The anchors `chosen` pass by pass. Each pass must be coded before the next is asked for."""
        context, self._step = self.context, step
        around = StepContext(context.cells, step, self.components)
        known = np.flatnonzero(self._steps >= step)
        around.add(context.rows(known), self._values[known], self._steps[known])
        for part in context.parts(chosen):
            if not len(part):
                continue
            rows = context.rows(part)
            self._part, self._found = part, {}
            self._inputs = around.inputs(rows, context.classes[part], self.settled[part], self._values[part])
            yield part
            self._steps[part] = step
            around.add(rows, self._values[part], np.array([step]))

    def settle(self, step: int, chosen: I64, values: Ints) -> None:
        """Take the (m, components) `values` of anchors that received a step without predictors."""
        self._values[chosen], self._steps[chosen] = values, step

    def contexts(self, component: int) -> I64 | None:
        """(w,) context numbers of the pass's symbols of a component; None where static contexts apply."""
        predictor = self.predictors.step(self._stream, self._step).get(component)
        if predictor is None:
            return None
        found = self._evaluated(component, predictor)
        if self.context.observer is not None:
            self.context.observer.contexts(self._stream, component, self._step, found)
        return found

    def _evaluated(self, component: int, predictor: Contexts) -> I64:
        assert self._inputs is not None
        depths = len(self.context.model.context.occupancies)
        groups = self.predictors.groups(self._stream, self._step, self.components, depths)
        if groups is None:
            return predictor.contexts(self._inputs.of(component))
        if component not in self._found:
            group = next(group for group in groups if component in group.components)
            self._found.update(zip(group.components, group.contexts(self._inputs.all), strict=True))
        return self._found[component]

    def know(self, component: int, values: I64) -> None:
        """Take the (w,) values of a component at this step."""
        assert self._inputs is not None
        self._values[self._part, component] = values
        if self._step == 1:
            self._inputs.first_known(component, values)
