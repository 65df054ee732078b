"""SPEC.md read by programs: its field tables, rules and refusal ids.

Byte surgery on vectors takes its places from here, not from the package: a table printed wrong shows at once.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

SPEC = Path(__file__).resolve().parents[2] / "SPEC.md"
RULE_ID = re.compile(r"R-\d+(?:\.\d+)?-\d+")
_IN_LIST = r"- \*\*(R-[\d.]+-\d+)\*\* (.*?)(?=^- \*\*R-|^#|\n\n|\Z)"
# rule | must hold | else; an empty last cell is a rule that no reader detects.
_IN_TABLE = r"\| \*\*(R-[\d.]+-\d+)\*\* \| ([^\n]*?) \| ([^|\n]*?) ?\|$"
_RULE = re.compile(rf"^(?:{_IN_LIST}|{_IN_TABLE})", re.MULTILINE | re.DOTALL)
_IDENTIFIER = re.compile(r"`([a-z]+(?:-[a-z]+)+)`")
_ROW = re.compile(r"^\| (\d+) \| (\d+) \| (\w+)(?:\[(\d+)\])? \| `(\w+)` \|", re.MULTILINE)
_REFUSAL_ROW = re.compile(r"^\| `([a-z-]+)` \| (malformed|truncated|unsupported|limit) \| (.*?) \|$", re.MULTILINE)


@dataclass(frozen=True)
class Place:
    """One field of a structure: where it starts, its type (`u8` .. `u64`, `f64`), and how many numbers it has."""

    offset: int
    size: int
    type: str
    numbers: int
    name: str

    @property
    def single(self) -> bool:
        """Whether it is one number, not several."""
        return self.numbers == 0


@dataclass(frozen=True)
class Rule:
    """One rule.

    Attributes:
        id: such as ``R-5.1-1``.
        text: all of it, on one line.
        checked: False for a rule marked (V), which a decoder may leave unchecked.
        refusals: the ids printed in it.
    """

    id: str
    text: str
    checked: bool
    refusals: tuple[str, ...]

    @property
    def first_sentence(self) -> str:
        """Without the mark (V)."""
        body = self.text.removeprefix("(V) ")
        found = re.match(r".*?\.(?= [A-Z`(]|$)", body)
        return found[0] if found else body


@cache
def text() -> str:
    """SPEC.md."""
    return SPEC.read_text()


@cache
def structure(name: str) -> tuple[Place, ...]:
    """The fields of a table such as ``FILE_HEADER``, in file order."""
    found = re.search(rf"<!-- table:{name} -->\n(.*?)<!-- end -->", text(), re.DOTALL)
    if found is None:
        raise LookupError(f"SPEC.md has no table {name}")
    return tuple(
        Place(int(row[1]), int(row[2]), row[3], int(row[4] or 0), row[5]) for row in _ROW.finditer(found[1])
    )


def size_of(name: str) -> int:
    """Bytes of a structure."""
    last = structure(name)[-1]
    return last.offset + last.size


def place_of(name: str, field: str) -> Place:
    """One field of a structure."""
    return next(place for place in structure(name) if place.name == field)


@cache
def refusal_classes() -> dict[str, str]:
    """Refusal id of §12.1 -> its class, in the order of the table."""
    return {row[1]: row[2] for row in _REFUSAL_ROW.finditer(text())}


def defined(text: str) -> list[tuple[str, str]]:
    """(id, text on one line) of every rule of a part of SPEC.md, in the order of the text, whether list or table."""
    out = []
    for listed, body, row, condition, refusal in _RULE.findall(text):
        line = " ".join(body.split()) if listed else f"{condition.removesuffix('.')}; else {refusal}."
        out.append((listed or row, line if listed or refusal else condition))
    return out


@cache
def rules() -> dict[str, Rule]:
    """Every rule by id, in the order of the text."""
    out = {}
    for rule, line in defined(text()):
        printed = [name for name in _IDENTIFIER.findall(line) if name in refusal_classes()]
        out[rule] = Rule(rule, line, not line.startswith("(V)"), tuple(dict.fromkeys(printed)))
    return out
