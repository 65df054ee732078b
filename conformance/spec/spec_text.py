"""SPEC.md and SPEC-neural.md read by programs: their field tables, rules and refusal ids.

Byte surgery on vectors takes its places from here, not from the package: a table printed wrong shows at once.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SPEC, NEURAL = ROOT / "SPEC.md", ROOT / "SPEC-neural.md"
RULE_ID = re.compile(r"R-\d+(?:\.\d+)?-\d+")
_ID = r"(R-[\d.]+-\d+)"
_IN_LIST = re.compile(rf"^- \*\*{_ID}\*\* (.*?)(?=^- \*\*R-|^#|\n\n|\Z)", re.MULTILINE | re.DOTALL)
# rule | must hold | else
_IN_TABLE = re.compile(rf"^\| \*\*{_ID}\*\* \| ([^\n]*?) \| ([^|\n]*?) ?\|$", re.MULTILINE)
_CHECK = re.compile(rf"^ *check {_ID}: (.*?) *# else ((?:[a-z-]+, )*[a-z-]+)", re.MULTILINE)
_REFUSAL = re.compile(r"`([a-z]+(?:-[a-z]+)+)`")
_ROW = re.compile(r"^\| (\d+) \| (\d+) \| (\w+)(?:\[(\d+)\])? \| `(\w+)` \|", re.MULTILINE)


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
    """Both texts, one after the other."""
    return SPEC.read_text() + NEURAL.read_text()


@cache
def structure(name: str) -> tuple[Place, ...]:
    """The fields of a table such as ``FILE_HEADER``, in file order."""
    found = re.search(rf"<!-- table:{name} -->\n(.*?)<!-- end -->", text(), re.DOTALL)
    if found is None:
        raise LookupError(f"SPEC.md has no table {name}")
    return tuple(Place(int(row[1]), int(row[2]), row[3], int(row[4] or 0), row[5]) for row in _ROW.finditer(found[1]))


def size_of(name: str) -> int:
    """Bytes of a structure."""
    last = structure(name)[-1]
    return last.offset + last.size


def place_of(name: str, field: str) -> Place:
    """One field of a structure."""
    return next(place for place in structure(name) if place.name == field)


def refusal_class(refusal: str) -> str:
    """The class that a refusal id shows (SPEC §12.1)."""
    if refusal.startswith("truncated-"):
        return "truncated"
    if refusal.startswith("unsupported-") or refusal == "unknown-critical-block":
        return "unsupported"
    return "limit" if refusal.startswith("limit-") or refusal == "count-limit" else "malformed"


def refusal_classes() -> dict[str, str]:
    """Every refusal id that a rule prints -> its class, in the order of the rules."""
    return {refusal: refusal_class(refusal) for rule in rules().values() for refusal in rule.refusals}


def find_rules(part: str) -> list[tuple[str, str]]:
    """(id, text on one line) of every rule that a list or a table of `part` defines, in the order of the text."""
    found = [(m.start(), m[1], " ".join(m[2].split())) for m in _IN_LIST.finditer(part)]
    found += [(m.start(), m[1], f"{m[2].removesuffix('.')}; else {m[3]}.") for m in _IN_TABLE.finditer(part)]
    return [(rule, line) for _, rule, line in sorted(found)]


def checks(part: str) -> dict[str, list[tuple[str, list[str]]]]:
    """Rule -> (what must hold, refusal ids) of each line `check` of the layouts and the pseudo-code of `part`."""
    out: dict[str, list[tuple[str, list[str]]]] = {}
    for match in _CHECK.finditer(part):
        out.setdefault(match[1], []).append((match[2], match[3].split(", ")))
    return out


@cache
def rules() -> dict[str, Rule]:
    """Every rule by id: those of lists and tables, in the order of the text, then those that only layouts state."""
    out = {}
    for rule, line in find_rules(text()):
        printed = tuple(dict.fromkeys(_REFUSAL.findall(line)))
        out[rule] = Rule(rule, line, not line.startswith("(V)"), printed)
    for rule, lines in checks(text()).items():
        if rule not in out:
            holds = "; ".join(dict.fromkeys(condition for condition, _ in lines))
            out[rule] = Rule(rule, f"{holds}.", True, tuple(dict.fromkeys(i for _, ids in lines for i in ids)))
    return out
