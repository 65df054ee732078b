"""Table records of a TABLES block, legal or not, for faults (SPEC §8)."""

from __future__ import annotations

from collections.abc import Callable

from conformance.decoders.python.models import parse_tables
from conformance.decoders.python.numbers import Numbers
from conformance.surgery.edit import replaced
from conformance.surgery.files import block_of, changed
from conformance.writer.numbers import numbers_block
from conformance.writer.tables import Record, table_numbers
from scarfmt.container.schema import BlockKind

Records = list[Record]
"""The records of a block, by ascending key if it is sound."""


def with_tables(data: bytes, layer: int, change: Callable[[Records], Records]) -> bytes:
    """The file with other tables in `layer`, the directory's count right; something must change."""
    payload = block_of(data, BlockKind.TABLES, layer).payload
    before = [Record(key, *table) for key, table in parse_tables(Numbers(payload)).items()]
    after = change(before)
    assert after != before
    made = numbers_block(table_numbers(after))
    return changed(data, BlockKind.TABLES, layer, replaced(made), len(after) - len(before))


def valued(record: Record, old: int, new: int) -> Record:
    """The record with a value of its alphabet changed."""
    assert old in record.values
    return record._replace(values=[new if value == old else value for value in record.values])
