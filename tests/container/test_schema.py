"""The schema module: sizes, field tables and their agreement with numpy and the registries."""

from __future__ import annotations

import numpy as np

from scarfmt.container.schema import STREAM_COUNT, SUBSTREAM_RECORD, Stream, field_table, numpy_dtype
from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS


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


def test_stream_kinds_number_the_summary_array() -> None:
    """stream_bytes is indexed by Stream: the registry has no holes."""
    assert [int(kind) for kind in Stream] == list(range(STREAM_COUNT))


def test_reader_defaults_stay_within_the_format() -> None:
    """A default reader never accepts what a writer may not write."""
    for name, value in vars(DEFAULT_LIMITS).items():
        assert value <= getattr(FORMAT_LIMITS, name), name
