"""Context models of the ablation: each sees what its name says and nothing else, and they are honest coders."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from benchmarks.entropy_variants import BranchedMlp, GruOnly, StageMlp, build_variant
from reference_encoder.networks.dataset import IndexRows
from reference_encoder.networks.model import Batch, IndexModel
from reference_encoder.networks.shape import NetworkShape
from reference_encoder.networks.train import Examples, TrainOptions, measure, train
from scarfmt.arrays import I64
from scarfmt.scene.codebooks import Codebooks

KINDS: tuple[type[IndexModel], ...] = (StageMlp, BranchedMlp, GruOnly)
SHAPE = NetworkShape(hidden=8, middle=12, mixer=12, codeword_dims=6)
STAGES, CODES = 3, 8


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Threads only get in each other's way at this size."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _books() -> Codebooks:
    draw = np.random.default_rng(0)
    words = [np.rint(draw.normal(size=(CODES, 6)) * 60).astype(np.int64) for _ in range(2)]
    return Codebooks(words[0], words[1])


def _rows(inputs: NDArray[Any], codes: I64) -> IndexRows:
    n, stages = codes.shape
    zeros, after = np.zeros(n, np.int64), np.full(n, stages)
    places = np.zeros((n, 2), np.int64)
    return IndexRows(inputs.astype(np.int16), zeros, zeros, after, codes.astype(np.int16), places, n, n * stages)


def _model(kind: type[IndexModel]) -> IndexModel:
    draw = np.random.default_rng(1)
    rows = _rows(draw.integers(-200, 200, (64, 4)), draw.integers(0, CODES, (64, STAGES)))
    return build_variant(kind, rows, _books(), [(), ()], SHAPE, 0)


def _bits(model: IndexModel, inputs: Any, codes: Any, exact: bool = True) -> list[torch.Tensor]:
    n = len(codes)
    batch = Batch(torch.tensor(inputs).float(), torch.zeros(n), torch.full((n,), STAGES), torch.tensor(codes))
    with torch.no_grad():
        return model.bits(batch, exact)


def _depends(kind: type[IndexModel], inputs: Any, codes: Any, other_inputs: Any, other_codes: Any) -> list[bool]:
    """Per stage, whether the bits of the last stage's and other codes differ between two situations."""
    model = _model(kind)
    first, second = _bits(model, inputs, codes), _bits(model, other_inputs, other_codes)
    return [not torch.equal(a, b) for a, b in zip(first, second, strict=True)]


NEAR, FAR = [[150, -90, 20, 60]], [[-150, 120, -200, 10]]


def test_the_mlp_knows_nothing_of_earlier_codes() -> None:
    assert _depends(StageMlp, NEAR, [[1, 2, 3]], NEAR, [[5, 2, 3]])[1:] == [False, False]
    assert all(_depends(StageMlp, NEAR, [[1, 2, 3]], FAR, [[1, 2, 3]]))


def test_the_mlp_tells_stages_apart() -> None:
    bits = _bits(_model(StageMlp), NEAR, [[1, 3, 3]])
    assert not torch.equal(bits[1], bits[2])


def test_the_branched_mlp_sees_both_place_and_earlier_codes_but_no_later_one() -> None:
    assert _depends(BranchedMlp, NEAR, [[1, 2, 3]], NEAR, [[5, 2, 3]]) == [True, True, True]
    assert _depends(BranchedMlp, NEAR, [[1, 2, 3]], NEAR, [[1, 4, 3]])[2]
    assert _depends(BranchedMlp, NEAR, [[1, 2, 3]], NEAR, [[1, 2, 5]])[:2] == [False, False]
    assert all(_depends(BranchedMlp, NEAR, [[1, 2, 3]], FAR, [[1, 2, 3]]))


def test_the_logits_of_the_branches_add_up() -> None:
    model = _model(BranchedMlp)
    head, half = model.head(1), SHAPE.mixer // 2
    y = torch.rand(5, SHAPE.mixer) * 100
    spatial, earlier = y.clone(), y.clone()
    spatial[:, half:] = 0
    earlier[:, :half] = 0
    with torch.no_grad():
        none = head.logits(torch.zeros_like(y), False)
        both = head.logits(spatial, False) + head.logits(earlier, False) - none
        assert torch.allclose(head.logits(y, False), both, atol=1e-3)


def test_the_gru_alone_knows_nothing_of_the_place_and_pays_nothing_for_it() -> None:
    assert not any(_depends(GruOnly, NEAR, [[1, 2, 3]], FAR, [[1, 2, 3]]))
    assert _depends(GruOnly, NEAR, [[1, 2, 3]], NEAR, [[5, 2, 3]])[1:] == [True, True]
    model = _model(GruOnly)
    before = float(model.weight_bits().detach())
    wide = _rows(np.zeros((64, 40), np.int64), np.zeros((64, STAGES), np.int64))
    other = build_variant(GruOnly, wide, _books(), [(), ()], SHAPE, 0)
    assert abs(float(other.weight_bits().detach()) - before) < 0.1 * before


@pytest.mark.parametrize("kind", KINDS)
def test_probabilities_of_a_stage_add_up_to_one(kind: type[IndexModel]) -> None:
    """A model that knows more than the decoder would code every symbol in too few bits."""
    model = _model(kind)
    for stage in range(STAGES):
        codes = np.tile([[1, 2, 3]], (CODES, 1))
        codes[:, stage] = np.arange(CODES)
        bits = _bits(model, NEAR * CODES, codes)[stage]
        assert float(torch.exp2(-bits).sum()) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_training_learns_what_the_kind_can_see(kind: type[IndexModel]) -> None:
    """Stage 1 follows the place, stage 2 repeats stage 1: three bits each for who sees neither."""
    draw = np.random.default_rng(2)
    first = draw.integers(0, 4, 512)
    codes = np.stack([first, first, draw.integers(0, CODES, 512)], axis=1)
    rows = _rows(first[:, None] * 120 - 180 + draw.integers(-9, 9, (512, 2)), codes)
    model = build_variant(kind, rows, _books(), [(), ()], SHAPE, 0)
    options = TrainOptions(epochs=14, batch=32, learning_rate=0.04, patience=0.0)
    trained = train(rows, _books(), [(), ()], SHAPE, options, start=model)
    one, two, three = measure(trained.model, Examples(rows)) / len(rows)
    assert (one < 1.0) == (kind is not GruOnly)
    assert two < 1.0
    assert three > 2.8
