"""A library whose structs lie in memory otherwise than Python declares them is never called."""

from __future__ import annotations

import importlib.util
from ctypes import Structure, c_int32, c_int64, c_void_p
from typing import Any

import pytest

from scarfmt.kernel import loading as module
from scarfmt.kernel.layout import declared, difference, layout_in, layout_of
from scarfmt.kernel.loading import Absent, opened
from tests.kernel.samples import library, needs_kernel

pytestmark = needs_kernel


def grid(*fields: tuple[str, Any]) -> type[Structure]:
    """A struct that takes the place of `Grid`."""
    return type("Grid", (Structure,), {"_fields_": fields})


SOUND = ("levels", c_int64), ("origin", c_int64 * 3), ("extent_bits", c_int64), ("width", c_int64), ("level", c_void_p)
WRONG = {
    "a field narrower": (SOUND[0], SOUND[1], ("extent_bits", c_int32), *SOUND[3:]),
    "two fields swapped": (SOUND[0], SOUND[1], SOUND[3], SOUND[2], SOUND[4]),
    "a field missing at the end": SOUND[:4],
    "a field more at the end": (*SOUND, ("more", c_int64)),
    "an array shorter": (SOUND[0], ("origin", c_int64 * 2), *SOUND[2:]),
    "a field of another name": (("layers", c_int64), *SOUND[1:]),
}


def test_every_struct_of_the_library_is_compared() -> None:
    """All that C lists are declared here, and no more."""
    ours, theirs = layout_of(declared()), layout_in(library())
    assert difference(ours, theirs) is None
    assert len([name for name in theirs if "." not in name]) == len(declared()) == 28
    assert layout_of([grid(*SOUND)]).items() <= theirs.items()


@pytest.mark.parametrize("fields", WRONG.values(), ids=WRONG)
def test_another_layout_is_refused_by_name(
    fields: tuple[tuple[str, Any], ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever differs: place, size, number or name of a field."""
    spec = importlib.util.find_spec("scarfmt.kernel.native")
    assert spec is not None
    assert spec.origin is not None
    changed = [grid(*fields) if kind.__name__ == "Grid" else kind for kind in declared()]
    monkeypatch.setattr(module, "declared", lambda: changed)
    with pytest.raises(Absent, match=r"the layout of Grid(\.\w+)? differs"):
        opened(spec.origin)
