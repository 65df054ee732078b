"""Options: what no encoder could do is refused before any work."""

from __future__ import annotations

from typing import Any

import pytest

from reference_encoder.options import EncodeOptions
from tests.samples.codec_samples import refuses


@pytest.mark.parametrize(
    "options",
    [
        {"quality": 5.0},
        {"worst": 90.0},
        {"effort": 3},
        {"effort": 0, "cameras": []},
        {"layers": 0},
        {"layers": 17},
        {"tile_anchors": 1023},
        {"only_cameras": True},
        {"metadata": {"x": float("nan")}},
    ],
)
def test_bad_options_are_refused(options: dict[str, Any]) -> None:
    """Those out of range, cameras alone without any, and metadata that no reader takes."""
    refuses("input-options", lambda: EncodeOptions(**options))
