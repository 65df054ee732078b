"""The schema module: sizes, field tables and their agreement with numpy and the registries."""

from __future__ import annotations

import struct

import pytest

from scarfmt.container.schema import (
    STREAM_COUNT,
    SUBSTREAM_RECORD,
    Stream,
    build,
    parse,
)
from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS


def test_structures_are_read_as_they_are_written() -> None:
    """Fields lie back to back, little-endian; what does not fit its field is no value."""
    values = {"stream": 3, "length": 4, "crc32": 0xFEDCBA98}
    data = build(SUBSTREAM_RECORD, values)
    assert data == bytes.fromhex("03 04000000 98BADCFE")
    assert vars(parse(SUBSTREAM_RECORD, b"?" + data, 1)) == values
    with pytest.raises(struct.error):
        build(SUBSTREAM_RECORD, {**values, "length": 1 << 32})


def test_stream_kinds_number_the_summary_array() -> None:
    """stream_bytes is indexed by Stream: the registry has no holes."""
    assert [int(kind) for kind in Stream] == list(range(STREAM_COUNT))


def test_reader_defaults_stay_within_the_format() -> None:
    """A default reader never accepts what a writer may not write."""
    for name, value in vars(DEFAULT_LIMITS).items():
        assert value <= getattr(FORMAT_LIMITS, name), name
