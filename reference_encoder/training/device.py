"""The device of a training run, and the settings that make it compute the same each time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch.utils import deterministic

from reference_encoder.training.raster.cuda import kernels
from scarfmt.errors import InvalidInput

_CUBLAS = "CUBLAS_WORKSPACE_CONFIG"


def run_device(name: str) -> torch.device:
    """The device of a run.

    Args:
        name: "cpu" or "cuda".

    Raises:
        InvalidInput: ``input-options`` for "cuda" without such a GPU; ``input-dependency`` where Triton is missing.
    """
    if name == "cuda":
        if not torch.cuda.is_available():
            message = "torch sees no CUDA GPU here: leave out the device, and the CPU trains"
            raise InvalidInput("input-options", message, field="device")
        kernels()
    return torch.device(name)


@contextmanager
def reproducible(device: torch.device) -> Iterator[None]:
    """While it lasts, torch computes the same bits from the same numbers, or raises RuntimeError where it cannot.

    Sums over indices would otherwise be by atomics, in any order: on CUDA, and on the processor those of many values.
    What would depend on the number of threads is in :mod:`.fixed_order`.
    """
    before = torch.get_deterministic_debug_mode()
    filled = deterministic.fill_uninitialized_memory  # type: ignore[attr-defined]
    if device.type != "cpu":
        # Some versions of torch refuse to multiply matrices without it; cuBLAS reads it once.
        os.environ.setdefault(_CUBLAS, ":4096:8")
    torch.set_deterministic_debug_mode("error")
    # Nothing here reads what it has not written.
    deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]
    try:
        yield
    finally:
        torch.set_deterministic_debug_mode(before)
        deterministic.fill_uninitialized_memory = filled  # type: ignore[attr-defined]


def noise_generator(choices: torch.Generator, device: torch.device) -> torch.Generator:
    """The generator of the many random numbers of an iteration: `choices` itself on the processor, else one on the
    device.

    Choices (photos, layers, who grows) are drawn on the processor: the same on every device. Noise is millions of
    numbers an iteration, which a GPU draws faster than a processor could hand them over; its numbers are others.

    Args:
        choices: on the processor; seeds the other one.
    """
    if device.type == "cpu":
        return choices
    made = torch.Generator(device)
    made.manual_seed(int(torch.randint(2**62, (), generator=choices)))
    return made
