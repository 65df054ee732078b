"""The choices of a file that SPEC.md leaves to the encoder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from conformance.writer.pages import PAGE_BITS
from scarfmt.container.file import Block
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable

MAX_TABLE_WEIGHT = (1 << 24) - 1
Tables = Mapping[TableKey, SymbolTable]


class Weights(Enum):
    """The weights of tables made from the symbols of a layer; with more than one symbol they change every stream."""

    COUNTS = "counts"
    """How often each value occurs, at least 1."""
    UNIFORM = "uniform"
    """All 1."""
    REVERSED = "reversed"
    """The counts in reverse order."""
    STEEP = "steep"
    """2^24 - 1 for the last value, 1 for all others: frequencies of 1."""


class Renewal(Enum):
    """When a layer sends a table for symbols it codes, where one of an earlier layer is in force."""

    NEEDED = "needed"
    """When that one lacks a value."""
    ALWAYS = "always"
    """A new one, of this layer's symbols."""
    REPEATED = "repeated"
    """As NEEDED, and all tables in force are sent again, unchanged."""


@dataclass(frozen=True)
class WriteOptions:
    """The default is a plain file: tables of the values that occur, nothing that codes nothing.

    Attributes:
        fitted: whether tables are made from the symbols.
        tables: by layer; tables sent besides, and in place of those made from the symbols.
        weights, unused: of the tables made from the symbols: their weights; values added to each alphabet.
        renewal: when later layers send tables.
        empty_tiles: whether there is a TILE block for every tile and layer, also of neither anchors nor records.
        metadata: bytes of the METADATA block; None: the scene's, as R-7.10-2 recommends, or no block.
        blocks: further blocks.
        page_bits: a page has 2^page_bits tiles.
    """

    fitted: bool = True
    tables: Mapping[int, Tables] = field(default_factory=dict)
    weights: Weights = Weights.COUNTS
    unused: tuple[int, ...] = ()
    renewal: Renewal = Renewal.NEEDED
    empty_tiles: bool = False
    metadata: bytes | None = None
    blocks: tuple[Block, ...] = ()
    page_bits: int = PAGE_BITS
