"""The comparison of both engines on single blocks."""

from __future__ import annotations

from collections import Counter

import pytest

from fuzz.corpus import encoded
from fuzz.engines import Changes, Sound, case
from scarfmt.container.schema import BlockKind
from scarfmt.native.binding import library

pytestmark = pytest.mark.skipif(library() is None, reason="no C library")


def outcomes(numbers: range) -> Counter[tuple[str, str | None]]:
    make = Changes([Sound(seed) for seed in encoded()[:8]], 1)
    return Counter(case(make, number).act() for number in numbers)


def test_both_engines_read_changed_blocks_alike() -> None:
    found = outcomes(range(300))
    assert {finding for _, finding in found} == {None}
    assert found["decoded", None] > 20


def test_another_answer_of_the_library_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scarfmt.native.file.NativeFile.tile_refusal", lambda _: "another")
    assert any(finding and "another" in finding for _, finding in outcomes(range(100)))


def test_a_varint_of_ten_bytes_is_refused_though_its_last_bits_leave_64() -> None:
    """A number below 2^63 remains of what fits in 64 bits."""
    file = next(file for file in map(Sound, encoded()) if any(e.kind == BlockKind.CODEBOOKS for e in file.blocks))
    entry, payload = next((e, data) for e, data in file.blocks.items() if e.kind == BlockKind.CODEBOOKS)
    assert payload[0] < 128
    long = bytes([payload[0] | 128, *[128] * 8, 2]) + payload[1:]
    assert file.answers(entry, long, entry.count) == ("bad-varint", "bad-varint")
