"""Predictors trained on some tiles of all ranges make the ranges smaller, and change nothing that they hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_decoder.decode import decode
from reference_encoder.networks import predict
from reference_encoder.options import EFFORTS, PredictorTraining
from reference_encoder.scale.coded import code, histograms, reduce
from reference_encoder.scale.steps import RangeContent
from reference_encoder.scale.trained import some_tiles, train
from reference_encoder.tuning import CONTEXT
from scarfmt.coding.writer import write_scene
from scarfmt.engines import best_engine
from tests.reference_encoder.scale.chain import OPTIONS, Chain, encoded, example

pytest.importorskip("torch")
SIZE = 1200


def trained() -> Chain:
    """The example with predictors that were hardly trained."""
    chain = encoded(SIZE)
    overview = replace(chain.overview, options=replace(OPTIONS, effort=2, archive=True))
    tiles = [some_tiles(overview, part, each) for (part, _), each in zip(chain.ranges, chain.contents, strict=True)]
    fit = train(overview, chain.fit, tiles, sum(len(content) for content in chain.whole.contents))
    counted = [histograms(fit, content) for content in chain.contents]
    models = reduce(overview, fit, [found for found, _ in counted])
    return replace(chain, fit=fit, models=models, segments=[code(models, symbols) for _, symbols in counted])


def size(chain: Chain) -> int:
    """Bytes of all blocks."""
    parts = sum(len(layer.payload) for segment in chain.segments for layer in segment.layers)
    return parts + sum(len(block.payload) for block in chain.models.blocks)


def test_predictors_pay_and_keep_all_integers(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = replace(EFFORTS[2], predictors=PredictorTraining(units=4, iterations=60))
    monkeypatch.setitem(predict.EFFORTS, 2, quick)
    plain, chain = encoded(SIZE), trained()
    assert chain.fit.predictors
    assert chain.fit.model.context == CONTEXT
    assert size(chain) < size(plain)
    found, expected = (
        decode(write_scene(each.fit.scene(each.whole), engine=best_engine())).scene for each in (chain, plain)
    )
    assert np.array_equal(found.positions, expected.positions)
    assert np.array_equal(found.sh, expected.sh)


def test_without_networks_a_fit_stays_as_it_is() -> None:
    chain = encoded(SIZE)
    assert train(chain.overview, chain.fit, [chain.whole], len(example())) is chain.fit
    overview = replace(chain.overview, options=replace(OPTIONS, effort=2))
    assert train(overview, chain.fit, [RangeContent((), ())], len(example())) is chain.fit
