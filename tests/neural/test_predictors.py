"""Predictors: contexts and inputs against SPEC §10.3 in Python's integers, and every rule a file must keep."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.arrays import I64
from scarfmt.container.schema import Profile, Stream
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.context import Cells, CellSums, fine
from scarfmt.neural.predictors import AMAX, PassInputs, Predictor, first_use, input_width
from scarfmt.scene.model import MAX_CLASSES, Channel, DecodedContext, LayerRow, SceneModel


def linear(rng: np.random.Generator, rows: int, columns: int, top: int = 127) -> Linear:
    weights = rng.integers(-top, top + 1, (rows, columns)).astype(np.int32)
    return Linear(weights, rng.integers(-(10**6), 10**6, rows), int(rng.integers(0, 16)))


def predictor(seed: int, inputs: int, units: int, buckets: tuple[int, int] = (16, 4), **changes: Any) -> Predictor:
    rng = np.random.default_rng(seed)
    hidden = linear(rng, units, inputs) if units else None
    made = Predictor(Stream.SCALE, 0, 1, hidden, linear(rng, 2, inputs + units), buckets)
    return replace(made, **changes)


def literal_context(net: Predictor, x: list[int]) -> int:
    """The context number of one anchor, as the text says it."""

    def row(layer: Linear, number: int, values: list[int]) -> int:
        total = int(layer.biases[number])
        total += sum(int(w) * v for w, v in zip(layer.weights[number], values, strict=True))
        return total if layer.shift == 0 else (total + (1 << (layer.shift - 1))) >> layer.shift

    hidden = []
    if net.hidden is not None:
        hidden = [min(max(row(net.hidden, unit, x), 0), AMAX) for unit in range(net.units)]
    one, two = (row(net.output, number, x + hidden) for number in range(2))
    return min(max(one, 0), net.buckets[0] - 1) * net.buckets[1] + min(max(two, 0), net.buckets[1] - 1)


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(0, 12), st.integers(1, 16), st.integers(1, 16))
def test_contexts_are_exact(seed: int, inputs: int, units: int, one: int, two: int) -> None:
    """Integer by integer, with weights and inputs at the edge of their ranges."""
    net = predictor(seed, inputs, units, (one, two))
    net.check()
    x = np.random.default_rng(seed).integers(-AMAX, AMAX + 1, (20, inputs))
    found = net.contexts(x.astype(np.float32))
    assert np.array_equal(net.contexts(np.asfortranarray(x.astype(np.float32))), found)  # as the coder stores them
    assert found.tolist() == [literal_context(net, row) for row in x.tolist()]
    assert found.max() < one * two


def scene(depths: int = 2) -> SceneModel:
    """Four channels, two of them attributes; step 2 of colours and LATENT first travel in layer 2."""
    channels = tuple(
        Channel(stream, (1.0,) * size)
        for stream, size in ((Stream.POSITION_RESIDUAL, 3), (Stream.SCALE, 3), (Stream.COLOUR, 3), (Stream.LATENT, 2))
    )
    rows = LayerRow((0,), ((0, 2, 1, 0),)), LayerRow((0, 0), ((0, 2, 2, 1), (0, 1, 1, 0)))
    return SceneModel(Profile.EXPLICIT, 1, channels, rows, DecodedContext(1, (24, 3)[:depths]))


def test_input_widths_follow_the_scene() -> None:
    """Classes, attributes before, own values, and per depth the channel's means, a count and a difference."""
    assert input_width(scene(), 1) == MAX_CLASSES + 3 + 2 * 5
    assert input_width(scene(0), 2) == MAX_CLASSES + 6
    assert input_width(scene(), 3) == MAX_CLASSES + 6 + 2 + 2 * 4


def test_first_use_is_the_layer_in_which_a_step_travels() -> None:
    """The layer is also right for a step that never travels."""
    assert [first_use(scene(), 2, step) for step in (1, 2, 3)] == [1, 2, None]


def clamp(value: int, top: int = AMAX) -> int:
    return min(max(value, -top), top)


def literal_fine(value: int, steps: int) -> int:
    return (2048 * value + 3 ** (steps - 1)) // (2 * 3 ** (steps - 1)) if steps else 0


class Tile:
    """A random tile-layer: who is known at which step, and who receives `step` now."""

    def __init__(self, seed: int, step: int) -> None:
        rng = np.random.default_rng(seed)
        self.count, self.step, self.shifts = 40, step, [2, 1]
        self.codes = np.sort(rng.integers(0, 8**3, self.count).astype(np.uint64))
        self.classes = rng.integers(0, MAX_CLASSES, self.count)
        self.before = rng.integers(-60000, 60000, (self.count, 4))
        self.values = rng.integers(-40, 41, (self.count, 2)) * 3 ** rng.integers(0, 6)
        self.group = np.flatnonzero(rng.random(self.count) < 0.5)
        self.known = np.setdiff1d(np.flatnonzero(rng.random(self.count) < 0.7), self.group)
        self.steps = rng.integers(step, step + 3, self.count)

    def row(self, anchor: int, component: int, coarse: I64) -> list[int]:
        """The inputs of one anchor, SPEC §10.3 word for word; `coarse`: its own values as far as known."""
        out = [64 if c == self.classes[anchor] else 0 for c in range(MAX_CLASSES)]
        out += [clamp(int(v) >> 6) for v in self.before[anchor]]
        at = max(self.step - 1, 1)
        own = [literal_fine(int(v), at) for v in coarse]
        out += [clamp(v >> 6) for v in own]
        means, counts = [[0, 0]], []
        for shift in self.shifts:
            cell = [
                i
                for i in self.known
                if self.codes[i] >> np.uint64(3 * shift) == self.codes[anchor] >> np.uint64(3 * shift)
            ]
            sums = [sum(literal_fine(int(self.values[i, c]), int(self.steps[i])) for i in cell) for c in range(2)]
            means.append([(2 * s + len(cell)) // (2 * len(cell)) for s in sums] if cell else means[-1])
            counts.append(len(cell))
        out += [clamp(m >> 6) for mean in means[1:] for m in mean]
        out += [32 * min(c.bit_length(), 8) for c in counts]
        mine = 0 if self.step == 1 else own[component]
        return out + [
            clamp((clamp((mean[component] - mine) * 3 ** (self.step - 1), 1 << 30) + 16) >> 5) for mean in means[1:]
        ]


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_inputs_are_those_of_the_text(seed: int, step: int) -> None:
    """Every column of every anchor, for both components; in step 1 the second sees the first."""
    tile = Tile(seed, step)
    sums = CellSums(Cells(tile.codes, tile.shifts), 2)
    sums.add(tile.known, fine(tile.values[tile.known], tile.steps[tile.known]))
    values = tile.values[tile.group]
    classes, before = tile.classes[tile.group], tile.before[tile.group]
    inputs = PassInputs(step, classes, before, values, sums.around(tile.group))
    for component in range(2):
        found = inputs.of(component)
        # In step 1 nothing of the channel is known but the components before.
        own = values * (np.arange(2) < component) if step == 1 else values
        want = [tile.row(anchor, component, own[place]) for place, anchor in enumerate(tile.group)]
        assert found.tolist() == want
        assert found.dtype == np.float32
        if step == 1:
            inputs.first_known(component, values[:, component])
