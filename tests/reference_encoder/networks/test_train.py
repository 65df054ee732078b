"""The trained index network: it learns what there is to learn, and the file gets exactly what was trained."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from fuzz.testing.network_rows import first_rows, member_rows
from reference_encoder.networks.clusters import cluster
from reference_encoder.networks.dataset import ContextOptions, IndexRows, index_rows
from reference_encoder.networks.defaults import shape_for, training_for
from reference_encoder.networks.export import export
from reference_encoder.networks.grid import BinaryGrid
from reference_encoder.networks.integers import frequencies, sigmoid12, tanh12
from reference_encoder.networks.layers import Dense, Scale, geometric_bits
from reference_encoder.networks.model import IndexModel
from reference_encoder.networks.shape import NetworkShape
from reference_encoder.networks.train import Examples, Trained, TrainOptions, build, measure, train
from reference_encoder.options import EFFORTS
from scarfmt.arrays import I64
from scarfmt.coding.tile import TileContent, first_values
from scarfmt.container.schema import Profile, Stream
from scarfmt.entropy.rans import RansEncoder
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.grid import GridBox, GridLevel
from scarfmt.neural.network import Inputs
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.model import Channel, ContextRule, LayerRow, SceneModel

SHAPE = NetworkShape(hidden=8, middle=12, mixer=12, codeword_dims=6)
QUICK = TrainOptions(epochs=6, batch=64, learning_rate=0.04, patience=0.0)


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Threads only get in each other's way at this size."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _books(coarse: int = 8, residual: int = 8, seed: int = 0) -> Codebooks:
    draw = np.random.default_rng(seed)
    words = [np.rint(draw.normal(size=(n, 6)) * 60).astype(np.int64) for n in (coarse, residual)]
    words[0][0] = words[1][0] = 0
    return Codebooks(words[0], words[1])


def _rows(inputs: NDArray[Any], codes: I64) -> IndexRows:
    """Rows that code all stages at once."""
    n, stages = codes.shape
    zeros = np.zeros(n, np.int64)
    places = np.zeros((n, 2), np.int64)
    after = np.full(n, stages)
    return IndexRows(inputs.astype(np.int16), zeros, zeros, after, codes.astype(np.int16), places, n, n * stages)


def _train(rows: IndexRows, books: Codebooks, options: TrainOptions = QUICK, **more: Any) -> Trained:
    return train(rows, books, ((), ()), SHAPE, options, **more)


def _bits(trained: Trained, rows: IndexRows, exact: bool = True) -> NDArray[np.float64]:
    return measure(trained.model, Examples(rows), exact) / len(rows)


def test_the_network_does_not_depend_on_the_number_of_threads() -> None:
    """Batches are large enough here for torch to share them out."""
    draw = np.random.default_rng(7)
    rows, found = _rows(draw.integers(-200, 200, (8192, 40)), draw.integers(0, 8, (8192, 2))), []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        trained = _train(rows, _books(), replace(QUICK, epochs=1, batch=4096))
        found.append([parameter.detach() for parameter in trained.model.parameters()])
        assert torch.get_num_threads() == threads
    assert all(torch.equal(one, two) for one, two in zip(*found, strict=True))


def test_an_index_that_the_class_decides_is_learnt() -> None:
    """3 bits without knowledge of the class."""
    draw = np.random.default_rng(1)
    classes = draw.integers(0, 8, 1000)
    rows = _rows(np.eye(8)[classes] * 64, (7 - classes)[:, None])
    assert _bits(_train(rows, _books()), rows)[0] < 0.5


def test_an_index_that_the_one_before_decides_is_learnt() -> None:
    draw = np.random.default_rng(2)
    first = draw.integers(0, 8, 1000)
    rows = _rows(np.zeros((1000, 2)), np.stack([first, (3 * first + 1) % 8], axis=1))
    bits = _bits(_train(rows, _books()), rows)
    assert bits[0] > 2.9
    assert bits[1] < 1.0


def test_a_third_index_remembers_the_first() -> None:
    """Through the state of the recurrent layer, past a second index that says nothing."""
    draw = np.random.default_rng(3)
    codes = draw.integers(0, 4, (1000, 3))
    codes[:, 2] = codes[:, 0]
    rows = _rows(np.zeros((1000, 2)), codes)
    trained = _train(rows, _books(4, 4), replace(QUICK, epochs=10))
    assert _bits(trained, rows)[2] < 1.0


def test_an_index_that_neighbours_decide_is_learnt() -> None:
    """Eight regions of one codeword each: an anchor of a later pass sees it around itself, a first one does not."""
    draw, count, books = np.random.default_rng(4), 1600, _books()
    rule = ContextRule()
    model = SceneModel(
        Profile.EXPLICIT, 1, (Channel(Stream.SCALE, (1.0, 1.0, 1.0), (rule, rule, rule)),), (LayerRow((1,), ((1,),)),)
    )
    content = TileContent.empty(model, count)
    content.codes = np.sort(draw.choice(1 << 18, count, replace=False)).astype(np.uint64)
    content.indices[:, 0] = (content.codes >> np.uint64(15)).astype(np.int16)
    content.first = first_values(model, content)
    rows = index_rows(model, [content], [6], books, ContextOptions(3, (16, 4), latents=6))
    bits = _bits(_train(rows, books), rows)[0]
    assert bits < 3 / 8 + 0.6


def test_learnt_grid_bits_tell_places_apart() -> None:
    """Regions that no other input distinguishes are distinguished by a hash grid that is trained with the network."""
    draw, books = np.random.default_rng(5), _books()
    at = draw.integers(0, 64, (3000, 3))
    rows = _rows(np.zeros((3000, 1)), (at // 32 @ np.array([1, 2, 4]))[:, None])
    grid = BinaryGrid(GridBox((0, 0, 0), 6), (GridLevel(0, 8, 10, 2),), seed=1)
    lookup = grid.lookup(at)
    trained = _train(rows, books, replace(QUICK, epochs=12), grid=grid, lookup=lookup)
    bits = measure(trained.model, Examples(rows, grid, lookup)) / len(rows)
    assert bits[0] < 2.2


def test_where_there_is_nothing_to_learn_nothing_is_lost() -> None:
    draw = np.random.default_rng(6)
    codes = draw.choice(8, (1500, 2), p=[0.3, 0.2, 0.1, 0.1, 0.1, 0.1, 0.05, 0.05])
    rows = _rows(draw.normal(size=(1500, 4)) * 40, codes)
    shares = [np.bincount(column, minlength=8) / 1500 for column in codes.T]
    entropy = sum(float(-(p * np.log2(p)).sum()) for p in shares)
    assert _bits(_train(rows, _books()), rows).sum() < 1.015 * entropy


def test_integers_do_about_as_well_as_the_float_model() -> None:
    draw = np.random.default_rng(7)
    classes = draw.integers(0, 4, 1000)
    codes = (2 * classes + draw.integers(0, 2, 1000))[:, None]
    rows = _rows(np.eye(4)[classes] * 64, codes)
    options = replace(QUICK, epochs=12, weight_rate=0.0)
    integer, smooth = (
        _bits(_train(rows, _books(), replace(options, quantised=exact)), rows, exact)[0] for exact in (True, False)
    )
    assert integer < 1.03 * smooth + 0.01


def test_equal_seeds_give_equal_networks() -> None:
    rows = _rows(np.random.default_rng(8).normal(size=(600, 3)) * 40, np.arange(1200).reshape(600, 2) % 8)
    options = replace(QUICK, epochs=2)
    first, second, other = (_train(rows, _books(), replace(options, seed=seed)).model for seed in (1, 1, 2))
    same = [torch.equal(a, b) for a, b in zip(first.parameters(), second.parameters(), strict=True)]
    assert all(same)
    assert not all(torch.equal(a, b) for a, b in zip(first.parameters(), other.parameters(), strict=True))


def test_training_goes_on_from_a_network_given() -> None:
    classes = np.random.default_rng(9).integers(0, 8, 1000)
    rows = _rows(np.eye(8)[classes] * 64, classes[:, None])
    cold = _train(rows, _books(), replace(QUICK, epochs=4))
    warm = _train(rows, _books(), replace(QUICK, epochs=1), start=cold.model)
    assert warm.history[0] < cold.history[1]


def test_training_ends_when_it_no_longer_pays() -> None:
    rows = _rows(np.zeros((500, 2)), np.zeros((500, 1), np.int64))
    told: list[float] = []
    trained = _train(rows, _books(), replace(QUICK, epochs=12, patience=1e9), report=told.append)
    assert len(trained.history) < 12
    assert told[-1] == 1.0
    assert told == sorted(told)


VARIANTS = [
    SHAPE,
    replace(SHAPE, attention=True, activation_bits=8),
    replace(SHAPE, gru_layers=2, attention=True, weight_bits=10, weight_limit=2000, activation_bits=11),
]


def _exported(shape: NetworkShape, two_level: bool) -> tuple[IndexModel, Evaluator, IndexRows]:
    """A model trained for a moment, and the evaluator of what the file would hold."""
    draw, books = np.random.default_rng(10), _books(50, 60)
    sizes: Sequence[Sequence[int]] = ((), ())
    if two_level:
        found = [cluster(words, np.ones(len(words), np.int64)) for words in (books.coarse, books.residual)]
        books, sizes = Codebooks(books.coarse[found[0].order], books.residual[found[1].order]), [c.sizes for c in found]
    rows = _rows(draw.normal(size=(700, 10)) * 90, draw.integers(0, 50, (700, 3)))
    model = train(rows, books, sizes, shape, replace(QUICK, epochs=2)).model
    inputs = Inputs(classes=1, own=True, attributes=3, depths=1, latents=2, latent_shift=0, grid=0)
    return model, Evaluator(export(model, inputs, books), books), rows


@pytest.mark.parametrize("two_level", [False, True])
@pytest.mark.parametrize("shape", VARIANTS, ids=["plain", "attention", "deep"])
def test_the_file_codes_with_the_very_frequencies_of_training(shape: NetworkShape, two_level: bool) -> None:
    """Bit for bit, at every stage, for codewords, clusters and members."""
    model, evaluator, rows = _exported(shape, two_level)
    batch = Examples(rows).batch(torch.arange(len(rows)))
    h, state = evaluator.embed(rows.inputs), evaluator.start(len(rows))
    with torch.no_grad():
        embedded = model.embed(batch.inputs, True)
        for stage in range(1, 4):
            book, y = min(stage - 1, 1), evaluator.mixed(h, state)
            mine = model.context(embedded, model.histories(batch.codes, True, stage - 1), True)
            head = model.head(book)
            first = frequencies(head.logits(mine, True, True)).numpy()
            theirs = first_rows(evaluator, book, y)
            np.testing.assert_array_equal(first, theirs + 1)
            for number, size in enumerate(head.sizes):
                logits = head.member_logits(mine, torch.full((len(rows),), number), True, True)[:, :size]
                np.testing.assert_array_equal(frequencies(logits).numpy(), member_rows(evaluator, book, y, number) + 1)
            if stage < 3:
                state = evaluator.advance(state, stage, rows.codes[:, stage - 1].astype(np.int64))


def _sharp(model: IndexModel) -> None:
    """Make attention choose: barely trained, its scores are near 0 and every state has the same share."""
    assert model.attention is not None
    for dense in (model.attention.query, model.attention.key, model.attention.value):
        dense.theta.data *= 6


def _attention_case(exact: bool) -> tuple[torch.Tensor, torch.Tensor]:
    """(n, H) embeddings, and what attention makes of them given the same states for all."""
    rows = _rows(np.random.default_rng(13).normal(size=(64, 10)) * 90, np.full((64, 3), 5))
    model = build(rows, _books(), ((), ()), replace(SHAPE, attention=True), 0)
    _sharp(model)
    assert model.attention is not None
    batch = Examples(rows).batch(torch.arange(len(rows)))
    h = model.embed(batch.inputs, exact)
    return h, model.attention(h, model.histories(batch.codes, exact, 2), exact)


@pytest.mark.parametrize("exact", [True, False])
def test_the_query_of_attention_is_the_spatial_embedding(exact: bool) -> None:
    """With the same history, places far apart weigh the states differently, and a gradient says how."""
    h, context = _attention_case(exact)
    (slope,) = torch.autograd.grad(context.sum(), h)
    context = context.detach()
    assert float((context.std(0) / context.abs().mean().clamp_min(1e-9)).max()) > 0.1
    assert int((slope.abs().sum(1) > 0).sum()) > len(h) // 2


def test_attention_codes_with_the_very_frequencies_of_training() -> None:
    """Bit for bit with what the file would hold, where the query decides: shares of states are not all alike."""
    draw, books = np.random.default_rng(14), _books(8, 8)
    rows = _rows(draw.normal(size=(200, 10)) * 90, draw.integers(0, 8, (200, 3)))
    model = build(rows, books, ((), ()), replace(SHAPE, attention=True, weight_limit=2000), 0)
    _sharp(model)
    inputs = Inputs(classes=1, own=True, attributes=3, depths=1, latents=2, latent_shift=0, grid=0)
    evaluator = Evaluator(export(model, inputs, books), books)
    batch = Examples(rows).batch(torch.arange(len(rows)))
    h, state = evaluator.embed(rows.inputs), evaluator.start(len(rows))
    for stage in (1, 2):
        state = evaluator.advance(state, stage, rows.codes[:, stage - 1].astype(np.int64))
    with torch.no_grad():
        embedded, states = model.embed(batch.inputs, True), model.histories(batch.codes, True, 2)
        mine = model.context(embedded, states, True)
        forgetful = model.context(embedded, states[:1] * 3, True)
    np.testing.assert_array_equal(mine.numpy(), evaluator.mixed(h, state))
    assert not torch.equal(mine, forgetful)


def test_training_teaches_attention_what_to_ask() -> None:
    """The query's weights move: the loss reaches them through the shares."""
    draw = np.random.default_rng(15)
    rows = _rows(draw.normal(size=(400, 4)) * 60, draw.integers(0, 8, (400, 3)))
    shape = replace(SHAPE, attention=True)
    before = build(rows, _books(), ((), ()), shape, QUICK.seed)
    trained = train(rows, _books(), ((), ()), shape, replace(QUICK, epochs=1, weight_rate=0.0)).model
    assert before.attention is not None
    assert trained.attention is not None
    assert not torch.equal(before.attention.query.theta, trained.attention.query.theta)


