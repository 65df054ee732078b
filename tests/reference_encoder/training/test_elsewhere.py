"""Whole trainings on another device than the processor, without one: what `--device cuda` does, less its arithmetic.

The device only says that it is another (`elsewhere`), and everything that is placed wrongly fails there. All code for
CUDA runs but the Triton kernels, in whose place are the compiled ones (`compiled_kernels`).
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

import scarfmt
from reference_encoder.training import run, trainer
from reference_encoder.training.capture import Capture
from reference_encoder.training.options import TrainOptions
from reference_encoder.training.presets import PRESETS
from reference_encoder.training.run import train
from tests.reference_encoder.training.compiled_kernels import in_place_of_cuda

OPTIONS = TrainOptions(iterations=16, layers=2, device="cuda")
OFTEN = {"_GROW_EVERY": 4, "_DECIDE_EVERY": 8, "_LOOK_EVERY": 4, "_REFRESH_EVERY": 8, "_INDEX_EVERY": 2}
"""Iterations between what whole trainings do rarely."""


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch) -> Iterator[torch.device]:
    """A stand-in device in the place of CUDA, and short trainings with all parts of long ones."""
    for name, value in OFTEN.items():
        monkeypatch.setattr(trainer, name, value)
    monkeypatch.setattr(run, "_CHECK_ITERATIONS", 8)
    with in_place_of_cuda() as found:
        yield found


def test_the_stand_in_refuses_what_a_gpu_refuses() -> None:
    """These tests rely on it: no tensor that is left on the processor is accepted."""
    with in_place_of_cuda() as device:
        there = torch.zeros(3, device=device)
        for wrong in (
            lambda: there + torch.ones(3),
            lambda: torch.cat([there, torch.ones(3)]),
            lambda: there[torch.tensor([0])],
            lambda: there.index_add_(0, torch.tensor([0]), there[:1]),
            lambda: torch.rand(3, generator=torch.Generator(), device=device),
            there.numpy,
        ):
            with pytest.raises((RuntimeError, TypeError)):
                wrong()
        assert (2 * there + torch.ones(())).cpu().tolist() == [1.0] * 3


@pytest.mark.parametrize("preset", list(PRESETS))
def test_a_whole_training_runs_on_another_device(capture: Capture, elsewhere: torch.device, preset: str) -> None:
    """Nothing of it is made on the processor and used there: growth, masks, codewords, networks, file and measures."""
    counts: list[int] = []
    trained = train(capture, replace(OPTIONS, preset=preset), report=lambda now: counts.append(now.anchors))
    assert max(counts) > counts[0]
    assert len(scarfmt.decode(trained.data).scene) > 0
    assert all(layer.psnr > 5 for layer in trained.layers)


def test_the_same_seed_gives_the_same_file_whatever_interrupts(
    capture: Capture, elsewhere: torch.device, tmp_path: Path
) -> None:
    """On another device than the processor, too: its generator goes on where the checkpoint was."""
    whole = train(capture, OPTIONS)
    train(capture, OPTIONS, tmp_path, stop=iter([False] * 8 + [True]).__next__)
    assert train(capture, OPTIONS, tmp_path).data == whole.data


@pytest.mark.parametrize(("first", "then"), [("cpu", "cuda"), ("cuda", "cpu")])
def test_a_run_goes_on_on_another_device(
    capture: Capture, elsewhere: torch.device, tmp_path: Path, first: str, then: str
) -> None:
    """A checkpoint belongs to no device: a machine that has lost its GPU goes on without."""
    options = replace(OPTIONS, preset="rvq")
    half = train(capture, replace(options, device=first), tmp_path, stop=iter([False] * 8 + [True]).__next__)
    assert half.iterations == 9
    assert train(capture, replace(options, device=then), tmp_path).iterations == OPTIONS.iterations
