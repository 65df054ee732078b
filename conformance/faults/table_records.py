"""Table records of a TABLES block, legal or not, for faults (SPEC §8)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from conformance.surgery.files import changed
from conformance.writer.fields import svarint, varint
from scarfmt.container.bytefields import ByteReader
from scarfmt.container.schema import BlockKind


@dataclass(frozen=True)
class Record:
    """One table record; nothing about it is checked.

    Attributes:
        key: number of the key.
        values: the alphabet, not descending.
        weights: one a value.
    """

    key: int
    values: tuple[int, ...]
    weights: tuple[int, ...]

    @property
    def stream(self) -> int:
        """Stream kind of the key."""
        return self.key >> 24

    @property
    def component(self) -> int:
        """Component of the key; of INDICES the stage."""
        return self.key >> 16 & 255

    @property
    def step(self) -> int:
        """Step of the key."""
        return self.key >> 8 & 255

    @property
    def context(self) -> int:
        """Context of the key."""
        return self.key & 255

    def packed(self) -> bytes:
        """The bytes of the record."""
        gaps = [after - before - 1 for before, after in zip(self.values, self.values[1:], strict=False)]
        numbers = b"".join(map(varint, (*gaps, *self.weights)))
        return varint(self.key) + varint(len(self.values)) + svarint(self.values[0]) + numbers


Records = list[Record]
"""The records of a block, by ascending key if it is sound."""


def number(stream: int, component: int, step: int, context: int) -> int:
    """The number of a key (SPEC §8.3)."""
    return stream << 24 | component << 16 | step << 8 | context


def unpacked(content: bytes) -> Records:
    """The records of a sound TABLES block's content."""
    reader = ByteReader(content, "tables")
    out = []
    for _ in range(reader.unsigned(63)):
        key, size = reader.unsigned(32), reader.unsigned(63)
        values = [reader.signed(33)]
        for _ in range(size - 1):
            values.append(values[-1] + reader.unsigned(32) + 1)
        out.append(Record(key, tuple(values), tuple(reader.unsigned(24) for _ in range(size))))
    return out


def packed(records: Sequence[Record]) -> bytes:
    """The content of a TABLES block of these records, in this order."""
    return varint(len(records)) + b"".join(record.packed() for record in records)


def with_tables(data: bytes, layer: int, change: Callable[[Records], Records]) -> bytes:
    """The file with other tables in `layer`, the directory's count right; something must change."""
    grown: list[int] = []

    def edit(content: bytes) -> bytes:
        before = unpacked(content)
        after = change(before)
        assert after != before
        grown.append(len(after) - len(before))
        return packed(after)

    # The first run only counts.
    changed(data, BlockKind.TABLES, layer, edit)
    return changed(data, BlockKind.TABLES, layer, edit, grown[0])


def valued(record: Record, old: int, new: int) -> Record:
    """The record with a value of its alphabet changed."""
    assert old in record.values
    return replace(record, values=tuple(new if value == old else value for value in record.values))
