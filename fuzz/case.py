"""One input of a campaign."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Case:
    """An input and what is done with it.

    Attributes:
        name: its number, then what makes it out.
        data: its bytes; none of an input of several files.
        act: the outcome by which it is counted, and what is wrong with that, or None. It may raise anything.
    """

    name: str
    data: bytes
    act: Callable[[], tuple[str, str | None]]
