"""The Range header against RFC 9110 §14."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.viewer.ranges import Unsatisfiable, wanted

SIZES = st.integers(0, 1000)


@pytest.mark.parametrize(
    ("header", "part"),
    [
        ("bytes=0-9", (0, 10)),
        ("bytes=10-", (10, 100)),
        ("bytes=-7", (93, 100)),
        ("bytes=-700", (0, 100)),
        ("bytes=90-1000", (90, 100)),
        ("bytes=99-99", (99, 100)),
        (" bytes=1-2 ", (1, 3)),
    ],
)
def test_a_range_is_read_as_the_rfc_says(header: str, part: tuple[int, int]) -> None:
    assert wanted(header, 100) == part


@pytest.mark.parametrize(
    "header",
    [
        *(None, "", "bytes=", "bytes=-", "bytes=5-2", "bytes=0-1,4-5", "lines=0-1", "bytes=a-b", "bytes=٣-٥"),
        f"bytes=0-{'9' * 50}",
    ],
)
def test_what_is_no_single_range_gets_the_whole(header: str | None) -> None:
    """RFC 9110 §14.2: a server may ignore a Range header; a wrong one must be."""
    assert wanted(header, 100) is None


@pytest.mark.parametrize(
    ("header", "size"), [("bytes=100-", 100), ("bytes=100-200", 100), ("bytes=-0", 100), ("bytes=0-", 0)]
)
def test_a_range_without_a_byte_is_refused(header: str, size: int) -> None:
    with pytest.raises(Unsatisfiable):
        wanted(header, size)


@given(SIZES, st.integers(0, 1200), st.integers(0, 1200))
def test_what_is_given_lies_in_the_file(size: int, first: int, last: int) -> None:
    """Whatever is asked for, no byte outside the file is read, and none is left out."""
    try:
        part = wanted(f"bytes={first}-{last}", size)
    except Unsatisfiable:
        assert first >= size
        return
    if part is None:
        assert last < first
    else:
        assert part == (first, min(last + 1, size))
