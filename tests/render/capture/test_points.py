"""Points of captures: the same from every format, and one sentence for files that are not what they should be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scarfmt.errors import InvalidInput
from scarfmt.render.capture.points import colmap_points

from . import files

RANDOM = np.random.default_rng(0)
POSITIONS, COLOURS = RANDOM.normal(size=(9, 3)), RANDOM.integers(0, 256, (9, 3), dtype=np.uint8)


def test_colmaps_two_forms_hold_the_same(tmp_path: Path) -> None:
    assert colmap_points(tmp_path) is None
    (tmp_path / "points3D.txt").write_text(files.colmap_points_text(POSITIONS, COLOURS))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "points3D.bin").write_bytes(files.colmap_points_binary(POSITIONS, COLOURS))
    for folder in (tmp_path, tmp_path / "other"):
        found = colmap_points(folder)
        assert found is not None
        np.testing.assert_array_equal(found, POSITIONS)


def test_points_beside_a_model_may_be_a_ply(tmp_path: Path) -> None:
    """INRIA's trainer leaves them, and people delete what it was made of."""
    head = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    (tmp_path / "points3D.ply").write_text(head + "1 2 3\n")
    found = colmap_points(tmp_path)
    assert found is not None
    assert found.tolist() == [[1, 2, 3]]


def test_a_binary_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    whole = files.colmap_points_binary(POSITIONS, COLOURS)
    for length in range(0, len(whole), 7):
        (tmp_path / "points3D.bin").write_bytes(whole[:length])
        with pytest.raises(InvalidInput, match="ends too early"):
            colmap_points(tmp_path)


def test_a_count_beyond_the_file_takes_no_memory(tmp_path: Path) -> None:
    (tmp_path / "points3D.bin").write_bytes(b"\xff" * 8 + bytes(100))
    with pytest.raises(InvalidInput, match="ends too early"):
        colmap_points(tmp_path)


@pytest.mark.parametrize("line", ["1 2 3", "1 a b c 1 2 3", "1 0 0 0 1 2"])
def test_lines_that_are_no_points_are_named(tmp_path: Path, line: str) -> None:
    (tmp_path / "points3D.txt").write_text(f"# x\n{line}\n")
    with pytest.raises(InvalidInput, match=r"expected ID X Y Z .*line 2"):
        colmap_points(tmp_path)
