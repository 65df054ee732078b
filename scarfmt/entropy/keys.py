"""Names of static tables (SPEC §8.3)."""

from __future__ import annotations

from typing import NamedTuple

CONTEXTS = 256
"""Contexts of a component: kind = component's place * CONTEXTS + context."""


class TableKey(NamedTuple):
    """Names a static table: the stream it codes, component, step of refinement and context (SPEC §8.3)."""

    stream: int
    component: int
    step: int
    context: int

    @property
    def number(self) -> int:
        """The key as the unsigned integer that orders and names it in a TABLES block."""
        return (self.stream << 24) | (self.component << 16) | (self.step << 8) | self.context

    @classmethod
    def from_number(cls, number: int) -> TableKey:
        """The inverse of :attr:`number`."""
        return cls(number >> 24, (number >> 16) & 255, (number >> 8) & 255, number & 255)


class StepKey(NamedTuple):
    """Names the tables of one step of some components of a stream: one a component and context.

    A kind is 256 * (a component's place in `components`) + context.
    """

    stream: int
    components: tuple[int, ...]
    step: int

    def table(self, kind: int) -> TableKey:
        """The key of a kind's table."""
        return TableKey(self.stream, self.components[kind // CONTEXTS], self.step, kind % CONTEXTS)
