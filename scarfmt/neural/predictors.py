"""Predictors: tiny integer networks that choose the table of a channel value (SPEC §10.3).

A predictor belongs to one ternary step of one component of an attribute channel or of LATENT. From what is decoded
around an anchor it computes a context number; a static table of that number codes the symbol. No probability is
computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import F32, F64, I64, Ints
from scarfmt.container.schema import Stream
from scarfmt.errors import Malformed
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.context import cell_power, count_features, fine
from scarfmt.scene.model import MAX_CLASSES, SceneModel
from scarfmt.scene.streams import PREDICTED_STREAMS

AMAX = 511
"""Inputs and hidden units are 10-bit activations."""
MAX_INPUTS = 255
"""A wide LATENT under many depths has more: then it has no predictors."""
MAX_CONTEXTS = 256
MAX_HIDDEN = 64
CLASS_INPUT = 64

_COARSE_SHIFT = 6
_RELATIVE_SHIFT = 5


@dataclass(frozen=True)
class Predictor:
    """The context of one step of one component.

    Attributes:
        stream: one of `streams.PREDICTED_STREAMS`.
        component, step: of the symbols it chooses tables for; step from 1.
        hidden: ReLU layer, (units, inputs), or None.
        output: (2, inputs + units): from inputs, then hidden units.
        buckets: (B1, B2), each >= 1, B1 * B2 <= 256.
    """

    stream: Stream
    component: int
    step: int
    hidden: Linear | None
    output: Linear
    buckets: tuple[int, int]

    @property
    def key(self) -> tuple[int, int, int]:
        """(stream, component, step): orders predictors and names their tables."""
        return int(self.stream), self.component, self.step

    @property
    def units(self) -> int:
        """Hidden units."""
        return 0 if self.hidden is None else self.hidden.outputs

    @property
    def inputs(self) -> int:
        """Input width."""
        return self.output.inputs - self.units

    @property
    def multiply_adds(self) -> int:
        """Multiplications of one symbol."""
        return self.output.weights.size + (0 if self.hidden is None else self.hidden.weights.size)

    def check(self) -> None:
        """Check what can be without a scene (SPEC §10.3).

        Raises:
            Malformed: ``bad-predictor`` for shapes, ranges, or sums that float32 might not hold exactly.
        """
        for layer in (self.output, *([self.hidden] if self.hidden is not None else [])):
            layer.check(AMAX, "bad-predictor")
        one, two = self.buckets
        fits = (
            self.stream in PREDICTED_STREAMS
            and self.step >= 1
            and one >= 1
            and two >= 1
            and one * two <= MAX_CONTEXTS
            and self.output.outputs == 2
            and self.units <= MAX_HIDDEN
            and 1 <= self.inputs <= MAX_INPUTS
            and (self.hidden is None or self.hidden.inputs == self.inputs)
        )
        if not fits:
            raise bad_predictor("a predictor's shape, key or buckets are out of range")

    def contexts(self, x: F32) -> I64:
        """(n,) context numbers, 0..B1*B2-1, of (n, inputs) integers in -511..511."""
        weights, biases = self.output.folded
        sums = x @ weights[: self.inputs]
        sums += biases
        if self.hidden is not None:
            # Still partial sums of one row, so exact in this order too.
            sums += self.hidden.relu(x, AMAX) @ weights[self.inputs :]
        out = np.floor(sums)
        one, two = self.buckets
        context = np.clip(out[:, 0], 0, one - 1) * np.float32(two) + np.clip(out[:, 1], 0, two - 1)
        return np.asarray(context, np.int64)


def bad_predictor(message: str) -> Malformed:
    """The refusal of everything that is wrong with a predictor."""
    return Malformed("bad-predictor", f"{message} (SPEC §10.3)", field="predictors")


def input_width(model: SceneModel, channel: int) -> int:
    """Inputs of the predictors of a channel (SPEC §10.3)."""
    before = sum(model.channels[index].components for index in model.attributes if index < channel)
    own = model.channels[channel].components
    return MAX_CLASSES + before + own + len(model.context.occupancies) * (own + 2)


def first_use(model: SceneModel, channel: int, step: int) -> int | None:
    """The layer (1-based) in which a step of a channel first travels, None if never."""
    layers = enumerate(model.layers, start=1)
    return next((layer for layer, row in layers if any(steps[channel] >= step for steps in row.steps)), None)


def check_predictors(model: SceneModel, layer: int, predictors: Sequence[Predictor]) -> None:
    """Check the predictors of a layer's PREDICTORS block against the scene (SPEC §10.3).

    Raises:
        Malformed: ``bad-predictor`` unless keys ascend strictly, each is of a channel that the file has,
            of one of its components and of a step that first travels in this layer, with that channel's inputs.
    """
    keys = [predictor.key for predictor in predictors]
    if keys != sorted(set(keys)):
        raise bad_predictor("keys must ascend strictly")
    for predictor in predictors:
        predictor.check()
        channel = model.channel_index(predictor.stream)
        if channel is None or predictor.component >= model.channels[channel].components:
            raise bad_predictor(f"the file has no component {predictor.key[:2]}")
        if first_use(model, channel, predictor.step) != layer:
            raise bad_predictor(f"step {predictor.step} does not first travel in layer {layer}")
        if predictor.inputs != input_width(model, channel):
            raise bad_predictor(f"{predictor.inputs} inputs, not {input_width(model, channel)}")


class PassInputs:
    """Inputs of the anchors of one pass: shared by the components but for a few columns (SPEC §10.3).

    Args:
        step: from 1.
        classes: (w,).
        before: (w, a) fine values of the attribute channels before this one, after this layer.
        values: (w, components) this channel's, at the step before; ignored in step 1.
        around: means and counts in the cells of the anchors (:meth:`CellSums.around`).
    """

    def __init__(self, step: int, classes: I64, before: Ints, values: Ints, around: tuple[F64, F64]) -> None:
        own, (means, counts) = fine(values, np.array([step - 1])), around
        (wide, components), depths = own.shape, counts.shape[1]
        self._depths = depths
        self._at = MAX_CLASSES + before.shape[1]
        start = self._at + components
        # Column by column: most of the work below is on whole columns.
        self._x = np.empty((start + depths * (2 * components + 1), wide), np.float32)
        self._x[:MAX_CLASSES] = 0
        self._x[classes, np.arange(wide)] = CLASS_INPUT
        self._x[MAX_CLASSES : self._at] = coarse_input(before.T)
        self._x[self._at : start] = coarse_input(own.T)
        columns = means.transpose(1, 2, 0).reshape(depths * components, wide)
        self._x[start : start + len(columns)] = coarse_input(columns)
        start += len(columns)
        self._x[start : start + depths] = count_features(counts.T)
        self._shared = start + depths
        # Component by component, its depths side by side.
        apart = means.transpose(2, 1, 0) - own.T[:, None]
        apart *= cell_power(np.array(step))
        # The limits lie far beyond those of the inputs: an anchor at the edge of either clamps alike.
        np.floor(apart * 2.0**-_RELATIVE_SHIFT + 0.5, out=apart)
        _clamp(apart)
        self._x[self._shared :] = apart.reshape(components * depths, wide)

    def of(self, component: int) -> F32:
        """(w, inputs) float32 integers in -511..511: what the predictor of a component reads."""
        own = self._shared + component * self._depths
        return np.concatenate([self._x[: self._shared], self._x[own : own + self._depths]]).T

    def first_known(self, component: int, values: Ints) -> None:
        """In step 1, take (w,) first-step values of a component: inputs of the components after it."""
        self._x[self._at + component] = coarse_input(fine(values[:, None], np.array([1]))[:, 0])


def coarse_input(fine_values: Ints | F64) -> F64:
    """Fixed-point values as inputs: in 16ths of the first cell, clamped to -511..511."""
    scaled = np.asarray(fine_values, np.float64) * 2.0**-_COARSE_SHIFT
    return _clamp(np.floor(scaled, out=scaled))


def _clamp(values: F64) -> F64:
    """`values` brought within -511..511, in place; two plain operations are faster than np.clip on few values."""
    np.maximum(values, -AMAX, out=values)
    return np.minimum(values, AMAX, out=values)
