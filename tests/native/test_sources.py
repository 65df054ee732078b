"""What the C sources repeat of Python and SPEC.md."""

from __future__ import annotations

import re

from conformance.spec.spec_text import refusal_classes
from scarfmt.neural.tables import EXP2, SIGMOID, TANH
from tests.conftest import REPOSITORY

SOURCES = REPOSITORY / "scarfmt" / "native"
TABLES = SOURCES / "integer_tables.h"


def test_tables_are_those_of_the_definition() -> None:
    """The tables of SPEC §10.1 are declared in Python."""
    found = re.findall(r"(\w+)\[(\d+)\] = \{([^}]*)\}", TABLES.read_text())
    wanted = {"TANH": TANH, "SIGMOID": SIGMOID, "EXP2": EXP2}
    assert {name: tuple(map(int, numbers.rstrip(", \n").split(","))) for name, _, numbers in found} == wanted
    assert [int(size) for _, size, _ in found] == [len(table) for table in wanted.values()]


def test_refusals_have_ids_of_the_format() -> None:
    """An id that SPEC §12.1 does not list could not be acted on. limit-memory is the module's own."""
    known = set(refusal_classes())
    assert len(known) > 80
    pattern = r'(?:"([a-z0-9-]+)"\)|#define BAD "([a-z0-9-]+)")'
    texts = [path.read_text() for path in SOURCES.glob("*.c") if not path.name.startswith("products")]
    used = {one or other for text in texts for one, other in re.findall(pattern, text)}
    assert len(used) > 30
    assert used - known == {"limit-memory"}
