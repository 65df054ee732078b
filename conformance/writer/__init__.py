"""A second writer of whole files, from SPEC.md's text: it shares no packing, coding or network code with the package.

Everything is integers, so the same scene gives the same bytes on every machine. :class:`WriteOptions` makes files that
SPEC.md allows and the reference encoder never writes.
"""

from conformance.writer.container import write_container
from conformance.writer.entropy import Table
from conformance.writer.fields import RiceStyle
from conformance.writer.file import write_file
from conformance.writer.frames import BlockForm, FrameStyle
from conformance.writer.kept_frames import kept_frame
from conformance.writer.options import Renewal, Weights, WriteOptions
from conformance.writer.tile import tile_block

__all__ = [
    "BlockForm",
    "FrameStyle",
    "Renewal",
    "RiceStyle",
    "Table",
    "Weights",
    "WriteOptions",
    "kept_frame",
    "tile_block",
    "write_container",
    "write_file",
]
