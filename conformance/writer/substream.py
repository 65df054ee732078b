"""The symbols of one sub-stream, kept until the tables of the layer are known (SPEC §7.1, §8.3)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise

from conformance.writer.entropy import Interval, Tables, intervals, rans, uniform_cumulative


class MissingTable(Exception):
    """The tables given cannot code a symbol: a mistake in a vector's options."""


class Substream:
    """Groups of symbols in decoding order."""

    def __init__(self) -> None:
        # A key with its values, or None with intervals that are known already.
        self._groups: list[tuple[int, list[int]] | tuple[None, list[Interval]]] = []

    def put(self, key: int, values: list[int]) -> None:
        """A group coded with the table of a key."""
        if values:
            self._groups.append((key, values))

    def put_by_context(self, key: int, contexts: Sequence[int], values: Sequence[int]) -> None:
        """One group per distinct context, which is the low byte of the key."""
        groups: dict[int, list[int]] = {}
        for context, value in zip(contexts, values, strict=True):
            groups.setdefault(context, []).append(value)
        for context in sorted(groups):
            self.put(key | context, groups[context])

    def put_uniform(self, size: int, values: Sequence[int]) -> None:
        """Values of 0..size-1, all alike."""
        self.put_listed(uniform_cumulative(size), values)

    def put_listed(self, cumulated: Sequence[int], values: Sequence[int]) -> None:
        """Values of 0..n-1 with the frequencies of c_0 .. c_n."""
        if values:
            spans = [(low, past - low) for low, past in pairwise(cumulated)]
            self._groups.append((None, [spans[value] for value in values]))

    def counts(self) -> Iterator[tuple[int, Counter[int]]]:
        """Key and how often each value occurs, group by group."""
        for group in self._groups:
            if group[0] is not None:
                yield group[0], Counter(group[1])

    def code(self, tables: Tables) -> bytes:
        """The rANS stream, with the tables in force.

        Raises:
            MissingTable: where a key has no table, or its alphabet not the value.
        """
        found: dict[int, dict[int, Interval]] = {}
        out: list[Interval] = []
        for group in self._groups:
            if group[0] is None:
                out += group[1]
                continue
            key, values = group
            if key not in found and key in tables:
                found[key] = intervals(tables[key])
            missing = set(values) - set(found.get(key, ()))
            if missing:
                raise MissingTable(f"no table of {key:#010x} codes {sorted(missing)[:4]}")
            out += [found[key][value] for value in values]
        return rans(out)
