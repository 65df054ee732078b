"""Streams of bytes that wait until what stands before them in a file is known."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable
from contextlib import ExitStack
from types import TracebackType
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

_MEMORY_BYTES = 1 << 22
"""Maximum bytes of each stream in memory; the rest is on disk."""
_COPY_BYTES = 1 << 20


class Aside:
    """Named streams in temporary files, to be used as a context manager: together as large as what is written.

    Args:
        names: of the streams.
    """

    def __init__(self, names: Iterable[str]):
        self._stack = ExitStack()
        self._streams: dict[str, BinaryIO] = {}
        for name in names:
            spooled = tempfile.SpooledTemporaryFile(_MEMORY_BYTES)  # noqa: SIM115 - the stack closes it
            self._streams[name] = cast(BinaryIO, self._stack.enter_context(spooled))

    def __enter__(self) -> Aside:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the streams, in the order given."""
        return tuple(self._streams)

    def add(self, name: str, values: NDArray[np.generic]) -> None:
        """Append the bytes of an array, in C order."""
        self._streams[name].write(np.ascontiguousarray(values).data)

    def size(self, name: str) -> int:
        """Bytes of a stream so far."""
        return self._streams[name].tell()

    def reopened(self, name: str) -> BinaryIO:
        """A stream from its beginning, to be read."""
        self._streams[name].seek(0)
        return self._streams[name]

    def copy(self, name: str, target: BinaryIO) -> None:
        """Write a stream to `target`."""
        shutil.copyfileobj(self.reopened(name), target, _COPY_BYTES)
