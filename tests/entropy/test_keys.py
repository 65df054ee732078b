"""Keys of static tables: their order and their numbers (SPEC §8.3)."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scarfmt.entropy.keys import TableKey

KEYS = st.builds(TableKey, *[st.integers(0, 255)] * 4)


@given(KEYS, KEYS)
def test_keys_are_ordered_as_their_numbers(a: TableKey, b: TableKey) -> None:
    """The order of a TABLES block is that of the key's fields, and a number names one key."""
    assert TableKey.from_number(a.number) == a
    assert (a < b) == (a.number < b.number)
