"""The comparison of both engines on single blocks."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from fuzz.corpus import encoded
from fuzz.engines import Changes, Sound, compare
from fuzz.journal import run
from scarfmt.container.schema import BlockKind
from scarfmt.native.binding import library

pytestmark = pytest.mark.skipif(library() is None, reason="no C library")


def test_both_engines_read_changed_blocks_alike_and_a_log_is_gone_on_with(tmp_path: Path) -> None:
    examine = partial(compare, Changes([Sound(seed) for seed in encoded()[:8]], 1))
    whole, halves = ({"outcomes": {}, "findings": [], "seconds": 0.0} for _ in range(2))
    run(examine, range(300), float("inf"), tmp_path / "whole.json", whole)
    run(examine, range(150), float("inf"), tmp_path / "halves.json", halves)
    run(examine, range(150, 300), float("inf"), tmp_path / "halves.json", halves)
    assert whole["findings"] == []
    assert whole["outcomes"] == halves["outcomes"]
    assert whole["outcomes"]["decoded"] > 20


def test_another_answer_of_the_library_is_a_finding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fuzz.journal.FINDINGS", tmp_path)
    monkeypatch.setattr("scarfmt.native.file.NativeFile.tile_refusal", lambda _: "another")
    done = {"outcomes": {}, "findings": [], "seconds": 0.0}
    run(
        partial(compare, Changes([Sound(seed) for seed in encoded()[:4]], 1)),
        range(100),
        float("inf"),
        tmp_path / "log",
        done,
    )
    assert done["findings"][0]["finding"][1] == "another"


def test_a_varint_of_ten_bytes_is_refused_though_its_last_bits_leave_64() -> None:
    """A number below 2^63 remains of what fits in 64 bits."""
    file = next(file for file in map(Sound, encoded()) if any(e.kind == BlockKind.CODEBOOKS for e in file.blocks))
    entry, payload = next((e, data) for e, data in file.blocks.items() if e.kind == BlockKind.CODEBOOKS)
    assert payload[0] < 128
    long = bytes([payload[0] | 128, *[128] * 8, 2]) + payload[1:]
    assert file.answers(entry, long, entry.count) == ("bad-varint", "bad-varint")
