"""Points of captures: the same from every format, and one sentence for files that are not what they should be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scarfmt.render.capture.points import colmap_points
from tests.formats.scene_files import ply
from tests.samples.codec_samples import refuses

from . import files

RANDOM = np.random.default_rng(0)
POSITIONS, COLOURS = RANDOM.normal(size=(9, 3)), RANDOM.integers(0, 256, (9, 3), dtype=np.uint8)


def test_colmaps_forms_hold_the_same(tmp_path: Path) -> None:
    """INRIA's trainer leaves a PLY, and people delete what it was made of."""
    assert colmap_points(tmp_path) is None
    forms = {
        "ply": ply([("double", axis) for axis in "xyz"], POSITIONS),
        "txt": files.colmap_points_text(POSITIONS, COLOURS).encode(),
        "bin": files.colmap_points_binary(POSITIONS, COLOURS),
    }
    for ending, data in forms.items():
        (tmp_path / f"points3D.{ending}").write_bytes(data)
        np.testing.assert_array_equal(colmap_points(tmp_path), POSITIONS)


def test_a_binary_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    """So is a count beyond the file, which takes no memory."""
    whole = files.colmap_points_binary(POSITIONS, COLOURS)
    for data in (b"\xff" * 8 + bytes(100), *(whole[:length] for length in range(0, len(whole), 7))):
        (tmp_path / "points3D.bin").write_bytes(data)
        refuses("input-cameras", lambda: colmap_points(tmp_path), "ends too early")


NO_POINT = "expected ID X Y Z .*line 2"


@pytest.mark.parametrize(
    ("line", "said"),
    [("1 2 3", NO_POINT), ("1 a b c 1 2 3", NO_POINT), ("1 0 0 0 1 2", NO_POINT), ("1 0 nan 0 1 2 3 4", "not at a")],
)
def test_lines_that_are_no_points_are_named(tmp_path: Path, line: str, said: str) -> None:
    (tmp_path / "points3D.txt").write_text(f"# x\n{line}\n")
    refuses("input-cameras", lambda: colmap_points(tmp_path), said)
