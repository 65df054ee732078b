"""Coding through fitted tables, and crafted streams, shared by the tests of the sub-stream codecs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st
from numpy.typing import NDArray

from scarfmt.arrays import Ints
from scarfmt.blocks.tables import fit_table
from scarfmt.entropy.emitters import Emitter, SymbolCounter, SymbolWriter
from scarfmt.entropy.keys import CONTEXTS, TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import InvalidInput, LimitExceeded, ScarError, Unsupported

Act = Callable[[], object]
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


def refuses(
    refusal: str, act: Act, said: str | None = None, *, field: str | None = None, kind: type[ScarError] = ScarError
) -> None:
    """Assert that `act` raises an error with this refusal id and, if given, a pattern's words, a field, a kind."""
    with pytest.raises(kind, match=said) as caught:
        act()
    assert caught.value.refusal == refusal
    assert field is None or caught.value.field == field
    assert isinstance(caught.value, InvalidInput | Unsupported | LimitExceeded) or not refusal.startswith("input-")


class Recorder(Emitter):
    """An emitter that keeps the groups, to compare what was emitted in which order."""

    def __init__(self) -> None:
        self.groups: list[tuple[TableKey | int, list[int]]] = []

    def emit(self, key: TableKey, values: Ints) -> None:
        self.groups.append((key, values.tolist()))

    def emit_uniform(self, size: int, values: Ints) -> None:
        self.groups.append((size, values.tolist()))

    def emit_rows(self, weights: object, values: Ints) -> None:
        raise AssertionError("no codec of these samples has rows")


EDGE = 2**31 - 1


@st.composite
def many_groups(draw: st.DrawFn) -> tuple[NDArray[np.integer[Any]], NDArray[np.integer[Any]]]:
    """Contexts and values of one call: few cells or many, values close together or at the ends of 32 bits."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count, kinds = draw(st.integers(1, 80)), draw(st.sampled_from([1, 3, CONTEXTS]))
    reach = draw(st.sampled_from([0, 1, 40, 30_000, 1 << 15, EDGE]))
    middle = draw(st.sampled_from([0, -EDGE + reach, EDGE - reach]))
    values = middle + rng.integers(-reach, reach + 1, count)
    if draw(st.booleans()):
        values = rng.choice([-reach, reach], count) + middle
    chosen = kinds - 1 - rng.integers(0, min(kinds, 500), count) if draw(st.booleans()) else np.full(count, kinds - 1)
    types: list[tuple[type, type]] = [(np.int64, np.int64), (np.uint16, np.int32)]
    if np.abs(values).max() < 1 << 15:
        types.append((np.int16, np.int16))
    a, b = draw(st.sampled_from(types))
    return chosen.astype(a), values.astype(b)
