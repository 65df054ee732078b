"""The `Accept-Encoding` header of a request (RFC 9110 §12.5.3): which compressed form of a file a browser takes."""

from __future__ import annotations

from collections.abc import Collection

SUFFIXES = {"br": ".br", "gzip": ".gz"}
"""By content coding, the smallest first: what the name of a file compressed that way ends with."""


def accepted(header: str | None, offered: Collection[str]) -> str | None:
    """The first coding of `SUFFIXES` that is among those offered, and that the header names without refusing it."""
    taken = {name.strip().lower() for name, weight in map(_parted, (header or "").split(",")) if weight > 0}
    return next((coding for coding in SUFFIXES if coding in offered and coding in taken), None)


def _parted(item: str) -> tuple[str, float]:
    """A coding and its weight; 0 for one that cannot be read."""
    name, _, parameter = item.partition(";")
    key, _, weight = parameter.replace(" ", "").partition("=")
    if not parameter.strip():
        return name, 1.0
    try:
        return name, float(weight) if key.lower() == "q" else 0.0
    except ValueError:
        return name, 0.0
