"""Values that are computed once from an object and kept for as long as the object lives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, Self, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class Keeper:
    """An object that others may keep something with that they made of it.

    An engine packs tables and networks in its own way, once, however many tiles are decoded with them; the object
    itself need not know what an engine is. Threads may share one: two may make the same thing, and both are given that
    of the first, as what is packed holds addresses of other things that are kept.
    """

    def kept(self, make: Callable[Concatenate[Self, P], T], *arguments: P.args, **named: P.kwargs) -> T:
        """The result of `make` for this object and `arguments`, computed at the first call and returned by later calls.

        Args:
            make: a function or class that lives as long as what it makes is wanted.
            arguments, named: hashable.
        """
        found: dict[Any, Any] = self.__dict__.setdefault("_kept", {})
        key = (make, *arguments, *named.items())
        if key not in found:
            # Not an assignment: it would free what another thread kept meanwhile, and has the address of.
            found.setdefault(key, make(self, *arguments, **named))
        made: T = found[key]
        return made

    def __getstate__(self) -> dict[str, Any]:
        """The state of a copy: it starts without kept values, because these may hold addresses."""
        return {name: value for name, value in self.__dict__.items() if name != "_kept"}
