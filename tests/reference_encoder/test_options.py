"""Options: what is refused before any work, and pages that say what is so."""

from __future__ import annotations

from typing import Any

import pytest

from reference_encoder.options import EncodeOptions
from scarfmt.errors import InvalidInput
from scarfmt.limits import MAX_METADATA_DEPTH


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
    """Infinity, half a surrogate pair, what is not JSON, and one level too many."""
    with pytest.raises(InvalidInput) as caught:
        EncodeOptions(metadata=metadata)
    assert (caught.value.refusal, caught.value.field) == ("input-options", "metadata")


def test_metadata_may_be_as_deep_as_the_format_allows() -> None:
    """One level fewer than the refused."""
    EncodeOptions(metadata=_nested(MAX_METADATA_DEPTH))


def test_a_fence_needs_cameras() -> None:
    """Only the cameras: refused where there are none."""
    with pytest.raises(InvalidInput) as caught:
        EncodeOptions(only_cameras=True)
    assert (caught.value.refusal, caught.value.field) == ("input-options", "only_cameras")
