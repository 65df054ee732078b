"""Importers on mutants made by structure."""

from __future__ import annotations

from collections import Counter
from random import Random

from fuzz.importers import FORMATS, examine

MUTANTS = 3000


def test_every_kind_of_mutant_is_read_or_refused() -> None:
    """And some of each kind are refused: what is changed matters."""
    outcomes = Counter(examine(5, number).outcome for number in range(MUTANTS))
    refused = {outcome.split()[0] for outcome in outcomes if not outcome.endswith(" read")}
    assert refused == set(FORMATS)


def test_a_number_always_makes_the_same_mutant() -> None:
    for made in FORMATS.values():
        one, other = (made(Random(7)) for _ in range(2))
        assert one.args == other.args  # type: ignore[attr-defined]
