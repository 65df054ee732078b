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
    frame_header,
    signed_varint,
    unsigned_varint,
    unsigned_varints,
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


BYTES = st.one_of(st.integers(0, 255), st.sampled_from([0, 1, 0x7F, 0x80, 0x81, 0xFF]))


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


MAGIC = bytes.fromhex("28b52ffd")


@given(st.integers(0, 255), st.binary(min_size=0, max_size=16))
def test_headers_are_those_the_package_reads(descriptor: int, rest: bytes) -> None:
    """Every descriptor: both refuse, or both read the same."""
    data = MAGIC + bytes([descriptor]) + rest
    try:
        theirs = zstandard.get_frame_parameters(data)
    except zstandard.ZstdError as error:
        if "too much memory" not in str(error):
            with pytest.raises(Malformed):
                frame_header(data, "x")
        return
    unknown = theirs.content_size == zstandard.CONTENTSIZE_UNKNOWN
    size = 0 if unknown else theirs.content_size
    assert frame_header(data, "x") == (size, theirs.window_size, theirs.dict_id, theirs.has_checksum)


def test_content_is_judged_before_the_window() -> None:
    """R-5.8-2 before R-5.8-3, also of a window that the package does not even report: 2^41 bytes."""
    data = MAGIC + bytes([0x80, 0xF8]) + struct.pack("<I", 1000)
    with pytest.raises(LimitExceeded) as limit:
        decompress(data, 999, "x")
    assert limit.value.refusal == "content-limit"
    with pytest.raises(Malformed) as window:
        decompress(data, 1000, "x")
    assert window.value.refusal == "bad-zstd"
