"""The model of a decoder: declared once, dated, and nothing in it is free."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

from scarfmt.coding.decoder_model import DECODER

ROOT = Path(__file__).parents[2]


def test_every_figure_takes_time_and_says_where_it_is_from() -> None:
    """A mechanism that costs nothing would always be kept."""
    for field in fields(DECODER):
        found = getattr(DECODER, field.name)
        assert found if isinstance(found, str) else found > 0
    assert re.fullmatch(r"\d{4}-\d{2}-\d{2}", DECODER.date)


def test_nobody_else_declares_one() -> None:
    """One place for each fact: encoder and reports read the same nanoseconds."""
    sources = [path for folder in ("scarfmt", "reference_encoder") for path in (ROOT / folder).rglob("*.py")]
    makers = [path.name for path in sources if "DecoderModel(" in path.read_text(encoding="utf-8")]
    assert makers == ["decoder_model.py"]
