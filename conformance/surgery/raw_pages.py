"""Pages of any bytes, for files whose directory is wrong (SPEC §5.5)."""

from __future__ import annotations

from dataclasses import dataclass

from conformance.writer.pages import RowPage, TilePage


@dataclass
class RawTiles(TilePage):
    """A tile page of any bytes."""

    data: bytes

    def packed(self) -> bytes:
        return self.data


@dataclass
class RawRows(RowPage):
    """A row page of any bytes."""

    data: bytes

    def packed(self) -> bytes:
        return self.data
