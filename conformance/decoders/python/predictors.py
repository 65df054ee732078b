"""PREDICTORS blocks, and the context numbers that predictors give (SPEC §10.3)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from conformance.decoders.python.arithmetic import Linear, Matrix, Vector, clamp, read_matrix, round_shift
from conformance.decoders.python.context import fine
from conformance.decoders.python.fields import require
from conformance.decoders.python.numbers import Numbers
from conformance.decoders.python.tile import Key

ATTRIBUTES = (5, 6, 7, 8)
PREDICTED = (*ATTRIBUTES, 10)
MAX_CLASSES = 15
_HEAD = "stream", "component", "step", "b1", "b2", "classes", "inputs", "units"


class Predictor(NamedTuple):
    """A predictor of one (stream, component, step)."""

    buckets: tuple[int, int]
    hidden: Linear | None
    output: Linear

    def context(self, x: Vector) -> int:
        z = self.hidden(x, 0, 511) if self.hidden else []
        o0, o1 = self.output.round(x + z)
        b1, b2 = self.buckets
        return clamp(o0, 0, b1 - 1) * b2 + clamp(o1, 0, b2 - 1)


def parse_predictors(numbers: Numbers) -> dict[Key, Predictor]:
    out, keys = {}, list[Key]()
    count = numbers.count(1024, "predictor_count")
    require(count > 0, "bad-predictor")
    for _ in range(count):
        stream, component, step, b1, b2, classes, inputs, units = (numbers.count(255, name) for name in _HEAD)
        sane = stream in PREDICTED and classes <= MAX_CLASSES < inputs and units <= 64
        require(sane, "bad-predictor")
        hidden = _read_layer(numbers, units, inputs, classes) if units else None
        output = _read_layer(numbers, 2, inputs + units, classes)
        sound = output.is_exact(511) and (hidden is None or hidden.is_exact(511))
        require(sound and step >= 1 and (b1 + 1) * (b2 + 1) <= 256, "bad-predictor")
        keys.append((stream, component, step))
        out[keys[-1]] = Predictor((b1 + 1, b2 + 1), hidden, output)
    numbers.seal()
    require(all(a < b for a, b in pairwise(keys)), "bad-predictor")
    return out


def check_predictors(predictors: dict[Key, Predictor], components: dict[int, int], depths: int) -> None:
    """N of each (R-10.3-3); `components` by stream, of every channel of the file."""
    for (stream, _, _), predictor in predictors.items():
        units = len(predictor.hidden.biases) if predictor.hidden else 0
        before = sum(count for other, count in components.items() if other in ATTRIBUTES and other < stream)
        wanted = MAX_CLASSES + before + components[stream] + depths * (components[stream] + 2)
        require(len(predictor.output.weights[0]) - units == wanted, "bad-predictor")


def _read_layer(numbers: Numbers, rows: int, columns: int, classes: int) -> Linear:
    shift = numbers.count(255, "shift")
    missing = [0] * (MAX_CLASSES - classes)
    kept = read_matrix(numbers, rows, columns - len(missing), "weights", "bad-predictor")
    weights = [row[:classes] + missing + row[classes:] for row in kept]
    return Linear(weights, numbers.take_shifted(rows, "biases"), shift)


@dataclass(frozen=True)
class StepInputs:
    """The inputs that the predictors of one step of one channel read of an anchor.

    Attributes:
        klass: its class.
        before: fine values of the attribute channels before this one, after this layer.
        fine0: those of this channel after n - 1 steps.
        first: first-step values of this channel, for step 1.
        step: n.
    """

    klass: int
    before: Vector
    fine0: Vector
    first: Vector
    step: int

    def of(self, j: int, around: tuple[Matrix, Vector]) -> Vector:
        means, counts = around
        x = [64 * (c == self.klass) for c in range(MAX_CLASSES)]
        x += [v >> 6 for v in self.before]
        for c, v in enumerate(self.fine0):
            x.append((fine(self.first[c], 1) if self.step == 1 and c < j else v) >> 6)
        x += [m >> 6 for row in means for m in row]
        x += counts
        for row in means:
            x.append(round_shift((row[j] - self.fine0[j]) * 3 ** (self.step - 1), 5))
        return [clamp(v, -511, 511) for v in x]
