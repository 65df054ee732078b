"""Byte sources: exact ranges, honest counters, pipes."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.container.source import HEAD_BYTES, BytesSource, FileSource, open_source, read_bounded
from scarfmt.errors import LimitExceeded, Truncated
from tests.samples.codec_samples import refuses

CONTENT = bytes(i * 7 % 251 for i in range(3 * HEAD_BYTES))


@given(st.binary(max_size=40), st.integers(-3, 45), st.integers(-3, 45))
def test_bytes_source_gives_exact_ranges_or_truncated(data: bytes, offset: int, length: int) -> None:
    """Never fewer bytes than asked for, never an index error."""
    source = BytesSource(data)
    if offset >= 0 and length >= 0 and offset + length <= len(data):
        assert source.read(offset, length) == data[offset : offset + length]
    else:
        refuses("truncated-source", lambda: source.read(offset, length), kind=Truncated)


def test_file_source_reads_only_what_is_asked(tmp_path: Path) -> None:
    """No whole-file read, no hidden buffering."""
    path = tmp_path / "content"
    path.write_bytes(CONTENT)
    with open_source(path) as source:
        assert isinstance(source, FileSource)
        assert source.read(100, 16) == CONTENT[100:116]
        assert source.read(5, 0) == b""
        assert (source.bytes_read, source.reads, source.size) == (16, 1, len(CONTENT))
        refuses("truncated-source", lambda: source.read(len(CONTENT) - 1, 2), kind=Truncated)


def test_a_file_that_shrinks_while_open_is_truncated(tmp_path: Path) -> None:
    """A short read of the system is an error, not short data."""
    path = tmp_path / "content"
    path.write_bytes(CONTENT)
    with open_source(str(path)) as source:
        path.write_bytes(CONTENT[:10])
        refuses("truncated-source", lambda: source.read(0, 11), kind=Truncated)


def test_bytes_of_any_kind_are_accepted() -> None:
    """bytes, bytearray and memoryview need no copy by the caller."""
    for data in (b"abc", bytearray(b"abc"), memoryview(b"abc")):
        assert open_source(data).read(1, 2) == b"bc"


def test_a_pipe_is_read_to_its_end(tmp_path: Path) -> None:
    """A pipe has no size: what comes through it is the file."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(CONTENT,))
    writer.start()
    with open_source(pipe) as source:
        assert source.size == len(CONTENT)
        assert source.read(len(CONTENT) - 5, 5) == CONTENT[-5:]
    writer.join()


def test_an_endless_pipe_is_refused_at_a_limit() -> None:
    with Path("/dev/zero").open("rb") as stream, pytest.raises(LimitExceeded) as caught:
        read_bounded(stream, "/dev/zero", 100_000)
    assert caught.value.refusal == "input-limit"
