"""The second decoder's side of the protocol."""

from __future__ import annotations

import json

import pytest

from conformance.decoders.python.answers import STAGES, answer, main
from tests.conformance.vector_files import VECTORS, expectation_of

WORKED = VECTORS / "worked"


def test_it_claims_the_exact_stages_only() -> None:
    claims = answer(b"", 0, "capabilities")["capabilities"]
    assert claims["stages"] == list(STAGES)
    assert "activated" not in claims["stages"]


@pytest.mark.parametrize("stage", [*STAGES, "all"])
def test_a_stage_is_answered_alone_or_with_all_but_annotations(stage: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(WORKED / "input.scar"), "--layers", "1", "--stage", stage]) == 0
    stages = json.loads(capsys.readouterr().out)["stages"]
    assert list(stages) == (list(STAGES[:-2]) if stage == "all" else [stage])


def test_it_answers_for_the_layer_asked(capsys: pytest.CaptureFixture[str]) -> None:
    """0 is the last."""
    shapes = []
    for layers in ("1", "2", "0"):
        main([str(WORKED / "input.scar"), "--layers", layers, "--stage", "integers"])
        shapes.append(json.loads(capsys.readouterr().out)["stages"]["integers"]["arrays"]["code"]["shape"])
    assert shapes == [[layer["anchors"]] for layer in expectation_of(WORKED)["layers"]] + [[3]]


def test_a_refusal_is_an_answer(capsys: pytest.CaptureFixture[str]) -> None:
    """Exit status 0."""
    assert main([str(VECTORS / "invalid" / "rice-fill" / "input.scar")]) == 0
    assert json.loads(capsys.readouterr().out)["refused"] == "bad-rice"
