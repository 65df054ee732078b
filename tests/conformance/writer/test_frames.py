"""Frames and Rice codes of the suite's writer: what it may vary, every reader must take."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from conformance.decoders.python.fields import Payload
from conformance.decoders.python.zstd import BadFrame, NeedsLibrary, frame_content
from conformance.writer import BlockForm, FrameStyle, RiceStyle, kept_frames
from conformance.writer.fields import rice, shifted, svarint, varint
from conformance.writer.kept_frames import kept_frame
from scarfmt.container.bytefields import decompress

WINDOWS = (None, 0, 5, 0x18, 0x68)
RUNS = st.builds(lambda piece, n: piece * n, st.binary(min_size=1, max_size=3), st.integers(1, 900))
PIECES = st.binary(min_size=1, max_size=40) | RUNS
CONTENTS = st.lists(PIECES, min_size=1, max_size=12).map(b"".join)
STYLES = st.builds(
    FrameStyle,
    st.sampled_from(BlockForm),
    st.sampled_from((0, 1, 2, 4, 8)),
    st.sampled_from(WINDOWS),
    st.sampled_from((0, 1, 2, 4)),
    st.sampled_from((1, 7, 1000, 1 << 17)),
    st.booleans(),
)


@settings(deadline=None, max_examples=300)
@given(CONTENTS, STYLES)
def test_the_library_and_the_second_decoder_read_every_style(content: bytes, style: FrameStyle) -> None:
    """The frames keep the rules of SPEC §5.8. A style that cannot hold the content is refused."""
    single = style.window is None
    fits = {1: single and len(content) < 256, 2: 256 <= len(content) < 65792}.get(style.size_bytes, True)
    compressed = style.form in (BlockForm.LITERALS, BlockForm.MATCHES)
    if not fits or (compressed and single):
        with pytest.raises(ValueError):
            style(content)
        return
    frame = style(content)
    assert decompress(frame, 1 << 26, "test") == content
    assert frame_content(frame) == content


def test_matches_make_frames_smaller() -> None:
    """The frames contain matches within a block, into earlier blocks, and ones that overlap themselves."""
    style, content = FrameStyle(BlockForm.MATCHES, window=0x18, most=50), bytes(range(40)) * 3 + b"ab" * 60
    frame = style(content)
    assert len(frame) < len(content) // 2
    assert frame_content(frame) == decompress(frame, 1000, "test") == content


def test_the_default_frame_is_the_smallest_of_raw_blocks() -> None:
    """Sizes at the bounds of the content size field."""
    for size, head in ((255, "20ff"), (256, "600000"), (65791, "60ffff"), (65792, "a000010100")):
        assert FrameStyle()(bytes(size))[4 : 4 + len(head) // 2].hex() == head


def test_broken_frames_are_told_from_those_that_need_a_library() -> None:
    """The second decoder gives bad-zstd for the first and cannot judge the second."""
    frame = FrameStyle(BlockForm.MATCHES, window=0x18)(b"abcd" * 9)
    for broken in (frame[:-1], frame + b"\0", frame[:4] + b"\xff" + frame[5:], b"\0" + frame):
        with pytest.raises(BadFrame):
            frame_content(broken)
    with pytest.raises(NeedsLibrary):
        frame_content(zstandard.ZstdCompressor(level=19).compress(b"the quick brown fox jumps over the lazy dog" * 9))


def test_kept_frames_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is not kept is made only when that is asked for; one that is kept is never made again."""
    content = b"content"
    monkeypatch.setattr(kept_frames, "PLACE", tmp_path / "frames.json")
    with pytest.raises(LookupError):
        kept_frame(content)
    monkeypatch.setenv(kept_frames.ADD, "1")
    made = kept_frame(content)
    assert decompress(made, 100, "test") == content
    kept_frames.PLACE.write_text(json.dumps({hashlib.sha256(content).hexdigest(): "a2VwdA=="}))
    assert kept_frame(content) == b"kept"


@given(st.lists(st.integers(-(2**31), 2**31 - 1) | st.integers(-300, 300), max_size=30), st.integers(-31, 31))
def test_rice_codes_come_back_with_every_parameter(values: list[int], raised: int) -> None:
    """No quotient exceeds 255 whatever is added to the best parameter, or taken from it."""
    payload = Payload(rice(values, RiceStyle(raised)))
    assert payload.rice(len(values)) == values
    payload.finish()


def test_the_worked_rice_code() -> None:
    """SPEC §5.9, note."""
    assert rice([0, -1, 3, -2], RiceStyle()).hex() == "013a50"


@given(st.lists(st.integers(-(2**20), 2**20), max_size=9), st.integers(0, 10), st.integers(0, 31), st.integers(0, 31))
def test_shifted_numbers_come_back(values: list[int], zeros: int, most: int, zero_shift: int) -> None:
    """Zero bits are left out up to the number allowed; the shift of zeros is free."""
    numbers = [value << zeros for value in values]
    data = shifted(numbers, RiceStyle(most_shift=most, zero_shift=zero_shift))
    assert Payload(data).shifted(len(numbers)) == numbers
    assert data[0] == zero_shift if not any(numbers) else min(zeros, most) <= data[0] <= most


@given(st.integers(0, 2**63 - 1), st.integers(-(2**32), 2**32 - 1))
def test_variable_length_integers_come_back(unsigned: int, signed: int) -> None:
    """Integers are written as short as possible: the reader refuses longer forms."""
    assert Payload(varint(unsigned)).varint(63) == unsigned
    assert Payload(svarint(signed)).svarint(33) == signed
