"""The tables of the stage ``container``: those of SPEC §5, and what they make of a file."""

from __future__ import annotations

import struct

import pytest

from conformance.decoders.python import container as container_fields
from conformance.decoders.python.container import fields_at, profile_of, size_of
from scarfmt.container import schema
from tests.conformance.vector_files import VECTORS

WORKED = (VECTORS / "worked" / "input.scar").read_bytes()
SIZES = {"bytes": 1, "u8": 1, "u16": 2, "u32": 4, "u64": 8, "f64": 8}


@pytest.mark.parametrize("name", ["FILE_HEADER", "LAYER_SUMMARY", "HEADER_CHECKSUM"])
def test_structures_are_those_the_package_writes(name: str) -> None:
    """The structures have the names, sizes and order of the tables in SPEC.md."""
    layout = getattr(container_fields, name)
    rows = schema.field_table(getattr(schema, name))
    assert [(field, SIZES[kind] * count) for field, kind, count in layout] == [(row.name, row.size) for row in rows]
    assert size_of(layout) == sum(row.size for row in rows)


def test_numbers_are_written_as_the_protocol_says() -> None:
    """u64 beyond 2^53 in full, the bits of an f64 most significant first, several numbers as a list."""
    layout = (("word", "u64", 1), ("pair", "u16", 2), ("real", "f64", 1), ("raw", "bytes", 2))
    data = b"?" + struct.pack("<QHHd", (1 << 64) - 1, 1, 2, -0.0) + b"\x01\xab"
    expected = {"word": "18446744073709551615", "pair": ["1", "2"], "real": "8000000000000000", "raw": "01ab"}
    assert fields_at(data, 1, layout) == expected


def test_a_profile_is_told_only_by_a_sound_header() -> None:
    """A decoder of one profile may then skip the vector; others must refuse it whatever they decode."""
    damaged = bytearray(WORKED)
    damaged[60] ^= 1
    assert profile_of(WORKED) == "explicit"
    assert profile_of(bytes(damaged)) is None
    assert profile_of(WORKED[:10] + b"\1" + WORKED[11:]) is None
    assert profile_of(WORKED[:99]) is None
    assert profile_of(b"") is None
