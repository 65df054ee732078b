"""SPEC.md and SPEC-neural.md against the code: generated parts, ids, limits, registries, worked file and network."""

from __future__ import annotations

import dataclasses
import re
import struct

import numpy as np
from scarfmt_conformance.archive import read

from conformance.spec import worked_network
from conformance.spec.spec_tables import generate
from conformance.spec.spec_text import ROOT, refusal_classes, text
from conformance.writer.oracle import Oracle
from fuzz.testing.network_rows import frequency_rows
from reference_decoder.decode import decode
from scarfmt import limits
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.work import compute_work
from scarfmt.container.schema import SIGNATURE, VERSION, BlockFlag, Stream
from scarfmt.container.source import BytesSource
from scarfmt.neural.evaluator import Evaluator
from scarfmt.scene import model

TEXT = text()
CODE = ("scarfmt", "reference_decoder", "reference_encoder")


def section(number: str) -> str:
    """The text of a section, from its heading to the next heading of any level."""
    start = re.search(rf"^#+ (Appendix )?{re.escape(number)}\.? .*$", TEXT, re.MULTILINE)
    assert start is not None, f"no section {number}"
    end = re.search(r"^#+ ", TEXT[start.end() :], re.MULTILINE)
    return TEXT[start.end() : start.end() + end.start()] if end else TEXT[start.end() :]


def rows(part: str) -> list[list[str]]:
    """Cells of the table rows of a text, without heads and rules."""
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in part.splitlines() if line[:1] == "|"]
    heads = [i for i, row in enumerate(cells) if all(re.fullmatch(r":?-+:?", cell) for cell in row)]
    return [row for i, row in enumerate(cells) if i not in heads and i + 1 not in heads]


def test_generated_parts_are_up_to_date() -> None:
    for page, made in generate().items():
        assert made == page.read_text(), "run python -m conformance.spec.spec_tables --write"


def test_version_and_signature_are_the_codes() -> None:
    assert TEXT.count(f"\nVersion {VERSION[0]}.{VERSION[1]}, ") == 2
    assert SIGNATURE.hex(" ").upper() in section("5.1")


def test_refusals_of_the_code_are_specified_and_vice_versa() -> None:
    """And an error has the class that its id shows (SPEC §12.1)."""
    sources = "".join(path.read_text() for folder in CODE for path in (ROOT / folder).rglob("*.py"))
    specified = refusal_classes()
    assert [refusal for refusal in specified if f'"{refusal}"' not in sources] == []
    raised = set(re.findall(r'\b(Malformed|Truncated|Unsupported|LimitExceeded)\(\s*"([a-z-]+)"', sources))
    assert len(raised) > 50
    of_tools = ("input-", "work-", "output-", "inexact-", "block-range", "truncated-source")
    for error, refusal in raised:
        if not refusal.startswith(of_tools):
            assert specified.get(refusal) == error.removesuffix("Exceeded").lower(), refusal


def test_limits_are_the_codes() -> None:
    printed = {row[0].strip("`"): int(row[1]) for row in rows(section("13.2"))}
    assert printed == dataclasses.asdict(limits.DEFAULT_LIMITS)
    assert (limits.FREE_ANCHORS, limits.FREE_SLOTS, model.MAX_FIRST_WIDTH) == (1 << 16, 1 << 19, 2.0**96)
    assert (limits.FREE_NUMBERS, limits.FREE_WORK) == (1 << 20, 1 << 32)
    bounds = (limits.MAX_TILES, limits.MAX_ANCHORS, limits.MAX_ANCHORS_PER_TILE, limits.MAX_BLOCK_BYTES)
    assert (*bounds, limits.MAX_METADATA_BYTES) == (1 << 24, 1 << 31, 65536, 1 << 31, 1 << 24)


def test_registries_are_the_enums() -> None:
    """The table of block kinds is generated."""
    assert {row[1].strip("`"): int(row[0]) for row in rows(section("16.6"))} == {e.name: int(e) for e in Stream}
    listed = {row[2].strip("`"): (int(row[0]), int(row[1])) for row in rows(section("16.4"))}
    assert listed == {flag.name: (int(flag).bit_length() - 1, int(flag)) for flag in BlockFlag}


