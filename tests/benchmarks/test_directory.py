"""The simulated directory: a front that readers accept, and counts of what a client really asks for."""

from __future__ import annotations

from benchmarks.directory import ASKED_BYTES, Case, Remote, front_of, markdown, measure
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource


def test_a_small_scene_is_measured_as_it_is() -> None:
    """Sums of pages are those of the front; tables name all of it."""
    case = Case(3000, 500)
    found, front = measure(case), front_of(case)
    container = Container.open(BytesSource(front), allow_truncated=True).load()
    assert found["directory_bytes"] == len(front) - container.header.header_length
    pages = round(found["tile_bytes"] * 3000) + round(found["row_bytes"] * 15000)
    assert found["directory_bytes"] == found["root_bytes"] + pages
    assert len(container.directory) == 5 * (3000 + 4)
    assert found["first_bytes"] <= ASKED_BYTES
    assert found["inspect_reads"] == 1
    assert "3,000 tiles" in markdown({"one": found})


def test_a_remote_file_counts_its_head_once() -> None:
    """Bytes of the first request are not requested again, and bytes beyond it are requested alone."""
    front = front_of(Case(2000, 500))
    source = Remote(front, 1000)
    assert source.read(0, 900) == front[:900]
    assert (source.reads, source.bytes_read) == (1, 1000)
    assert source.read(950, 100) == front[950:1050]
    assert (source.reads, source.bytes_read) == (2, 1050)
    assert source.read(2000, 10) == front[2000:2010]
    assert source.read(source.size - 5, 5) == bytes(5)
