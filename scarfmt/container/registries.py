"""Identifiers of the format: profiles, frames, colour spaces, block kinds and flags, stream kinds (SPEC §5.2, §16.4-6).

Nothing but the standard library is imported, so that the command line can name them before it does any work.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag


class Profile(IntEnum):
    """The meaning of an anchor (SPEC §6)."""

    EXPLICIT = 0
    """One Gaussian per anchor; decodes to view-independent 3D Gaussians."""
    ANCHOR = 1
    """`slots` Gaussians per anchor, made by MLPs for a given camera (Scaffold-GS)."""


class CoordinateFrame(IntEnum):
    """The world directions of +x, +y and +z."""

    UNSPECIFIED = 0
    RDF = 1
    """Right, down, forward: COLMAP, INRIA's trainer."""
    RUB = 2
    """Right, up, back: OpenGL, SPZ."""


class ColourSpace(IntEnum):
    """The quantity that decoded colours measure."""

    UNSPECIFIED = 0
    SRGB = 1
    """Display-referred sRGB, blended without linearisation, as 3DGS trains."""
    LINEAR = 2
    """Linear light, sRGB primaries."""


class RenderModel(IntEnum):
    """How the Gaussians are to be drawn: as they were trained."""

    CLASSIC = 0
    """Pictures of Gaussians are widened by 0.3 square pixels, as 3DGS trains."""
    ANTIALIASED = 1
    """They are widened likewise and made fainter in return (Mip-Splatting)."""
    TWO_DIMENSIONAL = 2
    """Flat discs: the third scale is nothing (2DGS)."""


class BlockKind(IntEnum):
    """Block kinds. 1..14 are the models of a layer, 16 its tiles, 15 and 64..127 annotations, 128..255 private use.

    Kind 0 is never assigned. Kinds 1..14 and 16 carry exactly the flag CRITICAL, THUMBNAIL, METADATA and STREAMING
    exactly SAFE_TO_COPY. Only TILE belongs to a tile.
    """

    LAYER = 1
    """Description of one layer."""
    TABLES = 2
    """Static frequency tables."""
    CODEBOOKS = 3
    """RVQ codewords."""
    DECODER_MLP = 4
    """Latent to spherical harmonics (explicit) or to the anchor feature (anchor profile)."""
    SCENE_MLP = 5
    """Opacity, covariance and colour MLPs (anchor profile)."""
    HASH_GRID = 6
    """Binarised hash grid, a spatial source of the index network."""
    ENTROPY_NETWORK = 7
    """Index network: probabilities of RVQ indices."""
    PREDICTORS = 8
    """Context predictors: which static table codes a channel value."""
    THUMBNAIL = 15
    """One small picture of the scene, a WebP, PNG or JPEG file; in layer 1, before the tiles."""
    TILE = 16
    """The sub-streams of one tile of one layer."""
    METADATA = 64
    """One UTF-8 JSON object; in layer 1; changes nothing in the decoded scene."""
    STREAMING = 65
    """Tight boxes of tiles and what their layers gain; in layer 1; changes nothing in the decoded scene."""


READABLE_KINDS = frozenset(BlockKind) - {BlockKind.STREAMING, BlockKind.THUMBNAIL}
"""Kinds that every reader of this version understands. A critical block of any other kind refuses the file, and who
cuts a file keeps one only if it is safe to copy (R-5.4-16, SPEC §14)."""


class BlockFlag(IntFlag):
    """Flags of a directory entry; never both. Other bits are reserved and 0."""

    CRITICAL = 1
    """A reader that does not know the kind must refuse the file."""
    SAFE_TO_COPY = 2
    """An editor that does not know the kind may keep the block although it changed other blocks."""


class Stream(IntEnum):
    """The kinds of data in a block, by which layer summaries count its bytes."""

    MODELS = 0
    """All bytes of every block that is not a TILE block."""
    POSITIONS = 1
    CLASSES = 2
    MASKS = 3
    POSITION_RESIDUAL = 4
    SCALE = 5
    ROTATION = 6
    OPACITY = 7
    COLOUR = 8
    INDICES = 9
    LATENT = 10
    OFFSETS = 11
    FRAMING = 12
    """All else in a TILE block: its sub-stream table, and anything not listed."""
