"""The examples of SPEC.md §5, §6 and §13 that are sentences: every number in them is what decoders make of it."""

from __future__ import annotations

import re

import numpy as np
import pytest

from conformance.decoders.python.container import blocks_of_kind
from conformance.decoders.python.decoder import Decoder
from conformance.decoders.python.fields import Payload, Refused, stored
from conformance.expect.work import Work
from conformance.generate import VECTORS
from conformance.spec.spec_text import text
from reference_decoder.decode import decode
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from scarfmt.errors import ScarError
from scarfmt.limits import FREE_CONTENT, FREE_WORK, Limits
from scarfmt.tools.truncate import truncate

WORKED = (VECTORS / "worked" / "input.scar").read_bytes()


def example(number: str) -> str:
    """The example of a section, on one line."""
    start = re.search(rf"^#+ {re.escape(number)} .*$", text(), re.MULTILINE)
    assert start is not None
    found = re.search(r"^> \*\*Example\.\*\* (.*(?:\n> .*)*)", text()[start.end() :], re.MULTILINE)
    assert found is not None
    return found[1].replace("\n> ", " ")


def refusal_of(data: bytes) -> str:
    """The id with which the reference reader refuses the start of a file."""
    with pytest.raises(ScarError) as caught:
        Container.open(BytesSource(data))
    return caught.value.refusal


def test_beginnings_of_files() -> None:
    """§5.1."""
    assert "two bytes `89 53` is truncated" in example("5.1")
    assert refusal_of(bytes.fromhex("89 53")) == "truncated-header"
    assert "`SCAR` alone, or after a byte that is not 0x89, is damaged" in example("5.1")
    assert refusal_of(b"SCAR") == refusal_of(b"xSCAR") == "damaged-signature"
    assert f"`SCA` gives `{refusal_of(b'SCA')}`" in example("5.1")


def test_anchors_of_a_small_file() -> None:
    """§5.2."""
    n = len(WORKED)
    assert f"a file of {n} bytes may have up to 2^16 + {n} = {2**16 + n}" in example("5.2")


def test_gaps_of_pages_and_of_tiles() -> None:
    """§5.4 and §5.5: the gap of the file's page, and what the pseudo-code makes of the tiles after its own."""
    container = Container.open(BytesSource(WORKED))
    ((depth, shift, prefix),) = [(tile.depth, tile.shift, tile.prefix) for tile in container.tiles]
    assert (depth, shift, prefix) == (1, 0, 5)
    base = prefix << 3 * (21 - depth)
    assert base == 5 * 2**60
    assert "so its gap is 5 * 2^60" in example("5.4")
    assert f"its gap would be {((7 << 60) - base) >> 60} * 2^60: `base(1)` is 7 * 2^60" in example("5.4")
    past = (prefix + 1) << 60
    second = -(-past // 2 ** (3 * (21 - 2)))
    assert f"`past` is {past >> 60} * 2^60" in example("5.5")
    assert f"ceil(6 * 2^60 / 2^57) = {second}" in example("5.5")
    assert f"with the gap 3 it would be {second + 3}" in example("5.5")


def test_variable_length_integers() -> None:
    """§5.7."""
    found = example("5.7")
    assert Payload(bytes.fromhex("ac 02")).varint(63) == 300
    assert "300 is `ac 02`" in found
    for value, shown in ((-1, "01"), (1, "02"), (-4, "07")):
        assert Payload(bytes.fromhex(shown)).svarint(33) == value
        assert f"{value} is `{shown}`" in found
    with pytest.raises(Refused, match="bad-varint"):
        Payload(bytes.fromhex("80 00")).varint(63)
    assert "`80 00` is refused" in found


def test_the_corner_of_the_tile_and_the_cell_of_the_first_anchor() -> None:
    """§6.2, by the numbers that the vector pins: position = origin + voxel * (corner + cell + 1/2)."""
    shown = r"corner is \((\d+), (\d+), (\d+)\).*The code (\d+), .* is the cell x (\d), y (\d), z (\d)"
    found = re.search(shown, example("6.2"))
    assert found is not None
    numbers = [int(number) for number in found.groups()]
    corner, code, cell = np.array(numbers[:3]), numbers[3], np.array(numbers[4:])
    assert code == Decoder(WORKED, 1).tile(0).code[0]
    position = np.array([-1.0, 0.5, 2.0]) + 0.25 * (corner + cell + 0.5)
    decoded = decode(WORKED, layers=1).positions
    assert decoded is not None
    assert position.tolist() == decoded[0].tolist()


def test_the_layer_table_of_the_worked_file() -> None:
    """§6.5: how it widens."""
    decoder, found = Decoder(WORKED, 2), example("6.5")
    rows = [[tuple(decoder.steps(k, i, c) for i in range(2)) for c in range(decoder.classes(k))] for k in (1, 2)]
    assert rows == [[(1, 1)], [(2, 1), (1, 1)]]
    assert "one class with the steps (1, 1)" in found
    assert "two classes with (2, 1) and (1, 1)" in found


def test_limits_of_the_worked_file() -> None:
    """§13.2: what its bytes allow, and what it asks for."""
    content = FREE_CONTENT + Limits().content_per_byte * len(WORKED)
    work = FREE_WORK + Limits().work_per_byte * len(WORKED)
    found = example("13.2")
    assert f"2^20 + 8 * 691 = {content} bytes of content" in found
    assert f"2^32 + 131072 * 691 = {work}" in found
    tables = [len(stored(block)) for block in blocks_of_kind(WORKED, "2")]
    assert f"{tables[0]} + {tables[1]} = {sum(tables)} bytes, and {Work(Decoder(WORKED, 2)).total()}" in found


def test_the_worked_file_cut_to_its_first_layer() -> None:
    """§14: where its bytes went."""
    whole, cut = (Container.open(BytesSource(data)) for data in (WORKED, truncate(BytesSource(WORKED), 1)))
    header = whole.header.header_length - cut.header.header_length
    root = whole.header.root_length - cut.header.root_length
    blocks = whole.header.layers[1].byte_count
    pages = whole.header.file_length - cut.header.file_length - header - root - blocks
    found = example("14.")
    assert f"has {whole.header.file_length} bytes, and `truncate(file, 1)` has {cut.header.file_length}" in found
    assert f"of {header} bytes, {root} of what ROOT said of layer 2, its row page of {pages}" in found
    assert f"its blocks of {blocks}" in found
