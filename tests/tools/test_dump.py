"""`scarfmt dump`: every byte of any file has exactly one row, and damage ends nothing but what depends on it."""

from __future__ import annotations

import numpy as np
import pytest
from scarfmt_conformance.archive import names, read

from fuzz.testing.scenes import random_scene
from reference_encoder.encode import encode
from reference_encoder.options import EncodeOptions
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Container
from scarfmt.container.registries import BlockKind
from scarfmt.container.source import BytesSource
from scarfmt.formats import load
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.tools.dump import Dump
from scarfmt.tools.fields import SHOWN_ITEMS, Row
from tests.conftest import REPOSITORY


def dumped(data: bytes, full: bool = False) -> tuple[list[Row], list[str]]:
    """The rows, of which those of the file are checked to cover it, and the ids of what was refused."""
    annotated = Dump(BytesSource(data), full=full)
    rows = list(annotated.rows())
    covers(rows, len(data))
    return rows, [error.refusal for error in annotated.refusals]


def covers(rows: list[Row], size: int) -> None:
    """Every byte of the file once, and every adaptive number."""
    at = content = 0
    for row in rows:
        assert row.length > 0
        if row.content:
            content = 0 if row.offset == 0 else content
            assert row.offset == content, row
            content += row.length
        else:
            assert row.offset == at, row
            at += row.length
    assert at == size


@pytest.mark.parametrize(
    ("pattern", "full"), [("valid/*", False), ("valid/*", True), ("edge/*", True), ("worked", False), ("worked", True)]
)
def test_every_byte_of_a_decodable_vector_has_one_row(pattern: str, full: bool) -> None:
    """Nothing is left unread, whether abbreviated or full; `dumped` checks that every byte is covered."""
    wrong = []
    for name in names(pattern):
        rows, refusals = dumped(read(name), full)
        # Decodable to the layer before: what is damaged is covered, too.
        expected = {"crc-mismatch"} if name == "edge/later-layer-damaged" else set()
        if set(refusals) != expected or (not expected and any("not read" in row.field for row in rows)):
            wrong.append((name, refusals))
    assert not wrong


def test_every_byte_of_a_real_scene_has_one_row() -> None:
    """Blocks of real files are larger than those of vectors: tables of hundreds of keys, many tiles."""
    scene = load(REPOSITORY / "examples" / "plush-toys.ply")
    assert isinstance(scene, GaussianScene)
    data = encode(scene.take(np.arange(0, len(scene), 4)), EncodeOptions(effort=1, corrections=0, tile_anchors=1024))
    rows, refusals = dumped(data)
    assert not refusals
    assert not [row for row in rows if "not read" in row.field]


@pytest.mark.parametrize("folder", ["invalid", "truncated", "either"])
def test_damaged_files_are_annotated_as_far_as_they_go(folder: str) -> None:
    """A fifth of the suite's: covered, and never more than a refusal."""
    for name in names(f"{folder}/*")[::5]:
        dumped(read(name))


def test_a_file_cut_anywhere_is_covered() -> None:
    """The cut may lie inside header, tables and blocks, and is refused."""
    data = read("worked")
    for length in range(0, len(data), 23):
        _, refusals = dumped(data[:length])
        assert refusals


def test_what_follows_the_file_is_named() -> None:
    """Bytes after the end belong to no block."""
    data = write_scene(random_scene(3))
    rows, refusals = dumped(data + b"more")
    assert refusals == ["trailing-bytes"]
    assert (rows[-1].field, rows[-1].length) == ("not read", 4)


def test_a_damaged_block_does_not_hide_the_next() -> None:
    """The directory says where it begins."""
    data = bytearray(write_scene(random_scene(3)))
    first = next(entry for entry in Container(BytesSource(bytes(data))).entries if entry.kind == BlockKind.LAYER)
    data[first.offset] = 9
    rows, refusals = dumped(bytes(data))
    assert refusals[:2] == ["crc-mismatch", "rans-seal"]
    assert any(row.field.startswith("layer 1 TABLES.numbers") for row in rows)


def test_only_the_first_of_many_items_are_listed() -> None:
    """Unless all are wanted; the rest is one row."""
    data = write_scene(random_scene(3))
    some, every = ([row.field for row in dumped(data, full)[0]] for full in (False, True))
    hidden = f"tables[{SHOWN_ITEMS}.."
    assert any(hidden in field for field in some)
    assert not any(".." in field for field in every)
    assert len(some) < len(every)
