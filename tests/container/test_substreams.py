"""TILE framing: a table that fills the block exactly, and a checksum on every part."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scarfmt.container.schema import Stream
from scarfmt.container.substreams import MAX_TABLE_SIZE, check_substream, pack_substreams, unpack_table

KINDS = [kind for kind in Stream if kind not in (Stream.MODELS, Stream.FRAMING)]
STREAMS = st.dictionaries(
    st.sampled_from(KINDS), st.integers(0, 9).flatmap(lambda words: st.binary(min_size=4 * words, max_size=4 * words))
)


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
