"""Class sub-stream: which of the classes that appear in this layer each new anchor has (SPEC §7.3)."""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import I64
from scarfmt.container.schema import Stream
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.errors import Malformed

KEY = TableKey(Stream.CLASSES, 0, 0, 0)


def put_classes(emitter: Emitter, classes: I64, first: int, past: int) -> None:
    """Emit the classes, (n,) int64 in first..past-1; nothing when only one is possible."""
    if past - first > 1:
        emitter.emit(KEY, classes - first)


def get_classes(reader: SymbolReader, count: int, first: int, past: int) -> I64:
    """Read (count,) int64 classes.

    Raises:
        Malformed: ``bad-class`` when a value is not one of the layer's new classes.
    """
    classes = reader.read(KEY, count) + first if past - first > 1 else np.full(count, first, np.int64)
    if count and not (past > first and first <= int(classes.min()) and int(classes.max()) < past):
        raise Malformed("bad-class", f"a new anchor's class is not in {first}..{past - 1} (SPEC §7.3)", field="classes")
    return classes
