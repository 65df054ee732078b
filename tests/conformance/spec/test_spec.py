"""SPEC.md against the code: its tables, ids, limits, registries and worked file."""

from __future__ import annotations

import dataclasses
import json
import re
import struct
from collections import Counter
from enum import IntEnum

import numpy as np
import pytest
from scarfmt_conformance.protocol import STAGES

from conformance.decoders.python import arithmetic as minimal_arithmetic
from conformance.decoders.python.fields import Payload
from conformance.generate import VECTORS
from conformance.spec import worked_network
from conformance.spec.spec_tables import CODE, PAGES, ROOT, SPEC, generated, is_tool_id, raised_ids
from conformance.spec.spec_text import defined
from conformance.spec.worked import field_rows
from conformance.spec.worked_tour import tour_rows
from conformance.writer.oracle import Oracle
from fuzz.testing.network_rows import first_rows, member_rows
from reference_decoder.decode import decode
from scarfmt import limits
from scarfmt.blocks import codebooks, mlp
from scarfmt.blocks import predictors as predictor_codec
from scarfmt.blocks import tables as tables_block
from scarfmt.coding.reader import SceneReader
from scarfmt.container import bytefields
from scarfmt.container.schema import (
    SIGNATURE,
    VERSION,
    BlockFlag,
    BlockKind,
    ColourSpace,
    CoordinateFrame,
    Profile,
    Stream,
)
from scarfmt.container.source import BytesSource
from scarfmt.entropy import rans, rice
from scarfmt.neural import arithmetic, grid, network, predictors, tables
from scarfmt.neural.evaluator import Evaluator
from scarfmt.scene import codebooks as scene_codebooks
from scarfmt.scene import model, streams

TEXT = SPEC.read_text()
RULE = re.compile(r"R-\d+(?:\.\d+)?-\d+")


def section(number: str) -> str:
    """The text of a section, from its heading to the next heading of any level."""
    start = re.search(rf"^#+ (Appendix )?{re.escape(number)}\.? .*$", TEXT, re.MULTILINE)
    assert start is not None, f"no section {number}"
    end = re.search(r"^#+ ", TEXT[start.end() :], re.MULTILINE)
    return TEXT[start.end() : start.end() + end.start()] if end else TEXT[start.end() :]


