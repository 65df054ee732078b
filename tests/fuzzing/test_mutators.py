"""The mutators: reproducible, and deep enough that what lies behind the checksums is reached."""

from __future__ import annotations

from collections import Counter

import pytest

from fuzz.target import decoded
from fuzz.testing.block_mutators import stored_frame
from fuzz.testing.mutators import OPERATORS, mutate
from fuzz.testing.parts import put_together, resealed, take_apart
from scarfmt.container.bytefields import decompress


def test_parts_put_together_are_the_file(small_files: list[bytes]) -> None:
    """Taking a file apart loses nothing, and resealing a sound one changes nothing."""
    for data in small_files:
        assert put_together(take_apart(data)) == data
        assert resealed(data) == data


def test_parts_of_a_file_are_the_callers(small_files: list[bytes]) -> None:
    """A change by one caller to the parts is not seen by another."""
    parts = take_apart(small_files[0])
    parts.blocks[0].payload = b""
    parts.tiles.clear()
    assert put_together(take_apart(small_files[0])) == small_files[0]


@pytest.mark.parametrize("operator", OPERATORS)
def test_an_operator_changes_files_and_can_be_repeated(operator: str, small_files: list[bytes]) -> None:
    """From equal seeds the same bytes; from most seeds other bytes than the file's."""
    changed = 0
    for seed in range(40):
        data = small_files[seed % len(small_files)]
        mutant = mutate(data, seed, small_files, operator)
        assert mutant == mutate(data, seed, small_files, operator)
        changed += mutant.data != data
    assert changed >= 20


def test_mutants_reach_everything(small_files: list[bytes]) -> None:
    """Refusals of every part of a reader come up, and files that are still sound."""
    seen: Counter[str] = Counter()
    for seed in range(600):
        seen[decoded(mutate(small_files[seed % len(small_files)], seed, small_files).data)] += 1
    container = {"header-crc-mismatch", "directory-crc-mismatch", "truncated-file", "entry-order", "layer-bytes"}
    models = {"missing-table", "bad-channel", "bad-zstd", "bad-varint", "count-limit", "payload-long"}
    assert container | models | {"", "crc-mismatch", "rans-seal", "bad-substream-table"} <= set(seen)
    assert len(seen) > 35


def test_a_stored_frame_is_one_a_reader_takes() -> None:
    """Frames forged by mutators fail for what is in them."""
    for size in (1, 1000, 300_000):
        assert decompress(stored_frame(bytes(size)), 1 << 20, "x") == bytes(size)
