"""Counts of what a decode reads and holds, which do not depend on the machine."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Counters:
    """Totals of one decode, or of several.

    Attributes:
        bytes_read: bytes transferred from the source, read-ahead included.
        reads: transfers from the source.
        model_blocks, tile_blocks: blocks of which something was read.
        tiles: tiles decoded that have blocks.
        anchors: anchors decoded.
    """

    bytes_read: int = 0
    reads: int = 0
    model_blocks: int = 0
    tile_blocks: int = 0
    tiles: int = 0
    anchors: int = 0
