"""TILE framing: a table that fills the block exactly, and a checksum on every part."""

from __future__ import annotations

import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.container.schema import SUBSTREAM_RECORD, Stream
from scarfmt.container.substreams import MAX_TABLE_SIZE, check_substream, pack_substreams, unpack_table
from scarfmt.errors import Malformed
from tests.samples.codec_samples import refuses

KINDS = [kind for kind in Stream if kind not in (Stream.MODELS, Stream.FRAMING)]
STREAMS = st.dictionaries(
    st.sampled_from(KINDS), st.integers(0, 9).flatmap(lambda words: st.binary(min_size=4 * words, max_size=4 * words))
)
SAMPLE = {Stream.POSITIONS: b"abcd", Stream.SCALE: b"efghijkl"}


def parts(block: bytes) -> dict[Stream, bytes]:
    table = unpack_table(block[:MAX_TABLE_SIZE], len(block))
    return {kind: check_substream(kind, part, block[part.start :][: part.length]) for kind, part in table.items()}


@given(STREAMS)
def test_streams_come_back_and_empty_ones_take_no_room(streams: dict[Stream, bytes]) -> None:
    """Only the head of the block is needed to find them; the order given does not matter."""
    block = pack_substreams(streams)
    wanted = {kind: data for kind, data in streams.items() if data}
    assert parts(block) == wanted
    assert len(block) == 5 + sum(9 + len(data) for data in wanted.values())
    assert pack_substreams(dict(reversed(list(streams.items())))) == block


def block_of(records: list[tuple[int, int]], body: bytes, *, count: int | None = None) -> bytes:
    """A block whose table has the given records, with a right checksum."""
    table = bytes([len(records) if count is None else count])
    for stream, length in records:
        table += SUBSTREAM_RECORD.build({"stream": stream, "length": length, "crc32": 0})
    return table + zlib.crc32(table).to_bytes(4, "little") + body


@pytest.mark.parametrize(
    "block",
    [
        b"",
        b"\x00",
        b"\x00abc",
        block_of([(1, 4)], b""),
        block_of([(1, 4)], b"12345"),
        block_of([], b"x"),
        block_of([(1, 3)], b"123"),
        block_of([(1, 0)], b""),
        block_of([(0, 4)], b"1234"),
        block_of([(Stream.FRAMING, 4)], b"1234"),
        block_of([(200, 4)], b"1234"),
        block_of([(2, 4), (1, 4)], b"12345678"),
        block_of([(2, 4), (2, 4)], b"12345678"),
        block_of([(1, 0xFFFFFFFC), (2, 4)], b"1234"),
        block_of([(1, 4)] * (len(KINDS) + 1), b"1234" * (len(KINDS) + 1)),
        block_of([], b"", count=255),
    ],
    ids=range(16),
)
def test_tables_that_break_the_rule_are_refused(block: bytes) -> None:
    """Unknown kinds, order, lengths that are not whole words, streams that do not fill the block."""
    refuses("bad-substream-table", lambda: unpack_table(block, len(block)))


def test_every_flipped_bit_is_noticed() -> None:
    """By the table's checksum or the stream's own, without the block's."""
    block = pack_substreams(SAMPLE)
    for bit in range(8 * len(block)):
        flipped = bytearray(block)
        flipped[bit // 8] ^= 1 << bit % 8
        with pytest.raises(Malformed) as caught:
            parts(bytes(flipped))
        assert caught.value.refusal in ("crc-mismatch", "bad-substream-table")


@given(st.binary(max_size=80), st.integers(0, 200))
def test_garbage_raises_only_our_errors(data: bytes, length: int) -> None:
    """Any bytes give a result or a refusal, even if the head is shorter than the block says."""
    try:
        table = unpack_table(data, length)
    except Malformed:
        return
    assert sum(part.length for part in table.values()) <= length
