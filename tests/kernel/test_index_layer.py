"""Indices of a tile-layer read in one call of the library: those of the definition, and as many (SPEC §10.5)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fuzz.testing.networks import random_books, random_network
from scarfmt.arrays import I16, I64
from scarfmt.codecs.neural_indices import IndexCoder, index_coder
from scarfmt.coding.engine import NUMPY_ENGINE, Engine
from scarfmt.container.directory import TileFrame
from scarfmt.container.schema import Profile, Stream
from scarfmt.counters import Counters
from scarfmt.errors import InvalidInput
from scarfmt.kernel import index_layer
from scarfmt.kernel.cells import cell_names
from scarfmt.kernel.index_layer import Known, read_indices
from scarfmt.kernel.members import EXP2_WEIGHTS
from scarfmt.kernel.packed_network import packed_network
from scarfmt.kernel.stream_decoder import KernelRansDecoder
from scarfmt.neural.grid import GridLevel, HashGrid
from scarfmt.neural.layer_context import LayerContext
from scarfmt.neural.network import Inputs
from scarfmt.scene.model import Channel, ContextRule, DecodedContext, LayerRow, SceneModel
from tests.kernel.samples import SEEDS, both, library, needs_kernel, outcome, random_stream, same
from tests.kernel.test_index_inputs import random_codes, spread

pytestmark = needs_kernel

BITS = 5
ATTRIBUTES = 4


class Case:
    """A tile-layer of any stages before and after, under a random network.

    Args:
        stages: most of an anchor.
        crowd: most anchors.
        options: of the network.
    """

    def __init__(self, seed: int, stages: int, crowd: int = 80, **options: Any) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.count = count = int(rng.integers(0, crowd))
        books = random_books(rng, int(rng.integers(1, 40)), int(rng.integers(1, 40)), int(rng.integers(1, 8)))
        depths = int(rng.integers(0, 4))
        grid = self._grid() if rng.random() < 0.5 else None
        self.inputs = Inputs(
            classes=int(rng.integers(0, 4)), own=bool(rng.integers(2)), attributes=ATTRIBUTES, depths=depths,
            latents=int(rng.integers(0, books.dimension + 1)), latent_shift=int(rng.integers(0, 5)),
            grid=0 if grid is None else grid.width,
        )  # fmt: skip
        if not self.inputs.width:
            self.inputs = replace(self.inputs, classes=1)
        bits, hidden = int(rng.integers(8, 13)), int(rng.integers(1, 22))
        made: dict[str, Any] = {"attention": False, "activation_bits": bits, "hidden": hidden, **options}
        network = random_network(rng, books, self.inputs, stages=stages, **made)
        self.coder: IndexCoder = index_coder(network, books, grid)
        rule = ContextRule()
        steps = Channel(Stream.SCALE, (1.0,) * 3, (rule,) * 3), Channel(Stream.OPACITY, (1.0,), (rule,))
        occupancies = [12, 3, 1][:depths]
        context = DecodedContext(int(rng.integers(0, 4)), tuple(occupancies))
        self.model = SceneModel(Profile.EXPLICIT, 1, steps, (LayerRow((stages,), ((1, 1),), True),), context)
        self.codes = rng.permutation(random_codes(rng, count, BITS))
        self.classes = rng.integers(0, 5, count)
        self.before = rng.integers(0, stages + 1, count)
        self.before[rng.random(count) < 0.3] = 0
        self.after = np.minimum(self.before + rng.integers(0, stages + 1, count), stages)
        self.values = [spread(rng, (count, c.components), 1 << 20).astype(np.int32) for c in steps]
        self.indices = np.zeros((count, stages), np.int16)
        for stage in range(stages):
            known = self.before > stage
            self.indices[known, stage] = rng.integers(0, books.sizes[stage > 0], int(known.sum()))
        self.data = random_stream(rng, int(rng.choice([0, 1, 40, 2 * count * stages])))

    def _grid(self) -> HashGrid:
        levels = (GridLevel(0, 3, 6, 2), GridLevel(2, 9, 5, 1))
        bits = tuple(self.rng.integers(0, 2, (level.entries, level.features)).astype(np.uint8) for level in levels)
        return HashGrid((0, 0, 0), BITS, levels, bits)

    def context(self, engine: Engine = NUMPY_ENGINE, counters: Counters | None = None) -> LayerContext:
        """With all attribute channels settled."""
        given = self.model, TileFrame(BITS), self.codes, self.classes
        context = LayerContext(*given, counters=counters, operations=engine)
        for channel, values in enumerate(self.values):
            context.settle(channel, values, np.full(self.count, 4))
        return context

    def read(self, engine: Engine) -> Any:
        """All that a layer's reading changes."""
        indices, counters, reader = self.indices.copy(), Counters(), engine.symbol_reader(self.data, {})
        context, stages = self.context(engine, counters), (self.before, self.after)
        engine.get_neural_indices(reader, self.coder, context, indices, stages)
        return indices, reader.modelled, counters, reader.read_uniform(4096, 6)

    def known(self) -> Known:
        """The arrays lent to the compiled library."""
        context = self.context()
        features = np.zeros((self.count, self.inputs.grid), np.int16)
        settled = np.ascontiguousarray(context.settled())
        return Known(self.classes, settled, features, context.by_code, cell_names(context, library()), 1)