def rows(text: str) -> list[list[str]]:
    """Cells of the table rows of a text, without heads and rules."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    heads = [i for i, row in enumerate(cells) if all(re.fullmatch(r":?-+:?", cell) for cell in row)]
    return [row for i, row in enumerate(cells) if i not in heads and i + 1 not in heads]


def test_generated_parts_are_up_to_date() -> None:
    """Field tables come from the construct declaration, §4.2 and appendix B from the worked scene."""
    for page in PAGES:
        assert generated(page) == page.read_text(), "run python -m conformance.spec.spec_tables --write"


def test_version_and_signature_are_the_codes() -> None:
    assert f"\nVersion {VERSION[0]}.{VERSION[1]}, " in TEXT
    assert SIGNATURE.hex(" ").upper() in section("5.1")


# ------------------------------------------------------------------------------------------------ rules and refusals


def test_every_rule_id_is_defined_once_and_where_it_says() -> None:
    """Numbers of a section run from 1; every rule cited exists."""
    known = [rule for rule, _ in defined(TEXT)]
    assert not [rule for rule, count in Counter(known).items() if count > 1]
    assert set(RULE.findall(TEXT)) == set(known)
    by_section: dict[str, list[int]] = {}
    for rule in known:
        _, place, number = rule.split("-")
        by_section.setdefault(place, []).append(int(number))
        assert f"**{rule}**" in section(place), f"{rule} is not in section {place}"
    assert all(numbers == list(range(1, len(numbers) + 1)) for numbers in by_section.values()), by_section


def test_every_refusal_of_the_code_is_specified_and_vice_versa() -> None:
    listed = [row[0].strip("`") for row in rows(section("12.1")) if row[0].startswith("`")]
    assert len(listed) == len(set(listed))
    assert set(listed) == {refusal for refusal in raised_ids() if not is_tool_id(refusal)}


def test_refusal_table_and_rules_name_each_other() -> None:
    """A rule that prints an id is in the row of that id, and the other way round."""
    table = {row[0].strip("`"): set(RULE.findall(row[2])) for row in rows(section("12.1")) if row[0].startswith("`")}
    printed: dict[str, set[str]] = {refusal: set() for refusal in table}
    for rule, text in defined(TEXT):
        for refusal in set(re.findall(r"`([a-z]+(?:-[a-z]+)+)`", text)) & set(table):
            printed[refusal].add(rule)
    # One row cites the rule that comes first in a file.
    assert printed["rans-length"] == {"R-8.2-1"}
    table["rans-length"] -= {"R-7.1-3"}
    assert printed == table


def test_sections_the_code_cites_exist() -> None:
    cited: set[str] = set()
    cite = re.compile(r"SPEC[^§\n]{0,12}((?:§[\d.]+\d|§\d+)(?:(?:, |-)§?\d[\d.]*\d?)*)")
    for package in (*CODE, "tests", "conformance"):
        for path in (ROOT / package).rglob("*.py"):
            for match in cite.findall(path.read_text()):
                cited |= {number.rstrip(".") for number in re.findall(r"\d[\d.]*", match)}
    assert len(cited) > 20
    for number in sorted(cited):
        section(number)
    for number in re.findall(r"§([A-C]\b|\d+(?:\.\d+)?)", TEXT):
        section(number)


def test_block_quotes_are_informative() -> None:
    """Block quotes begin with one of three words. They define no rule and oblige nobody, and no note stands outside
    one."""
    quotes = re.findall(r"^> (?:.*\n?> ?)*.*$", TEXT, re.MULTILINE)
    assert len(quotes) > 15
    for quote in quotes:
        assert re.match(r"> \*\*(Why|Example|Note)\.\*\* ", quote), quote
        assert not re.search(r"\*\*R-|\bMUST\b|\bSHOULD\b|\bMAY\b", quote), quote
    assert not re.findall(r"^\*?\*?(?:Note|Why|Example)\b", TEXT, re.MULTILINE)


def test_capital_letters_of_the_pseudo_code_have_one_meaning() -> None:
    """Each is in the table of §3.2, once; counts have names."""
    listed = [word for row in rows(section("3.2")) for word in re.findall(r"\b[A-Z]\b", row[0])]
    assert len(listed) == len(set(listed))
    start, end = TEXT.index("## 5. "), TEXT.index("## Appendix A")
    code = re.findall(r"^```\n(.*?)^```", TEXT[start:end], re.MULTILINE | re.DOTALL)
    used = {letter for block in code for letter in re.findall(r"(?<![\w.])[A-Z](?![\w(-])", re.sub(r"#.*", "", block))}
    assert used
    assert used <= set(listed)


def test_every_refusal_in_a_rule_comes_after_what_must_hold() -> None:
    """No arrow is left that points from either side, as in versions up to 0.1."""
    assert "→" not in TEXT


def test_vectors_cite_rules_that_exist() -> None:
    rules = {rule for path in VECTORS.glob("**/expect.json") for rule in json.loads(path.read_text())["rules"]}
    assert len(rules) > 100
    assert rules - {rule for rule, _ in defined(TEXT)} == set()


def test_every_refusal_of_the_neural_entropy_model_has_a_vector() -> None:
    """Each rule of section 10 that prints an id, with each of its ids."""
    start, end = TEXT.index("## 10. "), TEXT.index("## 11. ")
    rules = defined(TEXT[start:end])
    printed = {(rule, refusal) for rule, text in rules for refusal in re.findall(r"`([a-z]+(?:-[a-z]+)+)`", text)}
    made = [json.loads(path.read_text()) for path in VECTORS.glob("invalid/*/expect.json")]
    assert printed
    assert printed <= {(rule, expect["refusal"]) for expect in made for rule in expect["rules"]}


# ------------------------------------------------------------------------------------------------ numbers


def _constants() -> dict[str, int]:
    found = {name: value for name, value in vars(limits).items() if name.startswith("MAX_")}
    for name in ("MAX_CLASSES", "MAX_CHANNELS", "MAX_COMPONENTS", "MAX_STAGES", "MAX_STEPS"):
        found[name] = getattr(model, name)
    for name in ("MAX_PASSES_LOG2", "MAX_DEPTHS", "MAX_OCCUPANCY"):
        found[name] = getattr(model, name)
    for name in ("MAX_WEIGHT", "MAX_SHIFT", "ACCUMULATOR_LIMIT", "MIN_ACTIVATION_BITS", "MAX_ACTIVATION_BITS"):
        found[name] = getattr(arithmetic, name)
    for name in ("MAX_CODEWORD_DIMS", "MAX_GRU_LAYERS", "MAX_TOKENS", "MAX_HEADS", "MAX_CLUSTERS"):
        found[name] = getattr(network, name)
    return {
        **found,
        "MAX_ALPHABET": rans.MAX_ALPHABET,
        "MAX_TABLES": tables_block.MAX_TABLES,
        "MAX_TABLES_BYTES": tables_block.MAX_TABLES_BYTES,
        "MAX_CODEWORDS": scene_codebooks.MAX_CODEWORDS,
        "MAX_CODEWORD_COMPONENT": codebooks.MAX_VALUE,
        "MAX_LATENT": scene_codebooks.MAX_LATENT,
        "MAX_NETWORKS": mlp.MAX_NETWORKS,
        "MAX_MLP_LAYERS": mlp.MAX_LAYERS,
        "MAX_WIDTH": mlp.MAX_WIDTH,
        "MAX_MLP_BYTES": mlp.MAX_MLP_BYTES,
        "MAX_ZSTD_WINDOW": bytefields.MAX_ZSTD_WINDOW,
        "MAX_RICE_PARAMETER": rice.MAX_PARAMETER,
        "MAX_RICE_QUOTIENT": rice.MAX_QUOTIENT,
        "MAX_PREDICTORS": predictor_codec.MAX_PREDICTORS,
        "MAX_PREDICTOR_INPUTS": predictors.MAX_INPUTS,
        "MAX_PREDICTOR_HIDDEN": predictors.MAX_HIDDEN,
        "MAX_PREDICTOR_CONTEXTS": predictors.MAX_CONTEXTS,
        "MAX_NETWORK_INPUTS": network.MAX_INPUTS,
        "MAX_NETWORK_WIDTH": network.MAX_WIDTH,
        "MAX_GRID_LEVELS": grid.MAX_LEVELS,
        "MAX_GRID_FEATURES": grid.MAX_FEATURES,
        "MAX_GRID_RESOLUTION": grid.MAX_RESOLUTION,
        "MAX_GRID_TABLE_LOG2": grid.MAX_TABLE_LOG2,
        "MAX_GRID_EXTENT_BITS": grid.MAX_EXTENT_BITS,
        "MAX_GRID_BITS": grid.MAX_GRID_BITS,
    }


def test_limits_are_the_codes() -> None:
    """Both tables of section 13 are complete, and so are the two numbers that rules print."""
    assert {row[0].strip("`"): int(row[1]) for row in rows(section("13.1"))} == _constants()
    printed = {row[0].strip("`"): int(row[1]) for row in rows(section("13.2"))}
    assert printed == dataclasses.asdict(limits.DEFAULT_LIMITS)
    assert (limits.FREE_ANCHORS, limits.FREE_SLOTS, model.MAX_FIRST_WIDTH) == (1 << 16, 1 << 19, 2.0**96)
    assert (limits.FREE_CONTENT, limits.FREE_WORK) == (1 << 20, 1 << 32)
    assert "2^20 + `content_per_byte`" in section("13.2")
    assert "2^32 + `work_per_byte`" in section("13.2")
    assert "2^16 + `anchors_per_byte`" in section("5.2")
    assert "2^19 + `slots_per_byte`" in section("5.2")
    assert "at most 2^96" in section("6.4")


@pytest.mark.parametrize(
    ("number", "enum"),
    [("16.1", Profile), ("16.2", CoordinateFrame), ("16.3", ColourSpace), ("16.5", BlockKind), ("16.6", Stream)],
)
def test_registries_are_the_enums(number: str, enum: type[IntEnum]) -> None:
    assert {row[1].strip("`"): int(row[0]) for row in rows(section(number))} == {e.name: int(e) for e in enum}


def test_flag_registry_is_the_enum() -> None:
    listed = {row[2].strip("`"): (int(row[0]), int(row[1])) for row in rows(section("16.4"))}
    assert listed == {flag.name: (int(flag).bit_length() - 1, int(flag)) for flag in BlockFlag}


def test_channel_table_is_the_codes() -> None:
    """Components per profile (R-6.4-1)."""

    def components(cell: str) -> tuple[int | None, bool] | None:
        if cell == "not allowed":
            return None
        number = cell.split(",")[0]
        return (None if number == "d" else int(number), "needed" in cell)

    for profile, column in ((Profile.EXPLICIT, 1), (Profile.ANCHOR, 2)):
        table = [row for row in rows(section("6.4")) if not row[0].startswith("**R-")]
        listed = {Stream[row[0]]: components(row[column]) for row in table}
        assert set(listed) == set(streams.CHANNEL_STREAMS)
        sizes, needed = streams.components(profile), streams.needed(profile)
        assert listed == {s: (sizes[s], s in needed) if s in sizes else None for s in streams.CHANNEL_STREAMS}


def test_the_worked_rice_code_is_the_codes() -> None:
    """Section 5.9 prints four values and their bytes."""
    found = re.search(r"^> \*\*\w+\.\*\* (.*?) have m = .*?`([0-9a-f ]+)` in", section("5.9"), re.MULTILINE | re.DOTALL)
    assert found is not None
    values, data = [int(word) for word in found[1].split(",")], bytes.fromhex(found[2])
    assert rice.pack_rice(np.array(values)) == data
    assert Payload(data).rice(len(values)) == values


# ------------------------------------------------------------------------------------------------ integer networks


def printed_table(name: str) -> list[int]:
    found = re.search(rf"<!-- table:{name} -->\n```\n(.*?)```", TEXT, re.DOTALL)
    assert found is not None
    return [int(word) for word in found[1].split()]


@pytest.mark.parametrize("name", ["TANH", "SIGMOID", "EXP2"])
def test_function_tables_are_those_of_every_implementation(name: str) -> None:
    """Printed, in the package, and from the formulas beside them."""
    assert printed_table(name) == list(getattr(tables, name))
    assert printed_table(name) == getattr(minimal_arithmetic, name)


def evaluated(what: str) -> list[int]:
    """The numbers of a row of appendix C.2."""
    (row,) = [row for row in rows(section("C.2")) if row[0] == what]
    return [int(word) for word in row[1].split()]


def test_the_worked_network_gives_the_frequencies_printed() -> None:
    """By the package's evaluator and by the oracle, neither of which had a part in printing them."""
    net, books, first = worked_network.worked_network(), worked_network.BOOKS, worked_network.FIRST_INDEX
    net.check(books, 2)
    x = evaluated("inputs: class, fine values >> 6")
    assert x == [64, 700 >> 6, -4100 >> 6, 20000 >> 6]
    evaluator = Evaluator(net, books)
    oracle = Oracle(net, books.coarse.tolist(), books.residual.tolist())
    h = evaluator.embed(np.array([x]))
    start = evaluator.start(1)
    y = evaluator.mixed(h, start)
    stage_one = evaluated("stage 1: frequencies")
    assert (first_rows(evaluator, 0, y)[0] + 1).tolist() == stage_one == oracle.top(0, oracle.context(x, []))
    y = evaluator.mixed(h, evaluator.advance(start, 1, np.array([first])))
    clusters = evaluated("stage 2, cluster: frequencies")
    members = evaluated("stage 2, member of cluster 1: frequencies")
    assert y[0].tolist() == evaluated("stage 2: y") == oracle.context(x, [first])
    assert (first_rows(evaluator, 1, y)[0] + 1).tolist() == clusters == oracle.top(1, oracle.context(x, [first]))
    assert (member_rows(evaluator, 1, y, 1)[0] + 1).tolist() == members
    assert oracle.members(1, oracle.context(x, [first]), 1) == members


