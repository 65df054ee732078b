"""Importers on mutants made by structure."""

from __future__ import annotations

from collections import Counter

from fuzz.importers import FORMATS, case

MUTANTS = 3000


def test_every_kind_of_mutant_is_read_or_refused() -> None:
    """And some of each kind are refused: what is changed matters."""
    outcomes = Counter(case(5, number).act()[0] for number in range(MUTANTS))
    refused = {outcome.split()[0] for outcome in outcomes if not outcome.endswith(" read")}
    assert refused == set(FORMATS)