def check(case: Case) -> I16:
    """Check that both read the same; returns what they read."""
    compiled, plain = both(case.read)
    assert same(compiled, plain)
    indices: I16 = compiled[0]
    assert (indices[case.indices != 0] == case.indices[case.indices != 0]).all()
    return indices


@settings(deadline=None, max_examples=80)
@given(SEEDS, st.integers(1, 4), st.booleans(), st.integers(1, 4), st.booleans())
@example(0, 8, True, 4, True)
@example(1, 8, False, 4, False)
def test_any_network(seed: int, stages: int, two_level: bool, gru_layers: int, edge: bool) -> None:
    """Networks have both kinds of heads, several recurrent layers, known stages, and accumulators at their limit."""
    check(Case(seed, stages, two_level=two_level, gru_layers=gru_layers, edge=edge))


@settings(deadline=None, max_examples=10)
@given(SEEDS, st.integers(1, 3))
def test_many_anchors(seed: int, stages: int) -> None:
    """Passes of many blocks; large products drive gates and states to the ends of their tables."""
    check(Case(seed, stages, crowd=900, pre_activation=4000))


def test_something_is_read() -> None:
    """The cases above read indices of all kinds, and code some of the anchors of a block only."""
    found = [check(Case(seed, 3)) for seed in range(12)]
    assert len(np.unique(np.concatenate([indices.ravel() for indices in found]))) > 30


@pytest.mark.parametrize("attention", [False, True])
def test_attention_is_left_to_numpy(attention: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything but attention is one call of the library for a tile-layer."""
    calls: list[int] = []

    def counted(*given: Any) -> int:
        calls.append(1)
        return read_indices(*given)

    monkeypatch.setattr(index_layer, "read_indices", counted)
    check(Case(5, 3, attention=attention))
    assert len(calls) == (0 if attention else 1)


def test_packed_networks_have_the_address_of_the_table_that_stays() -> None:
    """One made anew by two threads at once was freed under a network: 1 decode in 130 of four tiles was refused."""
    packed = packed_network(Case(5, 3).coder.evaluator)
    assert packed is not None
    assert packed.struct.exp2 == EXP2_WEIGHTS.ctypes.data


def bad(case: Case, indices: NDArray[Any], **changes: Any) -> Any:
    """The outcome of reading with arrays that do not fit."""
    rans, packed = KernelRansDecoder(library(), b""), packed_network(case.coder.evaluator)
    assert packed is not None
    stages: tuple[I64, I64] = changes.pop("stages", (case.before, case.after))
    known = replace(case.known(), **changes)
    return outcome(lambda: read_indices(rans, packed, known, indices, *stages))


def test_indices_that_are_none_never_index_memory() -> None:
    """Negative ones and those past the codebook are refused before anything is read; more stages than columns too."""
    case = Case(3, 2)
    place = int(np.flatnonzero(case.before > 0)[0])
    for wrong in (-1, case.coder.books.sizes[0], 32767):
        indices = case.indices.copy()
        indices[place, 0] = wrong
        assert bad(case, indices)[:2] == (InvalidInput, "input-stage")
    narrow = np.ascontiguousarray(case.indices[:, :1])
    assert bad(case, narrow)[:2] == (InvalidInput, "input-stage")


def test_arrays_of_another_kind_are_refused() -> None:
    """Memory is never read as what it is not, or past its end."""
    case = Case(3, 2)
    known, indices = case.known(), case.indices
    changes: list[dict[str, Any]] = [
        {"settled": known.settled.astype(np.int64)},
        {"settled": known.settled[:, :3].copy()},
        {"settled": np.asfortranarray(known.settled)},
        {"features": np.zeros((case.count, case.inputs.grid + 1), np.int16)},
        {"classes": case.classes.astype(np.int32)},
        {"classes": case.classes[1:]},
        {"by_code": known.by_code[:-1]},
        {"stages": (case.before[:-1], case.after)},
        {"stages": (case.before, case.after[:-1])},
    ]
    for change in changes:
        with pytest.raises(TypeError):
            bad(case, indices, **change)
    for other in (indices.astype(np.int64), np.asfortranarray(indices)):
        with pytest.raises(TypeError):
            bad(case, other)
