"""Options: what is refused before any work, and pages that say what is so."""

from __future__ import annotations

import re
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest

from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.tuning import LARGE_SCENE
from scarfmt.errors import InvalidInput
from scarfmt.limits import MAX_METADATA_DEPTH

PAGE = Path(__file__).parents[2] / "docs" / "encoder-effort.md"


def _nested(depth: int) -> Any:
    value: Any = 0
    for _ in range(depth - 1):  # the object itself is the first level
        value = [value]
    return {"x": value}


@pytest.mark.parametrize(
    "metadata",
    [{"x": float("inf")}, {"x": float("nan")}, {"x": "\ud800"}, {"x": {1, 2}}, _nested(MAX_METADATA_DEPTH + 1)],
)
def test_metadata_that_no_reader_takes_is_refused_before_the_work(metadata: dict[str, Any]) -> None:
    """Infinity, half a surrogate pair, what is not JSON, and one level too many."""
    with pytest.raises(InvalidInput) as caught:
        EncodeOptions(metadata=metadata).check()
    assert (caught.value.refusal, caught.value.field) == ("input-options", "metadata")


def test_metadata_may_be_as_deep_as_the_format_allows() -> None:
    """One level fewer than the refused."""
    EncodeOptions(metadata=_nested(MAX_METADATA_DEPTH)).check()


def _flat(value: Any, prefix: str = "") -> dict[str, Any]:
    out: dict[str, Any] = {}
    for field in fields(value):
        found, name = getattr(value, field.name), prefix + field.name
        out.update(_flat(found, name + ".") if is_dataclass(found) else {name: found})
    return out


def _told(value: Any) -> str:
    return ("no", "yes")[value] if isinstance(value, bool) else f"{value:,}"


def test_the_page_of_efforts_has_every_number_of_every_level() -> None:
    """docs/encoder-effort.md and EFFORTS: the same names, the same numbers."""
    rows = re.findall(r"\(`([\w.]+)`\) \| (.+) \|$", PAGE.read_text(encoding="utf-8"), flags=re.M)
    levels = [_flat(EFFORTS[level]) for level in sorted(EFFORTS)]
    assert {name: cells.split(" | ") for name, cells in rows} == {
        name: [_told(level[name]) for level in levels] for name in levels[0]
    }
    assert f"{LARGE_SCENE:,}" in PAGE.read_text(encoding="utf-8")


def test_a_fence_needs_cameras() -> None:
    """Only the cameras: refused where there are none."""
    with pytest.raises(InvalidInput) as caught:
        EncodeOptions(only_cameras=True).check()
    assert (caught.value.refusal, caught.value.field) == ("input-options", "only_cameras")


def test_time_counts_unless_bytes_alone_do() -> None:
    """20 megabits a second are 20 bits in a microsecond; for an archive a nanosecond is worth nothing."""
    assert EncodeOptions().bits_per_ns == EncodeOptions(mbit=20).bits_per_ns == 0.02
    assert EncodeOptions(mbit=5).bits_per_ns == 0.005
    assert EncodeOptions(archive=True).bits_per_ns == 0


@pytest.mark.parametrize("mbit", [0, -1, float("nan"), float("inf")])
def test_a_bandwidth_that_is_none_is_refused(mbit: float) -> None:
    """Zero would make time worth nothing: that is what an archive is for."""
    with pytest.raises(InvalidInput) as caught:
        EncodeOptions(mbit=mbit).check()
    assert (caught.value.refusal, caught.value.field) == ("input-options", "mbit")


def test_a_bandwidth_and_an_archive_contradict_each_other() -> None:
    """They contradict each other even if the bandwidth is the default: the user gave it."""
    with pytest.raises(InvalidInput) as caught:
        EncodeOptions(mbit=20, archive=True).check()
    assert (caught.value.refusal, caught.value.field) == ("input-options", "archive")
