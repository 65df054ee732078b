"""Taking files apart by SPEC.md's tables: the surgery of the vectors changes what it says and nothing else."""

from __future__ import annotations

import zlib

import pytest

from conformance.faults.limit_faults import crc32_with_zeros
from conformance.faults.truncated_cases import cut_to_layers
from conformance.faults.zstd_faults import zstd_block, zstd_frame
from conformance.spec.spec_text import structure
from conformance.surgery.parts import broken, field_at, header_with, remade, taken_apart
from scarfmt.container.bytefields import decompress
from scarfmt.container.file import Container
from scarfmt.container.schema import field_tables
from scarfmt.container.source import BytesSource
from scarfmt.tools.truncate import truncate
from tests.conformance.vector_files import VECTORS

NAMES = ["worked", "valid/annotations", "valid/anchors-neural", "edge/no-anchors", "edge/sixteen-layers"]


def load(name: str) -> bytes:
    return (VECTORS / name / "input.scar").read_bytes()


@pytest.mark.parametrize("name", NAMES)
def test_a_file_put_together_again_is_the_file(name: str) -> None:
    """The file is equal even if everything that can be computed is computed again."""
    data = load(name)
    assert taken_apart(data).raw() == taken_apart(data).sealed() == remade(data, lambda _: None) == data


def test_the_tables_of_the_specification_are_read_whole() -> None:
    """Every field at its place, with its size."""
    for name, rows in field_tables().items():
        assert [(p.name, p.offset, p.size) for p in structure(name)] == [(r.name, r.offset, r.size) for r in rows]


def test_one_field_changes_itself_and_the_checksum() -> None:
    data = load("worked")
    changed = broken(data, header_with(source_count=7))
    places = {i for i, (a, b) in enumerate(zip(data, changed, strict=True)) if a != b}
    start, crc = field_at("FILE_HEADER", "source_count"), taken_apart(data).header["header_length"] - 4
    assert start in places
    assert places <= {*range(start, start + 8), *range(crc, crc + 4)}
    assert Container.open(BytesSource(changed)).load().header.fields.source_count == 7


@pytest.mark.parametrize("name", NAMES)
def test_the_editor_of_the_vectors_agrees_with_the_package(name: str) -> None:
    """Two of SPEC §14, written apart."""
    data = load(name)
    for layers in range(1, taken_apart(data).header["layer_count"] + 1):
        assert cut_to_layers(data, layers) == truncate(BytesSource(data), layers)


@pytest.mark.parametrize("zeros", [0, 1, 7, 4096, 100_003])
@pytest.mark.parametrize("start", [b"", b"{}"])
def test_checksums_of_zeros_are_those_of_zeros(start: bytes, zeros: int) -> None:
    assert crc32_with_zeros(start, zeros) == zlib.crc32(start + bytes(zeros))


def test_frames_without_a_fault_are_frames() -> None:
    """A frame with a fault is then refused for that fault alone."""
    content = b"0123456789"
    raw = zstd_block(0, len(content), content)
    for frame in (zstd_frame(10, raw), zstd_frame(10, raw, window=80), zstd_frame(10, raw, dictionary=b"\0")):
        assert decompress(frame, 10, "test") == content
