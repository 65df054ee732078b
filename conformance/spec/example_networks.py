"""Worked examples of SPEC.md §10.2, §10.3 and §10.6: fine values, passes, cell means, a predictor, a hash grid.

They are computed by the second decoder, written from the text; terms of the sum of a grid level, which it adds up as it
goes, by the package.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from conformance.decoders.python.arithmetic import Vector
from conformance.decoders.python.context import Context, fine
from conformance.decoders.python.hash_grid import Grid, Level
from conformance.decoders.python.predictors import MAX_CLASSES, Predictor, StepInputs, parse_predictors
from conformance.writer.networks import predictors_block
from scarfmt.container.schema import Stream
from scarfmt.neural import arithmetic, predictors
from scarfmt.neural.grid import GridBox, GridLevel, vertex_addresses, vertex_weights

FINE = ((5, 1), (1, 2), (-1, 2), (1, 3), (20000, 1), (9, 0))
"""(v, n)."""
COHORT = 10
CODES, LOCAL_BITS, TARGETS = [0, 1, 9, 10, 12, 63], 2, (5, 2)
KNOWN = {0: -7, 2: 2}
"""Anchors of E, and the number of each."""
LOOKED_FROM = (3, 5)
CLASS, STEP, VALUE = 1, 2, 3
BEFORE = [-1536, -2900, -4700]
"""Fine values of SCALE."""
MEANS, COUNTS = [[3500], [3300]], [128, 64]
BUCKETS = (8, 4)
HIDDEN = ([0, 2, 1, 0, 0, 3, -1, 0, 1, 0, 4, 2], 40, 5)
"""Stored weights, bias and shift of the hidden unit."""
OUTPUT = ([[0, 3, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 9], [4, -1, 0, 2, 0, 0, 0, 0, 1, 0, 3, 0, -2]], [-20, 30], 6)
"""Stored rows, biases and shift."""
BOX, POINT = GridBox((10, 20, 30), 4), (17, 23, 31)
PLANE = GridLevel(plane=1, resolution=3, table_log2=5, features=1)
ONES = (1, 6)
"""Entries of the table of PLANE whose bit is 1."""
HASHED, VERTEX = GridLevel(plane=0, resolution=64, table_log2=8, features=1), (3, 5, 7)


class Around(NamedTuple):
    """The values around an anchor: per depth the mean of one column, and the count feature."""

    means: list[int]
    counts: list[int]


class Evaluated(NamedTuple):
    """A predictor's inputs, hidden unit, outputs and context."""

    inputs: Vector
    hidden: Vector
    outputs: Vector
    context: int


class Summed(NamedTuple):
    """A level of a hash grid: per axis cell and part, per vertex entry and weight, and the feature."""

    cells: Vector
    parts: Vector
    entries: Vector
    weights: Vector
    total: int
    feature: int


def fine_values() -> list[int]:
    """fine(v, n) of FINE (SPEC §10.2)."""
    return [fine(v, n) for v, n in FINE]


def passes() -> list[Vector]:
    """The ranks of COHORT anchors, pass by pass, with passes_log2 = 2."""
    return Context(list(range(COHORT)), LOCAL_BITS, (), 2).passes(list(range(COHORT)))


def context() -> Context:
    """The anchors of CODES, all known."""
    return Context(CODES, LOCAL_BITS, TARGETS, 0)


def around() -> list[Around]:
    """The values around the anchors of LOOKED_FROM, from those of KNOWN."""
    known = context()
    cells = known.cells(1)
    for a, number in KNOWN.items():
        cells.add(a, [number])
    seen = [cells.around(a) for a in LOOKED_FROM]
    return [Around([row[0] for row in means], counts) for means, counts in seen]


def worked_predictor() -> predictors.Predictor:
    """A predictor of step 2 of OPACITY, in a file with SCALE before it and two depths, with one hidden unit."""
    weights, bias, shift = HIDDEN
    rows, biases, output_shift = OUTPUT
    hidden = arithmetic.Linear(_full([weights]), np.array([bias], np.int64), shift)
    output = arithmetic.Linear(_full(rows), np.array(biases, np.int64), output_shift)
    return predictors.Predictor(Stream.OPACITY, 0, STEP, hidden, output, BUCKETS)


def _full(stored: list[Vector]) -> np.ndarray[tuple[int, int], np.dtype[np.int32]]:
    """Rows with the class columns that are not stored."""
    missing = [0] * (MAX_CLASSES - CLASS - 1)
    return np.array([row[: CLASS + 1] + missing + row[CLASS + 1 :] for row in stored], np.int32)


def plain_predictor() -> Predictor:
    """The predictor read back from its block."""
    return next(iter(parse_predictors(predictors_block([worked_predictor()])).values()))


def evaluated() -> Evaluated:
    """The predictor at work (SPEC §10.3)."""
    predictor = plain_predictor()
    x = StepInputs(CLASS, BEFORE, [fine(VALUE, STEP - 1)], [VALUE], STEP).of(0, (MEANS, COUNTS))
    hidden = predictor.hidden(x, 0, 511) if predictor.hidden else []
    return Evaluated(x, hidden, predictor.output.rounded(x + hidden), predictor.context(x))


def summed() -> Summed:
    """The level PLANE at POINT (SPEC §10.6)."""
    bits = [int(entry in ONES) for entry in range(PLANE.entries)]
    level = Level(PLANE.axes, PLANE.resolution, PLANE.table_log2, PLANE.features)
    (feature,) = Grid(list(BOX.origin), BOX.extent_bits, [(level, bits)]).features(list(POINT))
    cells, parts = BOX.locate(PLANE, BOX.inside(np.array([POINT])))
    entries = vertex_addresses(PLANE, cells)[:, 0].tolist()
    weights = vertex_weights(parts)[:, 0].tolist()
    total = sum(w if bits[entry] else -w for entry, w in zip(entries, weights, strict=True))
    return Summed(cells[:, 0].tolist(), parts[:, 0].tolist(), entries, weights, total, feature)


def hashed_entry() -> int:
    """The entry of VERTEX in the level HASHED."""
    return Level(HASHED.axes, HASHED.resolution, HASHED.table_log2, HASHED.features).entry(list(VERTEX))
