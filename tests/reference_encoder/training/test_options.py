"""Options of training: refused before any work, and settled to one way of ending."""

from __future__ import annotations

from typing import Any

import pytest

from reference_encoder.training.options import DEFAULT_MINUTES, PAPER_ITERATIONS, TrainOptions
from tests.samples.codec_samples import refuses


@pytest.mark.parametrize(
    ("said", "field"),
    [
        ({"minutes": 1.0, "iterations": 5}, "minutes"),
        ({"minutes": 0.0}, "minutes"),
        ({"minutes": float("nan")}, "minutes"),
        ({"minutes": float("inf")}, "minutes"),
        ({"iterations": 0}, "iterations"),
        ({"layers": 0}, "layers"),
        ({"layers": 17}, "layers"),
        ({"last_layer": 0.9}, "last_layer"),
        ({"last_layer": float("nan")}, "last_layer"),
        ({"lambda_": 0.0}, "lambda_"),
        ({"lambda_": float("nan")}, "lambda_"),
        ({"seed": -1}, "seed"),
        ({"preset": "best"}, "preset"),
        ({"device": "tpu"}, "device"),
    ],
)
def test_what_cannot_be_done_is_told_with_the_option(said: dict[str, Any], field: str) -> None:
    refuses("input-options", lambda: TrainOptions(**said), field=field)


def test_training_ends_by_one_rule() -> None:
    """Time or iterations: what was said, else what the preset says."""
    assert TrainOptions().resolve().minutes == DEFAULT_MINUTES
    assert TrainOptions(preset="paper").resolve() == TrainOptions(preset="paper", iterations=PAPER_ITERATIONS)
    for said in (TrainOptions(minutes=2.0), TrainOptions(iterations=7, preset="paper")):
        assert said.resolve() == said
