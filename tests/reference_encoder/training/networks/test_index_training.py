"""The trained index network: it learns what there is to learn, and the file gets exactly what was trained."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from fuzz.testing.network_rows import frequency_rows
from fuzz.testing.scenes import random_scene
from reference_encoder.training.networks.dataset import IndexRows, index_rows
from reference_encoder.training.networks.grid import BinaryGrid
from reference_encoder.training.networks.head import HeadModel
from reference_encoder.training.networks.index_training import Examples, build, last_epochs, measure, train
from reference_encoder.training.networks.layers import (
    TOP,
    TOTAL,
    Dense,
    NetworkShape,
    exp2_weights,
    geometric_bits,
    hidden_scale,
    round_shift,
    shape_for,
    sigmoid12,
    tanh12,
)
from reference_encoder.training.networks.model import IndexModel, export_network
from reference_encoder.tuning import INDEX_ROWS, INDEX_VISITS, MOST_INDEX_EPOCHS
from scarfmt.arrays import I64
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import Tile
from scarfmt.container.schema import Profile, Stream
from scarfmt.entropy.rans import RansEncoder
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.grid import GridBox, GridLevel
from scarfmt.neural.network import Inputs
from scarfmt.scene.model import Channel, Codebooks, DecodedContext, LayerRow, SceneModel

SHAPE = NetworkShape(hidden=8, codeword_dims=6)
INPUTS = Inputs(classes=1, own=True, attributes=3, depths=1, latents=2, latent_shift=0, grid=0)


def _books(coarse: int = 8, residual: int = 8, seed: int = 0) -> Codebooks:
    draw = np.random.default_rng(seed)
    words = [np.rint(draw.normal(size=(n, 6)) * 60).astype(np.int64) for n in (coarse, residual)]
    words[0][0] = words[1][0] = 0
    return Codebooks(words[0], words[1])


def _rows(inputs: NDArray[Any], codes: I64, positions: I64 | None = None) -> IndexRows:
    """Rows that code all stages at once."""
    n, stages = codes.shape
    places = np.zeros((n, 3), np.int64) if positions is None else positions
    after = np.full(n, stages)
    return IndexRows(inputs.astype(np.int16), 0 * after, after, codes.astype(np.int16), places, n * stages)


def _train(rows: IndexRows, books: Codebooks, epochs: int = 6, grid: BinaryGrid | None = None) -> NDArray[np.float64]:
    """(M,) bits a row of each stage, after a training."""
    features = 0 if grid is None else sum(level.features for level in grid.levels)
    model, examples = build(rows, books, SHAPE, 0, features), Examples(rows, grid)
    train(model, examples, epochs, 64, 0, 0.04)
    return measure(model, examples) / len(rows)


def _frequencies(logits: torch.Tensor) -> NDArray[np.int64]:
    """(n, k) integer frequencies of integer (n, k) logits (SPEC §10.5)."""
    weights = exp2_weights(logits.max(1, keepdim=True).values - logits).numpy()
    sums, count = np.cumsum(weights, 1), logits.shape[1]
    return np.diff(sums * (TOTAL - count) // sums[:, -1:] + np.arange(1, count + 1), axis=1, prepend=0)


def _rows_of(head: HeadModel, y: torch.Tensor) -> NDArray[np.int64]:
    """(n, k) frequencies that training means for the codewords."""
    sums = torch.addmm(head.biases(), head.project(y, -TOP, TOP), head.words / head.scale)
    return _frequencies(round_shift(sums, head.shift))


def test_the_network_does_not_depend_on_the_number_of_threads() -> None:
    """Batches are large enough here for torch to share them out."""
    draw = np.random.default_rng(7)
    rows, found = _rows(draw.integers(-200, 200, (8192, 40)), draw.integers(0, 8, (8192, 2))), []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        model = build(rows, _books(), SHAPE, 0)
        train(model, Examples(rows), 1, 4096, 0)
        found.append([parameter.detach() for parameter in model.parameters()])
        assert torch.get_num_threads() == threads
    assert all(torch.equal(one, two) for one, two in zip(*found, strict=True))


def test_an_index_that_the_class_decides_is_learnt() -> None:
    """3 bits without knowledge of the class."""
    classes = np.random.default_rng(1).integers(0, 8, 1000)
    assert _train(_rows(np.eye(8)[classes] * 64, (7 - classes)[:, None]), _books())[0] < 0.5


def test_an_index_that_the_one_before_decides_is_learnt() -> None:
    first = np.random.default_rng(2).integers(0, 8, 1000)
    bits = _train(_rows(np.zeros((1000, 2)), np.stack([first, (3 * first + 1) % 8], axis=1)), _books())
    assert bits[0] > 2.9
    assert bits[1] < 1.0


def test_a_third_index_remembers_the_first() -> None:
    """Through the state of the recurrent layer, past a second index that says nothing."""
    codes = np.random.default_rng(3).integers(0, 4, (1000, 3))
    codes[:, 2] = codes[:, 0]
    assert _train(_rows(np.zeros((1000, 2)), codes), _books(4, 4), 10)[2] < 1.0


def test_an_index_that_neighbours_decide_is_learnt() -> None:
    """Eight regions of one codeword each: an anchor of a later pass sees it around itself, a first one does not."""
    draw, count, books = np.random.default_rng(4), 1600, _books()
    channels, layers = (Channel(Stream.SCALE, (1.0, 1.0, 1.0)),), (LayerRow((1,), ((1,),)),)
    model = SceneModel(Profile.EXPLICIT, 1, channels, layers, DecodedContext(3, (16, 4)))
    content = TileContent.empty(model, count)
    content.codes = np.sort(draw.choice(1 << 18, count, replace=False)).astype(np.uint64)
    content.indices[:, 0] = (content.codes >> np.uint64(15)).astype(np.int16)
    fields = replace(random_scene(0, Profile.EXPLICIT, anchors=2).fields, lattice_bits=6)
    scene = QuantisedScene(fields, model, (Tile(0, 0, 0),), (content,), codebooks=books)
    assert _train(index_rows(scene, True, 6), books)[0] < 3 / 8 + 0.6


def test_learnt_grid_bits_tell_places_apart() -> None:
    """Regions that no other input distinguishes are distinguished by a hash grid that is trained with the network."""
    at = np.random.default_rng(5).integers(0, 64, (3000, 3))
    rows = _rows(np.zeros((3000, 1)), (at // 32 @ np.array([1, 2, 4]))[:, None], at)
    grid = BinaryGrid(GridBox((0, 0, 0), 6), (GridLevel(0, 8, 10, 2),), seed=1)
    assert _train(rows, _books(), 12, grid)[0] < 2.2


def test_where_there_is_nothing_to_learn_nothing_is_lost() -> None:
    draw = np.random.default_rng(6)
    codes = draw.choice(8, (1500, 2), p=[0.3, 0.2, 0.1, 0.1, 0.1, 0.1, 0.05, 0.05])
    shares = [np.bincount(column, minlength=8) / 1500 for column in codes.T]
    entropy = sum(float(-(p * np.log2(p)).sum()) for p in shares)
    assert _train(_rows(draw.normal(size=(1500, 4)) * 40, codes), _books()).sum() < 1.015 * entropy


def test_training_ends_when_it_no_longer_pays() -> None:
    rows = _rows(np.zeros((500, 2)), np.zeros((500, 1), np.int64))
    assert len(train(build(rows, _books(), SHAPE, 0), Examples(rows), 40, 64, 0)) < 40


VARIANTS = [SHAPE, replace(SHAPE, attention=True), replace(SHAPE, gru_layers=2, attention=True, weight_bits=7)]


def _exported(shape: NetworkShape) -> tuple[IndexModel, Evaluator, IndexRows]:
    """A model trained for a moment, and the evaluator of what the file would hold."""
    draw, books = np.random.default_rng(10), _books(50, 60)
    rows = _rows(draw.normal(size=(700, 10)) * 90, draw.integers(0, 50, (700, 3)))
    model = build(rows, books, shape, 0)
    train(model, Examples(rows), 2, 64, 0, 0.04)
    return model, Evaluator(export_network(model, INPUTS, books), books), rows


@pytest.mark.parametrize("shape", VARIANTS, ids=["plain", "attention", "deep"])
def test_the_file_codes_with_the_very_frequencies_of_training(shape: NetworkShape) -> None:
    """Bit for bit, at every stage."""
    model, evaluator, rows = _exported(shape)
    inputs, _, _, codes = Examples(rows).batch(torch.arange(len(rows)))
    h, state = evaluator.embed(rows.inputs), evaluator.start(len(rows))
    with torch.no_grad():
        embedded = model.embed(inputs)
        for stage in range(1, 4):
            book, y = min(stage - 1, 1), evaluator.mix(h, state)
            mine = model.context(embedded, model.histories(codes, stage - 1))
            expected = frequency_rows(evaluator, book, y) + 1
            np.testing.assert_array_equal(_rows_of(model.head[book], mine), expected)
            if stage < 3:
                state = evaluator.advance(state, stage, rows.codes[:, stage - 1].astype(np.int64))


def test_attention_codes_with_the_very_frequencies_of_training() -> None:
    """Bit for bit with what the file would hold, where the query decides: shares of states are not all alike."""
    draw, books = np.random.default_rng(14), _books(8, 8)
    rows = _rows(draw.normal(size=(200, 10)) * 90, draw.integers(0, 8, (200, 3)))
    model = build(rows, books, replace(SHAPE, attention=True), 0)
    assert model.attention is not None
    for dense in (model.attention.query, model.attention.key, model.attention.value):
        dense.theta.data *= 6  # barely trained, scores are near 0 and every state has the same share
    evaluator = Evaluator(export_network(model, INPUTS, books), books)
    inputs, _, _, codes = Examples(rows).batch(torch.arange(len(rows)))
    h, state = evaluator.embed(rows.inputs), evaluator.start(len(rows))
    for stage in (1, 2):
        state = evaluator.advance(state, stage, rows.codes[:, stage - 1].astype(np.int64))
    with torch.no_grad():
        embedded, states = model.embed(inputs), model.histories(codes, 2)
        mine = model.context(embedded, states)
        forgetful = model.context(embedded, states[:1] * 3)
    np.testing.assert_array_equal(mine.numpy(), evaluator.mix(h, state))
    assert not torch.equal(mine, forgetful)


def test_training_teaches_attention_what_to_ask() -> None:
    """The query's weights move: the loss reaches them through the shares."""
    draw = np.random.default_rng(15)
    rows = _rows(draw.normal(size=(400, 4)) * 60, draw.integers(0, 8, (400, 3)))
    model = build(rows, _books(), replace(SHAPE, attention=True), 0)
    assert model.attention is not None
    before = model.attention.query.theta.detach().clone()
    train(model, Examples(rows), 1, 64, 0)
    assert not torch.equal(before, model.attention.query.theta)