# ------------------------------------------------------------------------------------------------ the worked file


def worked_bytes() -> bytes:
    """The file as its hex dump in appendix B says."""
    lines = re.findall(r"^([0-9a-f]{4})  ((?:[0-9a-f]{2} ?)+)$", section("B.1"), re.MULTILINE)
    parts = [bytes.fromhex(part) for _, part in lines]
    assert [int(offset, 16) for offset, _ in lines] == [16 * i for i in range(len(lines))]
    return b"".join(parts)


def test_the_printed_hex_is_the_worked_vector() -> None:
    data = worked_bytes()
    assert data == (VECTORS / "worked" / "input.scar").read_bytes()
    assert len(data) <= 900


def test_the_field_table_covers_every_byte_once_with_the_bytes_printed() -> None:
    data, at = worked_bytes(), 0
    printed = rows(section("B.2"))
    for offset, size, shown, _, _ in printed:
        text = shown.strip("`").removesuffix(" ...")
        assert int(offset) == at
        assert data[at:].startswith(bytes.fromhex(text))
        at += int(size)
    assert at == len(data)
    assert len(printed) == len(field_rows(data))


def test_the_tour_shows_every_byte_of_the_worked_vector_once() -> None:
    """§4.2: offsets follow from the bytes printed; only fields of more than 27 bytes are shortened."""
    data, at = (VECTORS / "worked" / "input.scar").read_bytes(), 0
    lines = re.findall(r"^ {0,3}(\d*) +((?:[0-9a-f]{2} )*[0-9a-f]{2}(?: \.\.)?)(?:  |$)", section("4.2"), re.MULTILINE)
    assert len(lines) > 80
    for offset, shown in lines:
        assert offset in ("", str(at))
        part = bytes.fromhex(shown.removesuffix(" .."))
        assert data[at:].startswith(part)
        at += 104 - 18 if shown.endswith("..") else len(part)
    assert at == len(data)


