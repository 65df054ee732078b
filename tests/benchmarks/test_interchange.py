"""The benchmark of formats written for others: every writer is in it, and its table says what was measured."""

from __future__ import annotations

from benchmarks.interchange import SETTINGS, _turn, markdown
from scarfmt.formats.outputs import OUTPUTS
from tests.formats.odd_scenes import odd_scene


def test_every_format_is_measured() -> None:
    """A .gltf is a .glb in two files."""
    assert {setting.format_id for setting in SETTINGS} | {"gltf"} == {output.id for output in OUTPUTS}


def test_a_turn_writes_and_reads_every_setting_once() -> None:
    found = _turn(odd_scene(1, 300, 1, reach=100.0))
    assert len(found) == len(SETTINGS)
    assert all(write > 0 and read > 0 for write, read in found)


def test_the_table_says_bytes_decibels_and_ratios() -> None:
    row = {"title": "SPZ 4", "bytes": 5000, "psnr_db": 40.04, "p5_psnr_db": 33.3, "worst_psnr_db": 20.0, "kinds": {}}
    plain = {**row, "title": "PLY", "bytes": 25_000, "worst_psnr_db": 100.0, "write": 1.0, "read": 1.0}
    rows = [plain, {**row, "write": 5, "read": 2}]
    text = markdown({"bed": {"count": 100, "sh_degree": 3, "ply_seconds": [0.1, 0.2], "formats": rows}})
    assert "| PLY | 25,000 | 250.0 | equal | 1.0 | 1.0 |" in text
    assert "| SPZ 4 | 5,000 | 50.0 | 40.0 / 33.3 / 20.0 | 5.0 | 2.0 |" in text
    assert "bed: 100 Gaussians, SH 3" in text
