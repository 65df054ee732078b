"""Truncation is an identity of the writer, verified while copying."""

from __future__ import annotations

import dataclasses
import io

import pytest

from conformance.surgery.parts import flip_bits
from scarfmt.container.file import Block, Container, write_container
from scarfmt.container.schema import BlockFlag
from scarfmt.container.source import BytesSource
from scarfmt.errors import Malformed, Truncated, Unsupported
from scarfmt.tools import assemble
from scarfmt.tools.truncate import truncate, truncate_to
from tests.samples.codec_samples import refuses
from tests.samples.container_samples import COUNTS, FIELDS, TILES, sample_blocks, sample_file


def test_unknown_blocks_are_copied_only_when_that_is_safe() -> None:
    """An editor cannot know what an unsafe annotation says about the dropped layers."""
    safe = Block(200, 1, b"safe", flags=BlockFlag.SAFE_TO_COPY)
    unsafe = Block(201, 1, b"unsafe", flags=0)
    base = sample_blocks()
    data = write_container(FIELDS, TILES, [*base, safe, unsafe], COUNTS)
    kept = [block for block in base if block.layer <= 2]
    assert truncate(BytesSource(data), 2) == write_container(FIELDS, TILES, [*kept, safe], COUNTS[:2])
    assert truncate(BytesSource(data), 3) == data


def test_unknown_critical_blocks_stop_the_editor() -> None:
    """Even in a layer that would be dropped: the file is not understood."""
    critical = Block(200, 2, b"new", flags=BlockFlag.CRITICAL)
    data = write_container(FIELDS, TILES, [*sample_blocks(), critical], COUNTS)
    refuses("unknown-critical-block", lambda: truncate(BytesSource(data), 1), kind=Unsupported)


def test_damage_is_not_copied() -> None:
    """Blocks are verified on the way: a damaged file does not become a valid-looking one."""
    data = flip_bits(sample_file(), Container(BytesSource(sample_file())).entries[1].offset)
    refuses("crc-mismatch", lambda: truncate(BytesSource(data), 1), kind=Malformed)


def test_damage_in_dropped_layers_does_not_matter() -> None:
    """Only what is kept is read."""
    assert truncate(BytesSource(flip_bits(sample_file(), -2)), 2) == sample_file(2)


def test_a_partial_download_becomes_a_whole_file() -> None:
    """Any whole layers that arrived can be saved as a conforming file."""
    data = sample_file()
    end = Container(BytesSource(data)).header.layers[1].end_offset
    assert truncate(BytesSource(data[: end + 3]), 2) == sample_file(2)
    refuses("truncated-block", lambda: truncate(BytesSource(data[: end - 1]), 2), "only 1 arrived", kind=Truncated)


def test_large_blocks_are_copied_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Memory stays bounded, and the pieces join to the same bytes and checksum."""
    monkeypatch.setattr(assemble, "COPY_BYTES", 1000)
    blocks = [dataclasses.replace(sample_blocks()[0], payload=bytes(range(250)) * 13)]
    data = write_container(FIELDS, [], blocks, [(0, 0), (0, 0)])
    source, target = BytesSource(data), io.BytesIO()
    written = truncate_to(source, 1, target)
    assert target.getvalue() == write_container(FIELDS, [], blocks, [(0, 0)])
    assert written == len(target.getvalue())
    assert source.reads == 2 + 4
