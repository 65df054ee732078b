"""Time: efforts are compared at equal error."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.time import bytes_at_equal_error


def effort_run(effort: int, psnr: float, size: int) -> dict[str, Any]:
    return {"effort": effort, "psnr_db": psnr, "bytes": size}


def test_efforts_are_compared_where_all_have_files_on_both_sides() -> None:
    """At the best PSNR of the lower quality; halfway in dB is the geometric mean of bytes."""
    runs = [effort_run(1, 40.0, 100), effort_run(1, 44.0, 400), effort_run(2, 42.0, 150), effort_run(2, 43.0, 300)]
    goal, equal = bytes_at_equal_error(runs)
    assert goal == 42.0
    assert equal == pytest.approx({1: 200.0, 2: 150.0})
    with pytest.raises(ValueError, match="both sides"):
        bytes_at_equal_error([*runs[:1], effort_run(1, 41.0, 120), *runs[2:]])