def evaluated(what: str) -> list[int]:
    """The numbers of a row of appendix C.2."""
    (row,) = [row for row in rows(section("C.2")) if row[0] == what]
    return [int(word) for word in row[1].split()]


def test_the_worked_network_gives_the_frequencies_printed() -> None:
    """By the package's evaluator and by the oracle, neither of which had a part in printing them."""
    net, books, first = worked_network.worked_network(), worked_network.BOOKS, worked_network.FIRST_INDEX
    net.check(books, 2)
    x = evaluated("inputs: class, fine values >> 6")
    evaluator = Evaluator(net, books)
    oracle = Oracle(net, books.coarse.tolist(), books.residual.tolist())
    h = evaluator.embed(np.array([x]))
    start = evaluator.start(1)
    stage_one = evaluated("stage 1: frequencies")
    y = evaluator.mix(h, start)
    assert (frequency_rows(evaluator, 0, y)[0] + 1).tolist() == stage_one == oracle.top(0, oracle.context(x, []))
    y = evaluator.mix(h, evaluator.advance(start, 1, np.array([first])))
    stage_two = evaluated("stage 2: frequencies")
    assert y[0].tolist() == evaluated("stage 2: y") == oracle.context(x, [first])
    assert (frequency_rows(evaluator, 1, y)[0] + 1).tolist() == stage_two == oracle.top(1, oracle.context(x, [first]))


def test_the_tour_shows_every_byte_of_the_worked_vector_once() -> None:
    """§4.2: offsets follow from the bytes printed; only fields of more than 27 bytes are shortened."""
    data, at = read("worked"), 0
    for offset, shown in re.findall(
        r"^ {0,3}(\d*) +((?:[0-9a-f]{2} )*[0-9a-f]{2}(?: \.\.)?)(?:  |$)", section("4.2"), re.MULTILINE
    ):
        assert offset in ("", str(at))
        part = bytes.fromhex(shown.removesuffix(" .."))
        assert data[at:].startswith(part)
        at += 104 - 18 if shown.endswith("..") else len(part)
    assert at == len(data)


def test_the_worked_file_decodes_to_the_values_printed() -> None:
    """By the reference decoder, which had no part in printing them."""
    data = read("worked")
    wanted = iter(rows(section("4.4")))
    for layer in (1, 2):
        whole = decode(data, layers=layer)
        models = SceneReader(BytesSource(data)).models(layer)
        ((_, content),) = SceneReader(BytesSource(data)).tiles(models)
        for anchor in range(len(whole)):
            row = next(wanted)
            assert [int(cell) for cell in row[:4]] == [layer, anchor, content.classes[anchor], content.codes[anchor]]
            numbers = [[float(x) for x in cell.split(",")] for cell in row[4:]]
            assert whole.positions is not None
            assert numbers[0] == whole.positions[anchor].tolist()
            assert numbers[1] == content.values[0][anchor].tolist()
            assert np.array(numbers[2], np.float32).tobytes() == whole.values[Stream.SCALE][anchor].tobytes()
            assert numbers[3] == content.values[1][anchor].tolist()
            assert struct.pack("<f", numbers[4][0]) == whole.values[Stream.OPACITY][anchor].tobytes()
    assert next(wanted, None) is None


def test_the_values_of_work_are_the_codes() -> None:
    """The readable decoder computed them; the package's own count is the same, and its parts sum up to it."""
    printed = rows(section("13.4"))
    assert len(printed) == 5
    for id_, *numbers in printed:
        k, models, splits, tiles, anchors, an_anchor, work = map(int, numbers)
        reader = SceneReader(BytesSource(read(id_.strip("`"))))
        extent = reader.extent(k, np.arange(reader.header.tile_count))
        assert work == compute_work(reader.models(k), *extent) == models + splits + tiles + anchors * an_anchor
