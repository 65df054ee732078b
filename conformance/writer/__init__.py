"""The writer of the vectors: the package's symbols in tables, frames, models and pages of the suite's own.

The same scene gives the same bytes on every machine. :class:`WriteOptions` makes files that SPEC.md allows and the
reference encoder never writes.
"""

from conformance.writer.container import write_container
from conformance.writer.fields import RiceStyle
from conformance.writer.file import write_file
from conformance.writer.frames import BlockForm, FrameStyle
from conformance.writer.kept_frames import kept_frame
from conformance.writer.options import Renewal, Weights, WriteOptions
from conformance.writer.tables import table_of

__all__ = [
    "BlockForm",
    "FrameStyle",
    "Renewal",
    "RiceStyle",
    "Weights",
    "WriteOptions",
    "kept_frame",
    "table_of",
    "write_container",
    "write_file",
]
