"""Taking files apart by SPEC.md's tables: the surgery of the vectors changes what it says and nothing else."""

from __future__ import annotations

import pytest
from scarfmt_conformance.archive import read

from conformance.surgery.parts import broken, field_at, header_with, remade, taken_apart
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource

NAMES = ["worked", "valid/annotations", "valid/anchors-neural", "edge/no-anchors", "edge/sixteen-layers"]


@pytest.mark.parametrize("name", NAMES)
def test_a_file_put_together_again_is_the_file(name: str) -> None:
    """The file is equal even if everything that can be computed is computed again."""
    data = read(name)
    assert taken_apart(data).raw() == taken_apart(data).sealed() == remade(data, lambda _: None) == data


def test_one_field_changes_itself_and_the_checksum() -> None:
    data = read("worked")
    changed = broken(data, header_with(source_count=7))
    places = {i for i, (a, b) in enumerate(zip(data, changed, strict=True)) if a != b}
    start, crc = field_at("FILE_HEADER", "source_count"), taken_apart(data).header["header_length"] - 4
    assert start in places
    assert places <= {*range(start, start + 8), *range(crc, crc + 4)}
    assert Container.open(BytesSource(changed)).load().header.fields.source_count == 7
