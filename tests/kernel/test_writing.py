"""The output of the compiled library: the groups of the definition, and whole files, byte for byte (SPEC §7.5,
§10.3)."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import islice

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
from scarfmt.codecs.channels import coarsen
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
    """Check that a layer makes equal groups either way; returns how many."""

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


def written(before: I64, after: I64, final: I64, at: I64) -> list[tuple[int, list[int], list[int]]]:
    """Groups that a channel of two components without predictors or classes writes: step, kinds and symbols."""
    channel, count = Channel(Stream.COLOUR, (1.0,) * 2, (ContextRule(),) * 2), len(final)
    values, first = np.full((count, 2), 77, np.int32), np.full((count, 2), 55, np.int32)
    steps = np.full(count, -1)
    target = KernelChannel(library(), channel, np.zeros(count, np.int64), values, [first], steps)
    groups, kinds, symbols = target.write(range(1, 21), (before, after), (final.astype(np.int32), at))
    assert (steps == after).all()
    assert (values == np.where(after[:, None] > 0, coarsen(final, (at - after)[:, None]), 0)).all()
    now = (before == 0) & (after > 0)
    assert (first[now] == coarsen(final, (at - 1)[:, None])[now]).all()
    assert (first[~now] == 55).all()
    kind, symbol = iter(kinds.tolist()), iter(symbols.tolist())
    parts = [(step, list(islice(kind, size)), list(islice(symbol, size))) for step, size in groups]
    assert not [*kind, *symbol]
    return parts


def test_groups_are_those_in_which_a_reader_asks() -> None:
    """First steps go component by component, later ones together, of the anchors that receive them."""
    first = np.array([[1, 2], [9, 9], [5, 6], [7, 8]])
    final = 3 * first + np.array([[1, -1], [0, 0], [0, 1], [-1, 0]])
    found = written(np.array([0, 2, 0, 1]), np.full(4, 2), final, np.full(4, 2))
    assert found == [
        (1, [0, 0], [1, 5]),
        (1, [256, 256], [2, 6]),
        (2, [3, 4, 4, 256 + 4, 256 + 4, 256 + 4], [1, 0, -1, -1, 1, 0]),
    ]


EDGES = [0, 1, 2, EXTREME // 3 - 1, EXTREME // 3, EXTREME // 3 + 1, EXTREME - 1, EXTREME]
VALUES = st.one_of(st.sampled_from([*EDGES, *[-edge for edge in EDGES]]), st.integers(-EXTREME, EXTREME))


@settings(deadline=None, max_examples=200)
@given(VALUES, VALUES, st.integers(1, 20), st.integers(0, 19), st.integers(0, 19))
@example(EXTREME, -EXTREME, 20, 0, 0)
@example(EXTREME, -EXTREME, 1, 1, 0)
def test_values_of_any_size_are_written_to_the_last_trit(one: int, other: int, at: int, less: int, wide: int) -> None:
    """A first value and trits give the value again, to the ends of 32 bits."""
    after = max(at - less, 1)
    before = max(after - wide, 0)
    final = np.array([[one, other]])
    found = written(np.array([before]), np.array([after]), final, np.array([at]))
    symbols = {step: symbols for step, _, symbols in found}
    value = coarsen(final, at - before) if before else np.zeros((1, 2), np.int64)
    for step in range(before + 1, after + 1):
        assert step == 1 or set(symbols[step]) <= {-1, 0, 1}
        value = 3 * value + np.array(symbols[step]) if step > 1 else coarsen(final, at - 1)
    assert (value == coarsen(final, at - after)).all()


def test_first_values_at_the_ends_of_32_bits() -> None:
    """-2^31 is left out (SPEC §7.5)."""
    one = np.ones(1, np.int64)
    for value in (EXTREME, -EXTREME):
        assert written(0 * one, one, np.array([[0, value]]), one)[1] == (1, [256], [value])
    with pytest.raises(InvalidInput) as caught:
        written(0 * one, one, np.array([[0, -EXTREME - 1]]), one)
    assert caught.value.refusal == "input-symbol"


def check_file(scene: QuantisedScene) -> bytes:
    """The file of a scene, the same either way."""
    compiled, plain = both(lambda engine: write_scene(scene, engine=engine))
    assert isinstance(compiled, bytes)
    assert compiled == plain
    return compiled


@settings(deadline=None, max_examples=40)
@given(scenes(max_anchors=80))
def test_random_scenes(scene: QuantisedScene) -> None:
    """Scenes of both profiles agree, with predictors, index network and hash grid, or none of them."""
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
    """The bytes are equal, and the scene that is read from the vector on disk gives them again."""
    scene = planned(name)
    data = check_file(scene)
    if name in ON_DISK:
        with open_source(str(VECTORS / "valid" / name / "input.scar")) as source:
            reader = SceneReader(source, engine=NUMPY_ENGINE)
            contents = tuple(content for _, content in reader.tiles(reader.models()))
        assert all(map(same, [c.values for c in contents], [c.values for c in scene.contents]))
        assert write_scene(replace(scene, contents=contents), engine=best_engine()) == data
