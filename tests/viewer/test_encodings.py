"""The Accept-Encoding header against RFC 9110 §12.5.3."""

from __future__ import annotations

import pytest

from scarfmt.viewer.encodings import accepted


@pytest.mark.parametrize(
    ("header", "coding"),
    [
        ("gzip, deflate, br, zstd", "br"),
        ("gzip", "gzip"),
        ("GZip;q=0.5", "gzip"),
        ("br;q=0, gzip;q=1.0", "gzip"),
        ("br; q=0.2", "br"),
        ("br;q=none", None),
        ("br;level=3", None),
        ("identity", None),
        ("", None),
        (None, None),
    ],
)
def test_only_what_a_browser_takes_is_sent(header: str | None, coding: str | None) -> None:
    assert accepted(header, ("br", "gzip")) == coding


def test_only_what_is_there_is_sent() -> None:
    assert accepted("gzip, br", ("gzip",)) == "gzip"
    assert accepted("gzip, br", ()) is None
