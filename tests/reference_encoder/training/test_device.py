"""The device of a training: chosen by name, refused where it is absent, the same bits every time."""

import pytest
import torch
from torch.utils import deterministic

from reference_encoder.training import device
from reference_encoder.training.device import noise_generator, reproducible, run_device
from scarfmt.errors import missing_package
from tests.samples.codec_samples import refuses


def test_a_gpu_that_is_not_there_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, before anything is trained."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    refuses("input-options", lambda: run_device("cuda"), "no CUDA GPU", field="device")
    assert run_device("cpu") == torch.device("cpu")


def test_a_gpu_without_triton_is_refused_by_the_extra_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rasteriser on CUDA needs Triton; the refusal names it."""

    def missing() -> None:
        raise missing_package("triton", "cuda")

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(device, "kernels", missing)
    refuses("input-dependency", lambda: run_device("cuda"), r"triton.*scarfmt\[cuda\]")


@pytest.mark.parametrize("name", ["cpu", "meta"])
def test_torch_is_told_to_be_reproducible_as_long_as_a_run_lasts(name: str) -> None:
    """On every device; afterwards torch is as it was, also where the run failed."""
    filled = deterministic.fill_uninitialized_memory
    with pytest.raises(ValueError, match="fails"):
        _fail_reproducibly(torch.device(name))
    assert not torch.are_deterministic_algorithms_enabled()
    assert deterministic.fill_uninitialized_memory == filled


def _fail_reproducibly(on: torch.device) -> None:
    with reproducible(on):
        assert torch.are_deterministic_algorithms_enabled()
        raise ValueError("fails")


def test_gradients_of_many_values_that_are_added_up_are_the_same_bits_every_time() -> None:
    """Torch adds those of an index by atomics where there are several threads, in whatever order they come."""
    generator = torch.Generator().manual_seed(0)
    rows, weights = torch.arange(4000) // 20, torch.randn(4000, 32, generator=generator)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with reproducible(torch.device("cpu")):
            found = [_gradient(torch.ones(200, 32), rows, weights) for _ in range(40)]
    finally:
        torch.set_num_threads(before)
    assert all(torch.equal(each, found[0]) for each in found)


def _gradient(values: torch.Tensor, rows: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    values.requires_grad_()
    (values[rows] * weights).sum().backward()
    assert values.grad is not None
    return values.grad


def test_on_the_processor_one_generator_draws_everything() -> None:
    """A seed gives the numbers on the processor that it gave before there were other devices."""
    choices = torch.Generator().manual_seed(1)
    assert noise_generator(choices, torch.device("cpu")) is choices
