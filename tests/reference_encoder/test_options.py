"""Options: what is refused before any work, and pages that say what is so."""

from __future__ import annotations

from typing import Any

import pytest

from reference_encoder.options import EncodeOptions
from scarfmt.limits import MAX_METADATA_DEPTH
from tests.samples.codec_samples import refuses


def _nested(depth: int) -> Any:
    value: Any = 0
    for _ in range(depth - 1):  # the object itself is the first level
        value = [value]
    return {"x": value}


@pytest.mark.parametrize(
    "metadata",
    [{"x": float("inf")}, {"x": float("nan")}, {"x": "\ud800"}, {"x": {1, 2}}, _nested(MAX_METADATA_DEPTH + 1)],
)
def test_metadata_that_no_reader_takes_is_refused_before_the_work(metadata: dict[str, Any]) -> None:
    """Infinity, half a surrogate pair, what is not JSON, and one level too many; one level fewer is taken."""
    EncodeOptions(metadata=_nested(MAX_METADATA_DEPTH))
    refuses("input-options", lambda: EncodeOptions(metadata=metadata), field="metadata")


def test_a_fence_needs_cameras() -> None:
    """Only the cameras: refused where there are none."""
    refuses("input-options", lambda: EncodeOptions(only_cameras=True), field="only_cameras")
