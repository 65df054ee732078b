"""The comparison of a GPU with the processor: it finds what is wrong, and says where it cannot look."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from benchmarks import cuda_training
from benchmarks.cuda_training import EXACT, MOST, ROUNDED, apart, compared, iteration
from reference_encoder.training.capture import load_capture
from reference_encoder.training.options import TrainOptions
from reference_encoder.training.run import begun
from tests.reference_encoder.training import captures
from tests.reference_encoder.training.compiled_kernels import in_place_of_cuda

OPTIONS = TrainOptions(iterations=40, layers=2)


def test_without_a_gpu_nothing_is_compared(capsys: pytest.CaptureFixture[str]) -> None:
    """One line and a status of its own, before photos are read."""
    if torch.cuda.is_available():
        pytest.skip("there is a GPU: run python -m benchmarks.cuda_training CAPTURE")
    assert cuda_training.main(["nowhere"]) == cuda_training.SKIPPED
    assert "no CUDA GPU" in capsys.readouterr().out


@pytest.mark.parametrize("preset", ["default", "rvq"])
def test_the_code_for_cuda_finds_what_that_of_the_processor_finds(tmp_path: Path, preset: str) -> None:
    """Picture, loss, bits and gradients, on a device that computes as the processor does, from its checkpoint."""
    capture = load_capture(captures.own(tmp_path), hold_out=4)
    with in_place_of_cuda():
        errors = compared(capture, replace(OPTIONS, preset=preset), iterations=12)
    for what in (EXACT, ROUNDED):
        assert errors[what].within(MOST[EXACT]), errors[what]


def test_what_differs_is_found(tmp_path: Path) -> None:
    """A gradient of another sign, a picture of another scene, a number that is none."""
    capture = load_capture(captures.own(tmp_path), hold_out=4)
    one = iteration(begun(capture, OPTIONS), EXACT)
    turned = {name: -values for name, values in one.gradients.items()}
    assert apart(one, one).within(MOST[EXACT])
    assert not apart(one, replace(one, gradients=turned)).within(MOST[ROUNDED])
    assert not apart(one, replace(one, gradients={})).within(MOST[ROUNDED])
    assert not apart(one, replace(one, picture=one.picture + 0.01)).within(MOST[ROUNDED])
    assert not apart(one, replace(one, loss=float("nan"))).within(MOST[ROUNDED])
