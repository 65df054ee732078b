"""The TABLES block: static tables as a layer sends them (SPEC §8.3), and which table is worth its bytes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from scarfmt.arrays import I64
from scarfmt.blocks.declare import (
    Check,
    Record,
    Repeat,
    Rule,
    Scope,
    build,
    count,
    read,
    stream_name,
    svarint,
    varint,
    varints,
)
from scarfmt.blocks.spec import BlockSpec
from scarfmt.container.bytefields import compress
from scarfmt.container.registries import BlockKind
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import MAX_ALPHABET, PRECISION, scale_weights
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import Malformed

MAX_TABLES = 1 << 16
MAX_TABLES_BYTES = 64 << 20
_VALUE = 1 << 31
# Weight precisions tried for a table; the cheapest of table bytes + coding loss wins.
_TOP_WEIGHTS = 2.0 ** np.array([3, 5, 7, 9, 11, 13]) - 1
# Weights from which on varints take another byte each.
_LONGER_VARINTS = np.array([1 << 7, 1 << 14])


_TABLE = Record(
    "key" / varint(32, lambda number: _key_text(number)),
    Rule(
        Check("R-8.3-1", "keys ascend", "bad-table"),
        lambda at: _ascends(at),
        lambda at: _bad_table("table keys must ascend strictly"),
    ),
    "size" / count(MAX_ALPHABET) * "symbols",
    Rule(
        Check("R-8.3-1", "size is at least 1", "bad-table"),
        lambda at: at["size"] > 0,
        lambda at: _bad_table("a table needs at least one symbol"),
    ),
    "first" / svarint(33) * "first value of the alphabet",
    Rule(
        Check("R-8.3-1", "the value is -(2^31 - 1)..2^31 - 1", "bad-table"),
        lambda at: abs(at["first"]) < _VALUE,
        lambda at: _beyond(),
    ),
    "gaps"
    / varints(32, "size - 1", lambda gaps, at: _refused_gaps(gaps, at))
    * "each value is the one before + gap + 1; R-8.3-1 holds of each",
    "weights" / varints(24, "size", lambda weights, at: _refused_weights(weights)) * "R-8.3-1 holds of each",
)

TABLES = Record("table_count" / count(MAX_TABLES), "tables" / Repeat("table_count", _TABLE))
"""The content of the frame of a TABLES block."""


def _key_text(number: int) -> str:
    stream, *others = TableKey.from_number(number)
    return f"({stream_name(stream)}, {', '.join(map(str, others))})"


def _ascends(at: Scope) -> bool:
    return not at["earlier"] or at["key"] > at["earlier"][-1]["key"]


def _refused_gaps(gaps: I64, at: Scope) -> Malformed | None:
    return _beyond() if at["first"] + int(gaps.sum()) + len(gaps) >= _VALUE else None


def _refused_weights(weights: I64) -> Malformed | None:
    return _bad_table("weights must be 1 or more") if not weights.all() else None


def _beyond() -> Malformed:
    return _bad_table("alphabet values must fit 32 bits")


def _bad_table(message: str) -> Malformed:
    return Malformed("bad-table", f"{message} (SPEC §8.3)", field="tables")


def fit_table(alphabet: I64, counts: I64) -> SymbolTable:
    """The table whose own bytes plus coding loss on `counts` are least."""
    scaled = np.rint(counts * (_TOP_WEIGHTS / counts.max())[:, None]).astype(np.int64)
    weights = np.maximum(scaled, 1)
    coded = ((PRECISION - np.log2(scale_weights(weights).astype(np.float64))) * counts).sum(axis=1)
    own = np.searchsorted(_LONGER_VARINTS, weights, side="right").sum(axis=1)
    return SymbolTable(alphabet, weights[int(np.argmin(coded + 8 * own))])


def _fields(key: TableKey, table: SymbolTable) -> dict[str, Any]:
    gaps = np.diff(table.alphabet) - 1
    first = int(table.alphabet[0])
    return {"key": key.number, "size": len(gaps) + 1, "first": first, "gaps": gaps, "weights": table.weights}


def pack_table(key: TableKey, table: SymbolTable) -> bytes:
    """One table record of a TABLES block (SPEC §8.3)."""
    return build(_TABLE, _fields(key, table))


def pack_tables(tables: Mapping[TableKey, SymbolTable]) -> bytes:
    """The content of a TABLES block's frame (SPEC §8.3), records by ascending key."""
    records = [_fields(key, tables[key]) for key in sorted(tables)]
    return build(TABLES, {"table_count": len(records), "tables": records})


def unpack_tables(content: bytes) -> dict[TableKey, SymbolTable]:
    """The tables of the content of a frame.

    Raises:
        Malformed: ``bad-table`` for a record that breaks SPEC §8.3.
    """
    tables = read(TABLES, content, "tables")["tables"]
    return {TableKey.from_number(table["key"]): _table(table) for table in tables}


def _table(at: Scope) -> SymbolTable:
    alphabet = np.full(at["size"], at["first"], np.int64)
    alphabet[1:] += np.cumsum(at["gaps"] + 1)
    return SymbolTable(alphabet, at["weights"])


SPEC = BlockSpec(
    kind=BlockKind.TABLES,
    section="8.3",
    declaration=TABLES,
    parse=lambda payload, reading: unpack_tables(reading.inflate(payload, MAX_TABLES_BYTES, "tables")),
    pack=lambda tables: compress(pack_tables(tables)),
    taken=lambda writing: writing.tables or None,
    count=len,
    elements="table records",
    content_limit=MAX_TABLES_BYTES,
    field="tables",
    counted=True,
)
