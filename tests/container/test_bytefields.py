"""Varints are canonical, and cursors stay inside."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from scarfmt.container.bytefields import ByteReader, unsigned_varint, unsigned_varints
from scarfmt.errors import Malformed, ScarError
from tests.samples.codec_samples import refuses


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
    refuses("input-varint", lambda: unsigned_varint(-1))
    refuses("input-varint", lambda: unsigned_varints(np.array([1, -1])))


def test_the_cursor_never_leaves_the_payload() -> None:
    """Reading past the end and leaving a rest are both refusals, with the field's name."""
    reader = ByteReader(b"abcdef", "place")
    assert reader.take(2) == b"ab"
    assert reader.array("<u2", 1).tolist() == [int.from_bytes(b"cd", "little")]
    refuses("payload-short", lambda: reader.array("<u4", 1), kind=Malformed)
    refuses("payload-short", lambda: reader.take(3), kind=Malformed)
    refuses("payload-long", reader.finish, "place", kind=Malformed)
    assert reader.take(2) == b"ef"
    reader.finish()


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
