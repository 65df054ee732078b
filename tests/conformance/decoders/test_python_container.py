"""The tables of the stage ``container``: those of SPEC §5, and what they make of a file."""

from __future__ import annotations

import struct

import pytest

from conformance.decoders.python import front
from conformance.decoders.python.container import fields_at
from scarfmt.container import schema

SIZES = {"bytes": 1, "u8": 1, "u16": 2, "u32": 4, "u64": 8, "f64": 8}


@pytest.mark.parametrize("name", ["FILE_HEADER", "LAYER_SUMMARY", "HEADER_CHECKSUM"])
def test_structures_are_those_the_package_writes(name: str) -> None:
    """The structures have the names, sizes and order of the tables in SPEC.md."""
    layout = getattr(front, name)
    rows = schema.field_table(getattr(schema, name))
    assert [(field, SIZES[kind] * count) for field, kind, count in layout] == [(row.name, row.size) for row in rows]
    assert front.size_of(layout) == sum(row.size for row in rows)


def test_numbers_are_written_as_the_protocol_says() -> None:
    """u64 beyond 2^53 in full, the bits of an f64 most significant first, several numbers as a list."""
    layout = (("word", "u64", 1), ("pair", "u16", 2), ("real", "f64", 1), ("raw", "bytes", 2))
    data = b"?" + struct.pack("<QHHd", (1 << 64) - 1, 1, 2, -0.0) + b"\x01\xab"
    expected = {"word": "18446744073709551615", "pair": ["1", "2"], "real": "8000000000000000", "raw": "01ab"}
    assert fields_at(data, 1, layout) == expected