def test_coded_bytes_are_those_estimated() -> None:
    model, evaluator, rows = _exported(SHAPE)
    y = evaluator.mix(evaluator.embed(rows.inputs), evaluator.start(len(rows)))
    encoder = RansEncoder()
    encoder.encode_rows(rows.codes[:, 0].astype(np.int64), frequency_rows(evaluator, 0, y))
    estimate = measure(model, Examples(rows))[0] / 8
    assert estimate - 1 < len(encoder.finish()) < 1.005 * estimate + 16


def test_weights_that_could_break_exactness_are_shrunk() -> None:
    dense = Dense(hidden_scale(512), 8, 32.0, 12, torch.Generator().manual_seed(1))
    dense.theta.data *= 1000
    weights, biases = (values.detach() for values in dense.integers())
    assert float((weights.abs().sum(1) * TOP + biases.abs()).max()) + 2**dense.shift < 1 << 24


def test_gradients_of_tables_are_those_of_their_functions() -> None:
    for table, exact_slope in ((tanh12, 2047 / 32 * (1 - np.tanh(0.5) ** 2)), (sigmoid12, 4096 / 32 * 0.2350)):
        x = torch.tensor([16.0], requires_grad=True)
        table(x).sum().backward()  # type: ignore[no-untyped-call]
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
    assert last_epochs(INDEX_ROWS)[0] * INDEX_ROWS <= 1.05 * INDEX_VISITS
    assert last_epochs(100)[0] == MOST_INDEX_EPOCHS
