"""Whether the structs of the compiled library lie in memory as :mod:`scarfmt.kernel.structs` declares them."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator
from ctypes import Structure, c_char_p, c_int64, sizeof

from scarfmt.kernel import structs

Layout = dict[str, tuple[int, int]]
"""By struct, and by struct.field: where it begins, and its bytes."""


class Place(Structure):
    """One entry of what the library says of itself (layout.c)."""

    _fields_ = (("name", c_char_p), ("offset", c_int64), ("size", c_int64))


def declared() -> list[type[Structure]]:
    """The structs shared with the library."""
    found = vars(structs).values()
    return [each for each in found if isinstance(each, type) and issubclass(each, Structure) and each is not Structure]


def layout_of(kinds: Iterable[type[Structure]]) -> Layout:
    """The layout of structs as ctypes has it."""
    found: Layout = {}
    for kind in kinds:
        found[kind.__name__] = 0, sizeof(kind)
        for name, *_ in kind._fields_:
            field = getattr(kind, name)
            found[f"{kind.__name__}.{name}"] = field.offset, field.size
    return found


def layout_in(library: ctypes.CDLL) -> Layout:
    """The layout that the library was compiled with, from its ``scar_layout``."""
    return {name: (offset, size) for name, offset, size in _places(library)}


def _places(library: ctypes.CDLL) -> Iterator[tuple[str, int, int]]:
    library.scar_layout.restype, library.scar_layout.argtypes = ctypes.POINTER(Place), []
    for place in library.scar_layout():
        if place.name is None:
            return
        yield place.name.decode(), place.offset, place.size


def difference(ours: Layout, theirs: Layout) -> str | None:
    """The first struct or field, by name, that is elsewhere or of another size or in one of the two only; or None."""
    differ = sorted(name for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name))
    return differ[0] if differ else None
