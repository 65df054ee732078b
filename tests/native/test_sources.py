"""What the C sources repeat of Python and SPEC.md."""

from __future__ import annotations

import os
import re

from conformance.spec.spec_text import refusal_classes
from scarfmt.neural.tables import EXP2, SIGMOID, TANH
from tests.conftest import REPOSITORY

SOURCES = REPOSITORY / "scarfmt" / "native"
TABLES = SOURCES / "integer_tables.h"
WIDTH = 120


def declaration(kind: str, name: str, numbers: tuple[int, ...]) -> str:
    """An array in C, in lines of at most WIDTH characters."""
    lines, line = [], "   "
    for number in numbers:
        if len(line) + len(f" {number},") > WIDTH - 2:
            lines.append(line)
            line = "   "
        line += f" {number},"
    return f"static const {kind} {name}[{len(numbers)}] = {{\n" + "\n".join([*lines, line]) + "\n};\n"


def test_tables_are_those_of_the_definition() -> None:
    """The tables of SPEC §10.1 are declared in Python; the header is written here: SCAR_WRITE=1."""
    wanted = (
        "/* TANH, SIGMOID and EXP2 of SPEC 10.1. "
        "Written by tests/native/test_sources.py from scarfmt.neural.tables. */\n\n"
        "#ifndef SCAR_INTEGER_TABLES_H\n#define SCAR_INTEGER_TABLES_H\n\n#include <stdint.h>\n\n"
        + "\n".join(
            [
                declaration("int16_t", "TANH", TANH),
                declaration("int16_t", "SIGMOID", SIGMOID),
                declaration("uint32_t", "EXP2", EXP2),
            ]
        )
        + "\n#endif\n"
    )
    if os.environ.get("SCAR_WRITE"):
        TABLES.write_text(wanted)
    assert TABLES.read_text() == wanted


def test_refusals_have_ids_of_the_format() -> None:
    """An id that SPEC §12.1 does not list could not be acted on. limit-memory is the module's own."""
    known = set(refusal_classes())
    assert len(known) > 80
    pattern = r'(?:"([a-z0-9-]+)"\)|#define BAD "([a-z0-9-]+)")'
    texts = [path.read_text() for path in SOURCES.glob("*.c") if not path.name.startswith("products")]
    used = {one or other for text in texts for one, other in re.findall(pattern, text)}
    assert len(used) > 30
    assert used - known == {"limit-memory"}