@pytest.mark.parametrize("two_level", [False, True])
def test_trained_bits_are_those_of_the_integer_frequencies(two_level: bool) -> None:
    model, _, rows = _exported(SHAPE, two_level)
    smooth, strict = (measure(model, Examples(rows), strict=flag) for flag in (False, True))
    np.testing.assert_allclose(smooth, strict, rtol=2e-3)


def test_coded_bytes_are_those_estimated() -> None:
    model, evaluator, rows = _exported(SHAPE, False)
    y = evaluator.mixed(evaluator.embed(rows.inputs), evaluator.start(len(rows)))
    encoder = RansEncoder()
    encoder.encode_rows(rows.codes[:, 0].astype(np.int64), first_rows(evaluator, 0, y))
    estimate = measure(model, Examples(rows))[0] / 8
    assert estimate - 1 < len(encoder.finish()) < 1.005 * estimate + 16


def test_weights_that_could_break_exactness_are_shrunk() -> None:
    shape = NetworkShape(activation_bits=12, weight_bits=12, weight_limit=32767)
    dense = Dense(Scale.hidden(shape, 64), 8, 32.0, shape, torch.Generator().manual_seed(1))
    dense.theta.data *= 1000
    weights, biases = (values.detach() for values in dense.integers(True))
    assert float((weights.abs().sum(1) * shape.top + biases.abs()).max()) + 2**dense.shift < 1 << 24


