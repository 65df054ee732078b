"""split and merge."""

from __future__ import annotations

from pathlib import Path

import pytest

from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from tests.cli.conftest import run


@pytest.fixture(scope="session")
def many_tiles(folder: Path) -> Path:
    path = folder / "tiles.scar"
    path.write_bytes(write_scene(random_scene(2, Profile.EXPLICIT, tiles=9)))
    return path


def test_numbered_files_are_merged_to_the_file(many_tiles: Path, tmp_path: Path) -> None:
    result = run("split", many_tiles, tmp_path / "part.scar", "--files", 3)
    assert result.exit_code == 0, result.output
    parts = [tmp_path / f"part-{number}.scar" for number in (1, 2, 3)]
    assert sorted(tmp_path.iterdir()) == parts
    assert result.stderr.count("tiles") == 3
    assert run("merge", *reversed(parts), "-o", tmp_path / "again.scar").exit_code == 0
    assert (tmp_path / "again.scar").read_bytes() == many_tiles.read_bytes()


def test_a_box_and_the_rest_are_merged_to_the_file(many_tiles: Path, tmp_path: Path) -> None:
    inside, rest = tmp_path / "a.scar", tmp_path / "b.scar"
    low, high = corner(many_tiles)
    box = ",".join(map(str, (*low, *high)))
    result = run("split", many_tiles, inside, "--box", box, "--rest", rest)
    assert result.exit_code == 0, result.output
    result = run("merge", inside, rest, "-o", "-")
    assert result.stdout_bytes == many_tiles.read_bytes()


def corner(path: Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """A box around the middle of the first tile."""
    from reference_decoder.region import tile_boxes
    from scarfmt.container.file import Container
    from scarfmt.container.source import FileSource
    from scarfmt.scene.model import Lattice

    with FileSource(path) as source:
        container = Container(source)
        fields = container.header.fields
        low, high = tile_boxes(Lattice(fields.origin, fields.voxel, fields.lattice_bits), container.tile_table)
    middle = tuple(float(value) for value in (low[0] + high[0]) / 2)
    return middle, middle


@pytest.mark.parametrize("box", ["1e9,1e9,1e9,2e9,2e9,2e9", "-1e300,-1e300,-1e300,1e300,1e300,1e300"])
def test_a_box_that_divides_nothing_is_told(many_tiles: Path, tmp_path: Path, box: str) -> None:
    result = run("split", many_tiles, tmp_path / "a.scar", "--box", box)
    assert result.exit_code == 2
    assert "input-box" in result.stderr
    assert list(tmp_path.iterdir()) == []
