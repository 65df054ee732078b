"""The TABLES block: static tables as a layer sends them (SPEC §8.3), and which table is worth its bytes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from scarfmt.arrays import F64, I64
from scarfmt.blocks.declare import (
    Check,
    Derived,
    Element,
    Number,
    NumberRecord,
    Record,
    Repeat,
    Rule,
    Scope,
    When,
    build,
    read,
    stream_name,
)
from scarfmt.blocks.spec import BlockSpec
from scarfmt.container.registries import BlockKind
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.numbers import Spend
from scarfmt.entropy.rans import MAX_ALPHABET, PRECISION, scale_weights
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import Malformed

MAX_TABLES = 1 << 16
_MOST_WEIGHT_BITS = 24
_VALUE = 1 << 31
# Weight precisions tried for a table; the cheapest of table bits + coding loss wins.
_TOP_WEIGHTS = 2.0 ** np.arange(1, 14) - 1
_KEY_BITS, _SYMBOL_BITS = 5.0, 1.5
"""About what a table costs, and each of its symbols beside the bits of its weight [0067]."""


class _Key(Element):
    """The key of a table, by what its digits add to those of the table before."""

    spelled = "key()"

    def take(self, reader: Any, scope: Scope) -> int:
        key, same = 0, 1
        reader.spend(_LAST_DIGIT + 1)
        for digit, before in enumerate(_digits(scope["earlier"][-1]["key"] if scope["earlier"] else 0)):
            value = reader.number((self.name, digit, same)) + same * (before + (digit == _LAST_DIGIT))
            if value > _MOST_DIGIT:
                raise _bad_table(f"{value} as a digit of a key, at most {_MOST_DIGIT} allowed")
            key, same = key << 8 | value, int(same and value == before)
        return key

    def put(self, value: int, scope: Scope) -> bytes:
        same, before = 1, _digits(scope["key_before"])
        for digit, (own, other) in enumerate(zip(_digits(value), before, strict=True)):
            scope["writer"].number((self.name, digit, same), own - same * (other + (digit == _LAST_DIGIT)))
            same = int(same and own == other)
        return b""

    def show(self, value: int) -> str:
        stream, *others = _digits(value)
        return f"({stream_name(stream)}, {', '.join(map(str, others))})"


_LAST_DIGIT, _MOST_DIGIT = 3, 255


def _digits(key: int) -> tuple[int, ...]:
    """Stream, component, step and context of the number of a key."""
    return tuple(key.to_bytes(4, "big"))


_TABLE = Record(
    "key" / _Key() * "above that of the table before",
    "kind" / Derived(lambda at: min(at["key"] >> 8 & 255, 2), "min(step of key, 2)"),
    "more" / Number(by="kind", limit=MAX_ALPHABET - 1) * "symbols but one",
    "first" / Number("signed", by="kind") * "first value of the alphabet",
    "gaps" / Number(times="more", by="kind") * "each value is the one before + gap + 1",
    Rule(
        Check("R-8.3-1", "the values are -(2^31 - 1)..2^31 - 1", "bad-table"),
        lambda at: at["first"] + int((at["gaps"] + 1).sum()) < _VALUE,
        lambda at: _bad_table("alphabet values must fit 32 bits"),
    ),
    When(
        "more > 0",
        "precision" / Number(by="kind", limit=_MOST_WEIGHT_BITS - 1) * "bits of the largest weight, less 1",
        "less" / Number(times="more + 1", by="precision") * "each weight is 1 more",
        Rule(
            Check("R-8.3-1", "every weight is below 2^24", "bad-table"),
            lambda at: not (at["less"] + 1 >> _MOST_WEIGHT_BITS).any(),
            lambda at: _bad_table("weights must be below 2^24"),
        ),
    ),
)

TABLES = NumberRecord("table_count" / Number(limit=MAX_TABLES), "tables" / Repeat("table_count", _TABLE))
"""The numbers of a TABLES block."""


def _bad_table(message: str) -> Malformed:
    return Malformed("bad-table", f"{message} (SPEC §8.3)", field="tables")


def table_bits(table: SymbolTable) -> float:
    """About the bits that a table takes in a TABLES block, whose numbers adapt to those before."""
    return _KEY_BITS + float(_weight_bits(table.weights))


def _weight_bits(weights: I64) -> F64:
    """(...) of (..., n) weights: about what they and the alphabet cost."""
    if weights.shape[-1] == 1:
        return np.zeros(weights.shape[:-1])
    return np.asarray((np.log2(weights) + _SYMBOL_BITS).sum(axis=-1))


def fit_table(alphabet: I64, counts: I64) -> SymbolTable:
    """The table whose own bits plus coding loss on `counts` are least."""
    if len(counts) == 1:
        return SymbolTable(alphabet, np.ones(1, np.int64))
    scaled = np.rint(counts * (_TOP_WEIGHTS / counts.max())[:, None]).astype(np.int64)
    weights = np.maximum(scaled, 1)
    coded = ((PRECISION - np.log2(scale_weights(weights).astype(np.float64))) * counts).sum(axis=1)
    return SymbolTable(alphabet, weights[int(np.argmin(coded + _weight_bits(weights)))])


def pack_tables(tables: Mapping[TableKey, SymbolTable]) -> bytes:
    """The payload of a TABLES block (SPEC §8.3), tables by ascending key."""
    keys = sorted(tables)
    before = [0, *(key.number for key in keys)]
    records = [_fields(key, tables[key], other) for key, other in zip(keys, before, strict=False)]
    return build(TABLES, {"table_count": len(records), "tables": records})


def _fields(key: TableKey, table: SymbolTable, before: int) -> dict[str, Any]:
    gaps = np.diff(table.alphabet) - 1
    numbers = {"key": key.number, "key_before": before, "kind": min(key.step, 2), "more": len(gaps)}
    most = int(table.weights.max()).bit_length() - 1
    return {**numbers, "first": int(table.alphabet[0]), "gaps": gaps, "precision": most, "less": table.weights - 1}


def unpack_tables(payload: bytes, spend: Spend = lambda count: True) -> dict[TableKey, SymbolTable]:
    """The tables of a TABLES block.

    Raises:
        Malformed: ``bad-table`` for a table that breaks SPEC §8.3, ``bad-number``, ``rans-length``, ``rans-last-word``,
            ``rans-seal``.
        LimitExceeded: ``count-limit``, ``limit-expansion``.
    """
    tables = read(TABLES, payload, "tables", spend=spend)["tables"]
    return {TableKey.from_number(table["key"]): _table(table) for table in tables}


def _table(at: Scope) -> SymbolTable:
    alphabet = np.full(at["more"] + 1, at["first"], np.int64)
    alphabet[1:] += np.cumsum(at["gaps"] + 1)
    return SymbolTable(alphabet, at["less"] + 1 if at["more"] else np.ones(1, np.int64))


SPEC = BlockSpec(
    kind=BlockKind.TABLES,
    section="8.3",
    declaration=TABLES,
    parse=lambda payload, reading: unpack_tables(payload, reading.spend),
    pack=pack_tables,
    taken=lambda writing: writing.tables or None,
    count=len,
    elements="table records",
)
