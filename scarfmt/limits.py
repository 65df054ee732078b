"""Numbers that bound what a file may make a reader do (SPEC §13).

`MAX_*` constants are the format's: no conforming file exceeds them. :class:`Limits` is what one reader accepts; a
caller tightens it for untrusted input or raises it for a scene it knows. Passing a limit costs nothing: declared
numbers are compared before anything is allocated from them.
"""

from __future__ import annotations

from dataclasses import dataclass

MAX_LAYERS = 16
"""More refinements than any scene uses; keeps the header below 2.3 KiB, so that one small read shows a whole file."""

MAX_SLOTS = 32
"""Scaffold-GS uses 10."""

MAX_SH_DEGREE = 3
"""The degree that 3DGS and all rival formats store."""

MAX_LATTICE_BITS = 32
"""Below a micrometre over a kilometre; lattice coordinates fit in 32 bits."""

MAX_TILE_DEPTH = 21
"""3 * 21 = 63 bits: a tile prefix fits in 64 bits, with room for one past the last cube."""

MAX_LOCAL_BITS = 21
"""A Morton code of coordinates inside a tile fits in 63 bits."""

MAX_TILES = 1 << 24
"""A scene of 10^9 Gaussians in tiles of a few hundred; the number fits 24 bits of anything."""

MAX_PAGE_BITS = 16
"""A page of so many tiles is read at once: at most 1.8 MB."""

MAX_ROOT_BYTES = (1 << 32) - 1
"""The maximum of its field."""

MAX_ANCHORS = 1 << 31
"""Indices fit in 32 bits, signed too."""

MAX_ANCHORS_PER_TILE = 1 << 16
"""Per TILE block. One block is decoded at once: this bounds the memory of a streaming reader. With at least 8 bytes of
row page and 5 of its own per block it also bounds expansion, to 5041 anchors per byte of file."""

MAX_BLOCK_BYTES = 1 << 31
"""A block is read and checked at once."""

MAX_FILE_LENGTH = (1 << 53) - 1
"""Every offset is exact in a binary64, the only number type of some readers; sums of two do not overflow 64 bits."""

MAX_METADATA_BYTES = 1 << 24
"""JSON is for people and catalogues, not for payloads."""

MAX_THUMBNAIL = 65_535
"""A picture that comes before everything else must not keep anybody waiting."""

MAX_METADATA_DEPTH = 64
"""Far more than catalogues nest, and far below the recursion that any JSON parser stands."""


FREE_ANCHORS = 1 << 16
"""Any file may ask for so many anchors: what a file may ask for beyond grows with its bytes."""

FREE_SLOTS = 1 << 19
"""How many Gaussian slots a file of some bytes may unfold to: anchors times slots, in the anchor profile."""

FREE_NUMBERS = 1 << 20
"""Adaptive numbers that the blocks of any file may have together."""

FREE_WORK = 1 << 32
"""Multiply-adds, or what takes as long, that any file may ask for: about a second."""


@dataclass(frozen=True)
class Limits:
    """The limits of a reader. A file that declares more is refused with LimitExceeded.

    Attributes:
        tiles: in the file. 2^20 of them are 10^9 Gaussians and more.
        root_bytes: bytes of ROOT, which is read at once.
        anchors: anchors after the last layer. A scene need not fit the memory of who reads it tile by tile.
        gaussians: Gaussians after the last layer.
        gathered: anchors that a decoder holds at once, where it gives a whole scene. 2^26 is ten times the largest
            public scene.
        gathered_slots: as `gathered`, anchors times slots.
        tile_anchors: anchors that first appear in one TILE block.
        block_bytes: bytes of one block. 2^28 is far above a full tile with all its attributes.
        anchors_per_byte: anchors per byte of the whole file, beyond `FREE_ANCHORS`. Real scenes stay below 0.2; only
            made-up ones, such as a full cube of one colour, need more than 1.
        slots_per_byte: anchors times slots per byte of the whole file, beyond `FREE_SLOTS`. Real models: about 0.5.
        numbers_per_byte: adaptive numbers per byte of the whole file, beyond `FREE_NUMBERS`. Real files have below 0.5.
        work_per_byte: multiply-adds of decoding, counted as in :mod:`scarfmt.coding.work`, per byte of the whole file,
            beyond `FREE_WORK`. Real scenes need up to 56,000.
        metadata_bytes: bytes of the METADATA block, when it is parsed.
    """

    tiles: int = 1 << 20
    root_bytes: int = 1 << 24
    anchors: int = MAX_ANCHORS
    gaussians: int = MAX_ANCHORS * MAX_SLOTS
    gathered: int = 1 << 26
    gathered_slots: int = 1 << 28
    tile_anchors: int = MAX_ANCHORS_PER_TILE
    block_bytes: int = 1 << 28
    anchors_per_byte: int = 1
    slots_per_byte: int = 8
    numbers_per_byte: int = 2
    work_per_byte: int = 1 << 17
    metadata_bytes: int = 1 << 20


DEFAULT_LIMITS = Limits()

FORMAT_LIMITS = Limits(
    tiles=MAX_TILES,
    root_bytes=MAX_ROOT_BYTES,
    gathered=MAX_ANCHORS,
    gathered_slots=MAX_ANCHORS * MAX_SLOTS,
    block_bytes=MAX_BLOCK_BYTES,
    anchors_per_byte=MAX_ANCHORS_PER_TILE,
    slots_per_byte=MAX_ANCHORS_PER_TILE * MAX_SLOTS,
    numbers_per_byte=MAX_FILE_LENGTH,
    work_per_byte=MAX_FILE_LENGTH,
    metadata_bytes=MAX_METADATA_BYTES,
)
"""The format's own maxima: what a writer must respect."""
