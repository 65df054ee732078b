"""The kernels of the rasteriser on CUDA, by the compiled library: they take the same and fill the same."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ctypes import byref, c_float, c_int64
from typing import Any

import pytest
import torch

from reference_encoder.training import run
from reference_encoder.training.raster import cuda
from scarfmt.render.native.binding import BLEND, UNBLEND, Job, load
from tests.reference_encoder.training.elsewhere import Tensor, elsewhere

_LISTS = ("splats", "offsets", "listed", "owners")


class Kernel:
    """Called like a Triton kernel.

    Args:
        work: what `scar_composite` does to tiles.
        fields: of its `Job`, in the order of the kernel's own arguments.
    """

    def __init__(self, work: int, fields: tuple[str, ...]) -> None:
        self.work, self.fields = work, (*_LISTS, *fields)

    def __getitem__(self, grid: tuple[int]) -> Callable[..., None]:
        """For so many tiles."""

        def run(*arguments: Any) -> None:
            width, height, columns, *rules, _tile = arguments[len(self.fields) :]
            job = Job(width=width, height=height, columns=columns, tiles=grid[0])
            job.max_alpha, job.min_alpha, job.min_transmittance = rules
            for field, tensor in zip(self.fields, arguments, strict=False):
                assert isinstance(tensor, Tensor)
                assert tensor.held.is_contiguous()
                self._give(job, field, tensor.held)
            load().scar_composite(byref(job), self.work, byref(c_int64(0)))

        return run

    def _give(self, job: Job, field: str, numbers: torch.Tensor) -> None:
        if field == "background":
            job.background = (c_float * 3)(*numbers.tolist())
        else:
            setattr(job, field, numbers.data_ptr())


blend = Kernel(BLEND, ("background", "image", "transmittance", "weights", "drawn"))
unblend = Kernel(UNBLEND, ("image", "towards", "drawn", "gradients"))


@contextmanager
def in_place_of_cuda() -> Iterator[torch.device]:
    """While active, a run on "cuda" is one on the stand-in device, with these kernels."""
    with elsewhere() as device, pytest.MonkeyPatch.context() as patched:
        patched.setattr(run, "run_device", lambda name: device if name == "cuda" else torch.device(name))
        patched.setattr(cuda, "kernels", lambda: sys.modules[__name__])
        yield device