def test_inputs_far_apart_in_size_give_weights_of_like_size() -> None:
    """A column of large numbers would else need weights below the step of the integers."""
    draw = np.random.default_rng(11)
    x = np.stack([draw.normal(size=500) * 200, draw.normal(size=500) * 8 + 100], axis=1)
    model = build(_rows(x, np.zeros((500, 1), np.int64)), _books(), ((), ()), SHAPE, 0)
    spread = model.first.sums(torch.tensor(x, dtype=torch.float32), True).std(0).detach()
    assert bool(torch.isfinite(spread).all())
    gain = model.first.gain
    assert 15 < float(gain[1] / gain[0]) < 35


def test_gradients_of_tables_are_those_of_their_functions() -> None:
    for table, exact_slope in ((tanh12, 2047 / 32 * (1 - np.tanh(0.5) ** 2)), (sigmoid12, 4096 / 32 * 0.2350)):
        x = torch.tensor([16.0], requires_grad=True)
        table(x, True).sum().backward()  # type: ignore[no-untyped-call]
        assert x.grad is not None
        assert float(x.grad[0]) == pytest.approx(exact_slope, rel=0.01)


def test_weight_cost_is_near_the_entropy_of_the_weights() -> None:
    draw = np.random.default_rng(12)
    for scale in (0.3, 2.0, 20.0):
        values = np.rint(draw.laplace(size=20000) * scale)
        shares = np.unique(values, return_counts=True)[1] / len(values)
        entropy = float(-(shares * np.log2(shares)).sum())
        cost = float(geometric_bits([torch.tensor(values, dtype=torch.float32)])) / len(values)
        assert cost == pytest.approx(entropy, rel=0.05)
    assert float(geometric_bits([torch.zeros(100)])) < 1


def test_larger_scenes_get_wider_networks_and_bounded_training() -> None:
    widths = [shape_for(indices, 40).hidden for indices in (0, 75_000, 300_000, 1_000_000, 10**8)]
    assert widths == sorted(widths)
    assert widths[1] == 8
    assert shape_for(10**6, 12).codeword_dims == 12
    for effort, budget in ((number, level.training) for number, level in EFFORTS.items()):
        assert training_for(budget.rows, effort, 0).epochs * budget.rows <= 1.05 * budget.visits
        assert training_for(100, effort, 0).epochs == budget.most_epochs