def test_a_tour_of_another_file_is_refused() -> None:
    """The lines of another file's tour would contradict the fields."""
    with pytest.raises(ValueError, match="fields at offset"):
        list(tour_rows((VECTORS / "valid" / "explicit-refined" / "input.scar").read_bytes()))


def test_the_order_of_work_names_every_stage_of_the_suite() -> None:
    """§4.5: each in a step, none that is not there."""
    named = {word for row in rows(section("4.5")) for word in re.findall(r"`([a-z]+)`", row[3])}
    assert named == set(STAGES)


def test_the_worked_file_decodes_to_the_values_printed() -> None:
    """By the reference decoder, which had no part in printing them."""
    data = worked_bytes()
    printed = rows(section("4.4"))
    wanted = iter(printed)
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
    """§13.3 is made by the second decoder; the package's own count is the same, and its parts sum up to it."""
    printed = rows(section("13.3"))
    assert len(printed) >= 3
    for id_, *numbers in printed:
        k, models, splits, tiles, anchors, an_anchor, work = map(int, numbers)
        reader = SceneReader(BytesSource((VECTORS / id_.strip("`") / "input.scar").read_bytes()))
        extent = reader.extent(k, np.arange(reader.header.tile_count))
        assert work == reader.models(k).work.total(extent) == models + splits + tiles + anchors * an_anchor


def test_the_work_of_real_scenes_is_the_same_number_everywhere() -> None:
    """SPEC §15, SECURITY.md and the limit itself say how far real scenes are from it."""
    pages = {
        "SPEC.md": r"Real scenes have up to ([\d,]+) per byte, the 2\^32",
        "SECURITY.md": r"30,000 to ([\d,]+) multiply-adds a byte",
        "scarfmt/limits.py": r"Real scenes need up to ([\d,]+)\.",
    }
    found = {re.search(pattern, (ROOT / page).read_text())[1] for page, pattern in pages.items()}  # type: ignore[index]
    assert found == {"56,000"}
    assert limits.DEFAULT_LIMITS.work_per_byte > 2 * 56_000
