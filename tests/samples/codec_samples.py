"""Coding through fitted tables, and crafted streams, shared by the tests of the sub-stream codecs."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from scarfmt.blocks.tables import fit_table, pack_table
from scarfmt.entropy.emitters import Emitter, SymbolCounter, SymbolWriter, Values
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import Malformed

Put = Callable[[Emitter], None]
Tables = Mapping[TableKey, SymbolTable]


def fitted(put: Put) -> dict[TableKey, SymbolTable]:
    """The tables an encoder would send for what `put` emits."""
    counter = SymbolCounter()
    put(counter)
    return {key: fit_table(*histogram) for key, histogram in counter.histograms().items()}


def coded(put: Put) -> tuple[bytes, dict[TableKey, SymbolTable]]:
    """The sealed stream of what `put` emits, and its tables."""
    tables = fitted(put)
    writer = SymbolWriter(tables)
    put(writer)
    return writer.finish(), tables


def cost_bits(put: Put) -> float:
    """Bits of what `put` emits, tables included."""
    counter = SymbolCounter()
    put(counter)
    bits = counter.uniform_bits
    for key, (alphabet, counts) in counter.histograms().items():
        table = fit_table(alphabet, counts)
        bits += table.cost_of_counts(alphabet, counts) + 8 * len(pack_table(key, table))
    return bits


def reader_of(put: Put) -> SymbolReader:
    """A reader positioned at the start of what `put` emits: for round trips and for crafted streams."""
    return SymbolReader(*coded(put))


def emitting(*groups: tuple[TableKey, list[int]]) -> SymbolReader:
    """A reader of a stream of exactly these groups, whatever a codec would say to them."""

    def put(emitter: Emitter) -> None:
        for key, values in groups:
            emitter.emit(key, np.array(values, np.int64))

    return reader_of(put)


def refuses(refusal: str, act: Callable[[], object]) -> None:
    """Assert that `act` raises Malformed with this refusal id."""
    with pytest.raises(Malformed) as caught:
        act()
    assert caught.value.refusal == refusal


class Recorder(Emitter):
    """An emitter that keeps the groups, to compare what was emitted in which order."""

    def __init__(self) -> None:
        self.groups: list[tuple[TableKey | int, list[int]]] = []

    def emit(self, key: TableKey, values: Values) -> None:
        self.groups.append((key, values.tolist()))

    def emit_uniform(self, size: int, values: Values) -> None:
        self.groups.append((size, values.tolist()))
