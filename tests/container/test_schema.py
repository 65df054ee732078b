"""The registries: no holes, and limits within the format."""

from __future__ import annotations

from scarfmt.container.schema import STREAM_COUNT, Stream
from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS


def test_stream_kinds_number_the_summary_array() -> None:
    """stream_bytes is indexed by Stream: the registry has no holes."""
    assert [int(kind) for kind in Stream] == list(range(STREAM_COUNT))


def test_reader_defaults_stay_within_the_format() -> None:
    """A default reader never accepts what a writer may not write."""
    for name, value in vars(DEFAULT_LIMITS).items():
        assert value <= getattr(FORMAT_LIMITS, name), name
