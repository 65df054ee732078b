"""Fixtures of several tests of training."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from reference_encoder.training.capture import Capture, load_capture
from tests.reference_encoder.training import captures


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Threads only get in each other's way at these sizes."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    """Eight small photos of a few Gaussians."""
    return load_capture(captures.own(tmp_path_factory.mktemp("capture")), hold_out=4)
