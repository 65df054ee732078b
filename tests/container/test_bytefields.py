"""Varints are canonical, cursors stay inside, and a zstd frame cannot make a reader do more than it says."""

from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pytest
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st

from scarfmt.container.bytefields import (
    MAX_ZSTD_WINDOW,
    ByteReader,
    compress,
    decompress,
    signed_varint,
    unsigned_varint,
    unsigned_varints,
    varints,
)
from scarfmt.errors import InvalidInput, LimitExceeded, Malformed, ScarError

PAYLOAD = b"payload " * 30


def refusal(act: object, *arguments: object) -> tuple[type[ScarError], str]:
    assert callable(act)
    with pytest.raises(ScarError) as caught:
        act(*arguments)
    return type(caught.value), caught.value.refusal


# ------------------------------------------------------------------------------------------------ varints


@given(st.integers(0, 2**63 - 1))
def test_unsigned_varints_come_back(value: int) -> None:
    """In as few bytes as seven bits a byte allow."""
    data = unsigned_varint(value)
    assert len(data) == max(1, -(-value.bit_length() // 7))
    reader = ByteReader(data, "x")
    assert reader.unsigned(63) == value
    reader.finish()


@given(st.lists(st.integers(0, 2**63 - 1) | st.integers(0, 300), max_size=20))
def test_many_varints_are_written_as_one_by_one(values: list[int]) -> None:
    """At once, in the same bytes."""
    assert unsigned_varints(np.array(values, np.int64)) == b"".join(map(unsigned_varint, values))


@given(st.integers(-(2**31), 2**31 - 1))
def test_signed_varints_come_back(value: int) -> None:
    """Through the zigzag map, small magnitudes in few bytes."""
    data = signed_varint(value)
    assert len(data) <= len(unsigned_varint(2 * abs(value)))
    assert ByteReader(data, "x").signed(32) == value


@given(st.binary(min_size=1, max_size=12), st.integers(1, 63))
@example(b"\xff" * 12, 63)
def test_every_accepted_varint_is_the_one_way_to_write_it(data: bytes, bits: int) -> None:
    """Whatever the bytes: a value below 2^bits whose own encoding they are, or a refusal."""
    try:
        value = ByteReader(data, "x").unsigned(bits)
    except Malformed:
        return
    assert value < 1 << bits
    assert data.startswith(unsigned_varint(value))


@pytest.mark.parametrize(
    ("data", "bits", "reason"),
    [
        (b"\x80\x00", 32, "bad-varint"),
        (b"\x81\x80\x00", 32, "bad-varint"),
        (b"\x80\x80\x80\x80\x10", 32, "bad-varint"),
        (b"\xff\xff\xff\xff\xff\x0f", 32, "bad-varint"),
        (b"\x80", 32, "payload-short"),
        (b"", 32, "payload-short"),
    ],
)
def test_overlong_and_cut_varints_are_refused(data: bytes, bits: int, reason: str) -> None:
    """A padded form, a value of too many bits, an end in the middle."""
    assert refusal(ByteReader(data, "x").unsigned, bits) == (Malformed, reason)


def test_a_negative_number_is_no_unsigned_varint() -> None:
    """The writer's fault is named, not looped over."""
    assert refusal(unsigned_varint, -1) == (InvalidInput, "input-varint")
    assert refusal(unsigned_varints, np.array([1, -1])) == (InvalidInput, "input-varint")


# ------------------------------------------------------------------------------------------------ cursor


def test_the_cursor_never_leaves_the_payload() -> None:
    """Reading past the end and leaving a rest are both refusals, with the field's name."""
    reader = ByteReader(b"abcdef", "place")
    assert reader.take(2) == b"ab"
    assert reader.array("<u2", 1).tolist() == [int.from_bytes(b"cd", "little")]
    assert refusal(reader.array, "<u4", 1) == (Malformed, "payload-short")
    assert refusal(reader.take, 3) == (Malformed, "payload-short")
    with pytest.raises(Malformed, match="place") as caught:
        reader.finish()
    assert caught.value.refusal == "payload-long"
    assert reader.take(2) == b"ef"
    reader.finish()


def test_counts_are_compared_before_anything_is_made_of_them() -> None:
    """A count above its limit is a limit, not damage: the caller may raise it."""
    assert ByteReader(unsigned_varint(5), "x").count(5) == 5
    assert refusal(ByteReader(unsigned_varint(6), "x").count, 5) == (LimitExceeded, "count-limit")
    assert refusal(ByteReader(unsigned_varint(2**63 - 1), "x").count, 5) == (LimitExceeded, "count-limit")
    assert refusal(ByteReader(unsigned_varint(2**63), "x").count, 5) == (Malformed, "bad-varint")


# ------------------------------------------------------------------------------------------------ zstd


def frame(descriptor: int, fields: bytes, content: bytes = b"abc", *, last: bool = True) -> bytes:
    """A hand-made frame: magic, descriptor, window/dictionary/size fields, one raw block."""
    block = struct.pack("<I", last | len(content) << 3)[:3] + content
    return bytes.fromhex("28b52ffd") + bytes([descriptor]) + fields + block


@given(st.binary(min_size=1, max_size=300))
def test_zstd_round_trip(content: bytes) -> None:
    """One frame, read back whole, even when the limit is exactly its size."""
    assert decompress(compress(content), len(content), "x") == content


@pytest.mark.parametrize("size", [MAX_ZSTD_WINDOW, MAX_ZSTD_WINDOW + 1, 3 * MAX_ZSTD_WINDOW])
def test_large_payloads_stay_within_the_window(size: int) -> None:
    """A frame of more than 8 MiB that the writer makes is readable by its own rule."""
    data = compress(np.arange(size // 4 + 1, dtype="<u4").tobytes()[:size] if size < 1 << 23 else bytes(size))
    assert zstandard.get_frame_parameters(data).window_size <= MAX_ZSTD_WINDOW
    assert len(decompress(data, size, "x")) == size


def _without_size(content: bytes) -> bytes:
    return zstandard.ZstdCompressor(write_content_size=False).compress(content)


BAD_FRAMES = {
    "empty": b"",
    "not zstd": b"not a zstd frame at all",
    "cut header": compress(PAYLOAD)[:5],
    "cut block": compress(PAYLOAD)[:-1],
    "missing content size": _without_size(PAYLOAD),
    "trailing byte": compress(PAYLOAD) + b"\0",
    "two frames": compress(PAYLOAD) * 2,
    "frame then skippable": compress(PAYLOAD) + bytes.fromhex("502a4d1800000000"),
    "skippable": bytes.fromhex("502a4d1803000000616263"),
    "empty skippable": bytes.fromhex("502a4d1800000000"),
    "no content": compress(b""),
    "no content, then garbage": compress(b"") + b"garbage",
    "no content, cut": compress(b"")[:-1],
    "dictionary id": frame(0x21, b"\x07\x03"),
    "checksum": zstandard.ZstdCompressor(write_checksum=True).compress(PAYLOAD),
    "reserved bit": frame(0x28, b"\x03"),
    "declares less": frame(0x20, b"\x02"),
    "declares more": frame(0x20, b"\x04"),
    "no last block": frame(0x20, b"\x03", last=False),
    "window of 16 MiB": frame(0x80, b"\x70" + struct.pack("<I", 3)),
    "window of 2 GiB": frame(0x80, b"\xa8" + struct.pack("<I", 3)),
    "single segment above 8 MiB": frame(0xA0, struct.pack("<I", (8 << 20) + 1)),
}


@pytest.mark.parametrize("name", BAD_FRAMES)
def test_frames_that_break_the_rule_are_refused(name: str) -> None:
    """Each way not to be one whole frame with its content size, whatever the library thinks of it."""
    assert refusal(decompress, BAD_FRAMES[name], 64 << 20, "x") == (Malformed, "bad-zstd")


def test_hand_made_frames_are_otherwise_fine() -> None:
    """The crafted frames fail for the one thing crafted, not because they are hand-made."""
    assert decompress(frame(0x20, b"\x03"), 3, "x") == b"abc"
    assert decompress(frame(0x80, b"\x68" + struct.pack("<I", 3)), 3, "x") == b"abc"


# The last two are what the library says of a size that it does not know, or that is wrong.
@pytest.mark.parametrize("declared", [1001, 1 << 31, 1 << 62, (1 << 64) - 1, (1 << 64) - 2])
def test_declared_content_above_the_limit_is_refused_before_allocation(declared: int) -> None:
    """A forged size costs no memory."""
    data = frame(0xE0, struct.pack("<Q", declared))
    tracemalloc.start()
    assert refusal(decompress, data, 1000, "x") == (LimitExceeded, "content-limit")
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()


def test_a_bomb_is_stopped_by_its_declared_size() -> None:
    """16 MiB of zeros in a few hundred bytes: refused above the limit; lying about the size does not help."""
    bomb = compress(bytes(16 << 20))
    assert len(bomb) < 4096
    assert refusal(decompress, bomb, (16 << 20) - 1, "x") == (LimitExceeded, "content-limit")
    at = bomb.index(struct.pack("<I", 16 << 20))
    lie = bomb[:at] + struct.pack("<I", 1000) + bomb[at + 4 :]
    tracemalloc.start()
    assert refusal(decompress, lie, 1 << 20, "x") == (Malformed, "bad-zstd")
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()


@given(st.binary(max_size=60), st.integers(0, 40), st.integers(0, 255))
def test_garbage_and_damage_raise_only_our_errors(tail: bytes, place: int, value: int) -> None:
    """Never a zstandard error, never more than the limit."""
    good = bytearray(compress(PAYLOAD))
    good[place % len(good)] = value
    for data in (tail, good[:4] + tail, bytes(good)):
        try:
            content = decompress(bytes(data), 1000, "x")
        except ScarError:
            continue
        assert 0 < len(content) <= 1000


@given(st.lists(st.integers(0, 2**32 - 1) | st.integers(0, 130), max_size=60), st.binary(max_size=12))
def test_many_varints_at_once_are_those_one_by_one(values: list[int], tail: bytes) -> None:
    """Both ways give equal integers, end at the same place, and refuse the same first fault."""
    data = b"".join(map(unsigned_varint, values)) + tail
    for count in (len(values), len(values) + 3):
        for bits in (24, 32):
            answers = []
            for at_once in (False, True):
                reader = ByteReader(data, "x")
                try:
                    found = (
                        reader.unsigned_array(bits, count).tolist()
                        if at_once
                        else [reader.unsigned(bits) for _ in range(count)]
                    )
                    answers.append((found, reader.rest(99)))
                except ScarError as error:
                    answers.append(error.refusal)
            assert answers[0] == answers[1]


BYTES = st.one_of(st.integers(0, 255), st.sampled_from([0, 1, 0x7F, 0x80, 0x81, 0xFF]))


@settings(max_examples=300)
@given(st.lists(BYTES, max_size=40).map(bytes), st.sampled_from([1, 7, 8, 24, 32, 33, 56, 57, 63]))
@example(b"", 24)
@example(unsigned_varint((1 << 56) - 1), 56)
@example(unsigned_varint((1 << 63) - 1), 63)
@example(unsigned_varint(1 << 33), 33)
@example(b"\x80" * 9 + b"\0", 56)
@example(b"\x80" * 9 + b"\1", 63)
def test_a_payload_of_varints_and_nothing_else(data: bytes, bits: int) -> None:
    """A payload of varints alone is read at once as it is one by one. A refused payload or an empty one gives None."""
    reader, wanted = ByteReader(data, "x"), list[int]()
    try:
        while reader.position < len(data):
            wanted.append(reader.unsigned(bits))
    except Malformed:
        wanted = []
    found = varints(data, bits)
    assert (None if found is None else found.tolist()) == (wanted or None)


@settings(max_examples=300)
@given(st.lists(BYTES, max_size=60).map(bytes), st.integers(12, 20), st.sampled_from([7, 8, 24, 32, 56, 63]))
def test_many_varints_of_any_bytes(data: bytes, count: int, bits: int) -> None:
    """At once and one by one: the same integers and place, or the same refusal at the same place."""
    answers = []
    for at_once in (False, True):
        reader = ByteReader(data, "x")
        try:
            one_by_one = () if at_once else [reader.unsigned(bits) for _ in range(count)]
            found = reader.unsigned_array(bits, count).tolist() if at_once else one_by_one
            answers.append((found, reader.position))
        except ScarError as error:
            answers.append((error.refusal, error.message, reader.position))
    assert answers[0] == answers[1]
