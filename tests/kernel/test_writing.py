"""What the compiled library writes: the groups of the definition, and whole files, byte for byte (SPEC §7.5, §10.3)."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from conformance.generate import VECTORS
from conformance.scenes.made import build, static_plans
from conformance.scenes.neural_scenes import neural_plans
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from fuzz.testing.strategies import scenes
from scarfmt.arrays import I64, Ints
from scarfmt.coding.engine import NUMPY_ENGINE, Engine
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.schema import Profile, Stream
from scarfmt.container.source import open_source
from scarfmt.engines import best_engine
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.grouping import by_context
from scarfmt.entropy.keys import StepKey, TableKey
from scarfmt.errors import InvalidInput
from scarfmt.kernel.channel import KernelChannel
from scarfmt.neural.predictors import MAX_HIDDEN
from scarfmt.scene.model import MAX_DEPTHS, Channel, ContextRule
from tests.kernel.channel_cases import Case
from tests.kernel.samples import EXTREME, SEEDS, both, library, needs_kernel, same

pytestmark = needs_kernel

PLANS = {**static_plans(), **neural_plans()}
ON_DISK = sorted(path.parent.name for path in VECTORS.glob("valid/*/input.scar"))


class Groups(Emitter):
    """Keeps the groups as they travel, whether they come one by one or many at once."""

    def __init__(self) -> None:
        self.found: list[tuple[TableKey, list[int]]] = []

    def emit(self, key: TableKey, values: Ints) -> None:
        if len(values):
            self.found.append((key, values.tolist()))

    def emit_grouped(self, key: StepKey, kinds: Ints, values: Ints) -> None:
        order, runs = by_context(kinds)
        for kind, start, past in runs:
            self.emit(key.table(kind), values[order][start:past])

    def emit_uniform(self, size: int, values: Ints) -> None:
        raise AssertionError

    def emit_rows(self, weights: object, values: Ints) -> None:
        raise AssertionError

    def emit_logits(self, logits: object, values: Ints) -> None:
        raise AssertionError


def check_groups(case: Case, more: int) -> int:
    """That a layer makes equal groups either way; how many."""

    def act(engine: Engine) -> list[tuple[TableKey, list[int]]]:
        emitter = Groups()
        case.write(engine, emitter, more)
        return emitter.found

    compiled, plain = both(act)
    assert isinstance(compiled, list)
    assert compiled == plain
    symbols = sum(len(values) for _, values in compiled)
    assert symbols == int((case.after - case.before).sum()) * case.model.channels[1].components
    return len(compiled)


MORE = st.integers(0, 3)


@settings(deadline=None, max_examples=60)
@given(SEEDS, st.integers(1, 6), MORE)
@example(0, 64, 0)
def test_static_contexts(seed: int, components: int, more: int) -> None:
    """By class, by a source of any size, by the value refined; first steps and refinements, values of any size."""
    check_groups(Case(seed, components, 0, 0.0, 0.0), more)


@settings(deadline=None, max_examples=80)
@given(SEEDS, st.integers(1, 6), st.integers(0, MAX_DEPTHS), MORE)
@example(0, 45, 4, 0)
@example(1, 64, 2, 1)
def test_predicted_contexts(seed: int, components: int, depths: int, more: int) -> None:
    """Some components and steps predicted, others not; any passes and depths; hidden units or none."""
    check_groups(Case(seed, components, depths, 0.7, 0.0), more)


@settings(deadline=None, max_examples=8)
@given(SEEDS, st.integers(0, MAX_HIDDEN), st.integers(1, 3))
@example(3, MAX_HIDDEN, 3)
def test_wide_predictors_of_many_anchors(seed: int, units: int, components: int) -> None:
    """Passes of more than one block, the last of them not full."""
    check_groups(Case(seed, components, 3, 1.0, 0.0, crowd=900, units=units), 0)


def test_the_cases_write_something() -> None:
    """Most of them many groups, of several passes."""
    found = [check_groups(Case(seed, 2, 2, 0.7, 0.0), 0) for seed in range(20)]
    assert np.median(found) > 30


def written(step: int, values: I64, given: I64, parts: list[I64]) -> list[tuple[list[int], list[int]]]:
    """What a channel of two components without predictors or classes writes."""
    channel, count = Channel(Stream.COLOUR, (1.0,) * 2, (ContextRule(),) * 2), len(values)
    known, first = np.array(values, np.int32), np.zeros((count, 2), np.int32)
    steps = np.full(count, step - 1)
    target = KernelChannel(library(), channel, np.zeros(count, np.int64), known, [first], steps)
    found = target.write(step, parts, np.array(given, np.int32), None)
    chosen = np.concatenate(parts)
    assert (known[chosen] == given[chosen]).all()
    assert (first[chosen] == (given[chosen] if step == 1 else 0)).all()
    assert (steps[chosen] == step).all()
    others = np.setdiff1d(np.arange(count), chosen)
    assert (known[others] == values[others]).all()
    assert (steps[others] == step - 1).all()
    return [(kinds.tolist(), symbols.tolist()) for kinds, symbols in found]


def test_groups_are_those_in_which_a_reader_asks() -> None:
    """First steps go component by component, later ones together; pass by pass, one of them empty."""
    parts = [np.array([3, 0]), np.zeros(0, np.int64), np.array([2])]
    first = np.array([[1, 2], [0, 0], [5, 6], [7, 8]])
    found = written(1, np.zeros((4, 2), np.int64), first, parts)
    assert found == [([0, 0], [7, 1]), ([256, 256], [8, 2]), ([], []), ([], []), ([0], [5]), ([256], [6])]
    trits = np.array([[1, -1], [0, 0], [0, 1], [-1, 0]])
    kinds = [[4, 3, 4 + 256, 4 + 256], [], [4, 4 + 256]]
    symbols = [[-1, 1, 0, -1], [], [0, 1]]
    assert written(2, first, 3 * first + trits, parts) == list(zip(kinds, symbols, strict=True))


EDGES = [0, 1, 2, EXTREME // 3 - 1, EXTREME // 3, EXTREME // 3 + 1, EXTREME - 1, EXTREME]
VALUES = st.one_of(st.sampled_from([*EDGES, *[-edge for edge in EDGES]]), st.integers(-EXTREME, EXTREME))


@settings(deadline=None, max_examples=200)
@given(VALUES, st.one_of(VALUES, st.integers(-2, 2)), st.integers(-2, 2), st.integers(2, 20), st.booleans())
@example(EXTREME, 0, 1, 2, True)
@example(-EXTREME, 0, -1, 2, True)
@example(EXTREME // 3, 0, 1, 2, False)
def test_only_trits_are_written(value: int, other: int, apart: int, step: int, wrap: bool) -> None:
    """A difference of 2^32 and a trit is none: it is refused, not wrapped. As is a value that leaves 32 bits."""
    now = 3 * value + apart if abs(3 * value + apart) <= EXTREME else other
    if wrap and abs(3 * value) > EXTREME:
        now = (3 * value + apart + (1 << 31)) % (1 << 32) - (1 << 31)
    values, given = np.array([[5, 0], [0, value]]), np.array([[15, 1], [0, now]])
    trit = now - 3 * value
    if abs(trit) <= 1 and abs(now) <= EXTREME:
        ((_, symbols),) = written(step, values, given, [np.arange(2)])
        assert symbols == [0, 0, 1, trit]
    else:
        with pytest.raises(InvalidInput) as caught:
            written(step, values, given, [np.arange(2)])
        assert caught.value.refusal == "input-symbol"


@pytest.mark.parametrize("value", [EXTREME, -EXTREME, -EXTREME - 1])
def test_first_values_at_the_ends_of_32_bits(value: int) -> None:
    """-2^31 is left out (SPEC §7.5)."""
    given = np.array([[0, value]])
    if value < -EXTREME:
        with pytest.raises(InvalidInput):
            written(1, np.zeros((1, 2), np.int64), given, [np.arange(1)])
    else:
        assert written(1, np.zeros((1, 2), np.int64), given, [np.arange(1)])[1] == ([256], [value])


def check_file(scene: QuantisedScene) -> bytes:
    """The file of a scene, the same either way."""
    compiled, plain = both(lambda engine: write_scene(scene, engine=engine))
    assert isinstance(compiled, bytes)
    assert compiled == plain
    return compiled


@settings(deadline=None, max_examples=40)
@given(scenes(max_anchors=80))
def test_random_scenes(scene: QuantisedScene) -> None:
    """Of both profiles, with predictors, index network and hash grid, or none of them."""
    check_file(scene)


@pytest.mark.parametrize("profile", Profile)
def test_larger_scenes(profile: Profile) -> None:
    """Passes of many blocks, and counts beyond those that are taken without sorting."""
    check_file(random_scene(5, profile, anchors=3000, tiles=2))
    check_file(neural_scene(5, profile, anchors=600, layers=2, tiles=2))


@lru_cache
def planned(name: str) -> QuantisedScene:
    """The scene of a vector."""
    return build(PLANS[name][1])


@pytest.mark.parametrize("name", sorted(set(PLANS) - {"full-block"}))
def test_scenes_of_the_vectors(name: str) -> None:
    """The same bytes; and the scene that is read from the vector on disk gives them again."""
    scene = planned(name)
    data = check_file(scene)
    if name in ON_DISK:
        with open_source(str(VECTORS / "valid" / name / "input.scar")) as source:
            reader = SceneReader(source, engine=NUMPY_ENGINE)
            contents = tuple(content for _, content in reader.tiles(reader.models()))
        assert all(map(same, [c.values for c in contents], [c.values for c in scene.contents]))
        assert write_scene(replace(scene, contents=contents), engine=best_engine()) == data
