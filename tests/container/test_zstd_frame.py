"""Frame headers as the zstandard package reads them, and those it will not read."""

from __future__ import annotations

import struct

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.container.bytefields import decompress
from scarfmt.container.zstd_frame import frame_header
from scarfmt.errors import LimitExceeded, Malformed

MAGIC = bytes.fromhex("28b52ffd")


@given(st.integers(0, 255), st.binary(min_size=0, max_size=16))
def test_headers_are_those_the_package_reads(descriptor: int, rest: bytes) -> None:
    """Every descriptor: both refuse, or both read the same."""
    frame = MAGIC + bytes([descriptor]) + rest
    try:
        theirs = zstandard.get_frame_parameters(frame)
    except zstandard.ZstdError as error:
        if "too much memory" not in str(error):
            with pytest.raises(Malformed):
                frame_header(frame, "x")
        return
    mine = frame_header(frame, "x")
    unknown = theirs.content_size == zstandard.CONTENTSIZE_UNKNOWN
    assert mine.content_size == (0 if unknown else theirs.content_size)
    assert (mine.window_size, mine.dictionary) == (theirs.window_size, theirs.dict_id)
    assert mine.checksum == theirs.has_checksum


@pytest.mark.parametrize(
    "frame", [b"", MAGIC[:3], MAGIC, MAGIC + b"\x20", MAGIC + b"\x28\x01", b"\x50\x2a\x4d\x18\0\0"]
)
def test_what_is_no_header_is_refused(frame: bytes) -> None:
    """Nothing, cut ones, the reserved bit, a skippable frame."""
    with pytest.raises(Malformed) as caught:
        frame_header(frame, "x")
    assert caught.value.refusal == "bad-zstd"


def test_content_is_judged_before_the_window() -> None:
    """R-5.8-2 before R-5.8-3, also of a window that the package does not even report: 2^41 bytes."""
    frame = MAGIC + bytes([0x80, 0xF8]) + struct.pack("<I", 1000)
    with pytest.raises(LimitExceeded) as limit:
        decompress(frame, 999, "x")
    assert limit.value.refusal == "content-limit"
    with pytest.raises(Malformed) as window:
        decompress(frame, 1000, "x")
    assert window.value.refusal == "bad-zstd"
