"""PREDICTORS blocks, and the context numbers that predictors give (SPEC §10.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from conformance.decoders.python.arithmetic import Linear, Matrix, Vector, clamp, read_matrix, round_shift
from conformance.decoders.python.context import fine
from conformance.decoders.python.fields import Payload, require

ATTRIBUTES = (5, 6, 7, 8)
PREDICTED = (*ATTRIBUTES, 10)
MAX_CLASSES = 15

Key = tuple[int, int, int]


class Predictor(NamedTuple):
    """A predictor of one (stream, component, step)."""

    buckets: tuple[int, int]
    hidden: Linear | None
    output: Linear

    def context(self, x: Vector) -> int:
        z = self.hidden(x, 0, 511) if self.hidden else []
        o0, o1 = self.output.rounded(x + z)
        b1, b2 = self.buckets
        return clamp(o0, 0, b1 - 1) * b2 + clamp(o1, 0, b2 - 1)


def parse_predictors(block: bytes) -> dict[Key, Predictor]:
    reader, out = Payload(block), {}
    count = reader.count(1024)
    require(count > 0, "bad-predictor")
    for _ in range(count):
        stream, component, step, b1, b2, classes, inputs, units = reader.fields("8B")
        sane = stream in PREDICTED and classes <= MAX_CLASSES < inputs and units <= 64
        require(sane, "bad-predictor")
        hidden = _stored_layer(reader, units, inputs, classes) if units else None
        output = _stored_layer(reader, 2, inputs + units, classes)
        out[stream, component, step] = Predictor((b1 + 1, b2 + 1), hidden, output)
    reader.finish()
    return out


def _stored_layer(reader: Payload, rows: int, columns: int, classes: int) -> Linear:
    shift = reader.u8()
    missing = [0] * (MAX_CLASSES - classes)
    kept = read_matrix(reader, rows, columns - len(missing), "bad-predictor")
    weights = [row[:classes] + missing + row[classes:] for row in kept]
    return Linear(weights, reader.shifted(rows), shift)


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
