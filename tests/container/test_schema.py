"""The schema module: sizes, field tables and their agreement with numpy and the registries."""

from __future__ import annotations

import numpy as np
import pytest

from scarfmt.container.schema import (
    FILE_HEADER_SIZE,
    LAYER_SUMMARY_SIZE,
    SIGNATURE,
    STREAM_COUNT,
    STRUCTURES,
    SUBSTREAM_RECORD,
    Stream,
    field_table,
    field_tables,
    header_length,
    markdown_table,
    numpy_dtype,
)
from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS, MAX_LAYERS


def test_the_documented_sizes_are_the_real_ones() -> None:
    """The module docstring and SPEC print these sizes."""
    sizes = {name: structure.sizeof() for name, structure in STRUCTURES.items()}
    assert sizes == {
        "FILE_HEADER": 100,
        "LAYER_SUMMARY": 136,
        "HEADER_CHECKSUM": 4,
        "SUBSTREAM_RECORD": 9,
    }
    assert len(SIGNATURE) == 9
    assert header_length(3) == FILE_HEADER_SIZE + 3 * LAYER_SUMMARY_SIZE + 4
    assert header_length(MAX_LAYERS) < 1 << 16


@pytest.mark.parametrize("name", sorted(STRUCTURES))
def test_field_tables_are_gapless_and_documented(name: str) -> None:
    """SPEC tables made from them cover every byte, and every field says what it means."""
    end = 0
    for row in field_tables()[name]:
        assert row.offset == end
        assert row.description
        end += row.size
    assert end == STRUCTURES[name].sizeof()


def test_numpy_parses_what_construct_declares() -> None:
    """The fast parser of tables reads each field where the declaration puts it."""
    structure, dtype = SUBSTREAM_RECORD, numpy_dtype(SUBSTREAM_RECORD)
    rows = field_table(structure)
    assert {row.name: (row.offset, row.size) for row in rows} == {
        name: (place[1], place[0].itemsize) for name, place in dtype.fields.items()
    }
    data = bytes(range(1, dtype.itemsize + 1))
    parsed, row = structure.parse(data), np.frombuffer(data, dtype)[0]
    assert {name: int(row[name]) for name in dtype.names} == {name: parsed[name] for name in dtype.names}


def test_markdown_table_has_one_line_per_field() -> None:
    """The text SPEC.md is checked against."""
    text = markdown_table("SUBSTREAM_RECORD")
    assert text.splitlines()[0] == "| offset | size | type | field | meaning and range |"
    assert "| 1 | 4 | u32 | `length` | Bytes of the sub-stream" in text
    assert len(text.splitlines()) == 2 + 3


def test_stream_kinds_number_the_summary_array() -> None:
    """stream_bytes is indexed by Stream: the registry has no holes."""
    assert [int(kind) for kind in Stream] == list(range(STREAM_COUNT))


def test_reader_defaults_stay_within_the_format() -> None:
    """A default reader never accepts what a writer may not write."""
    for name, value in vars(DEFAULT_LIMITS).items():
        assert value <= getattr(FORMAT_LIMITS, name), name
