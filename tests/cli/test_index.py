"""Scene indices on the command line: made, described, decoded, cut and checked as one scene."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from scarfmt.formats import load
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene_index.document import parse_index
from tests.scene_index.scenes import NAMES, PLACED, scene_folder

from .conftest import Run


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return scene_folder(tmp_path, PLACED)


def test_an_index_is_made_of_files(run: Run, path: Path) -> None:
    """The one that the API makes, with where files are placed from a file."""
    folder = path.parent
    (folder / "placed.json").write_text(json.dumps({NAMES[1]: PLACED}))
    files = [folder / name for name in NAMES]
    out = folder / "made.json"
    done = run("index", *files, "-o", out, "--transforms", folder / "placed.json")
    assert done.exit_code == 0, done.output
    assert "2 files, 600 Gaussians" in done.stderr
    assert parse_index(out.read_bytes()) == parse_index(path.read_bytes())
    assert run("index", *files, "-o", out).exit_code == 2
    for arguments in (
        (folder / "deep" / "b.scar", "-o", folder / "deep" / "x.json", folder / "a.scar"),
        (*files, *files, "-o", folder / "x.json"),
    ):
        wrong = run("index", *arguments)
        assert wrong.exit_code == 1
        assert "input-scene" in wrong.stderr
    (folder / "placed.json").write_text(json.dumps({NAMES[1]: [[1]]}))
    assert "input-scene" in run("index", *files, "-o", "x", "--transforms", folder / "placed.json").stderr


def test_inspecting_an_index_opens_no_file(run: Run, path: Path) -> None:
    for name in NAMES:
        (path.parent / name).unlink()
    report = json.loads(run("inspect", path, "--json").stdout)
    assert (report["format"], report["file_count"], report["gaussians"]) == ("scar-scene", 2, 600)
    assert [layer["gaussians"] for layer in report["layers"]][-1] == 600
    assert report["first_layer_bytes"] == sum(file["first_layer_bytes"] for file in report["files"])
    text = run("inspect", path).stdout
    assert "deep/b.scar (placed)" in text
    assert run("inspect", path, "--models").exit_code == 2


def test_decoding_writes_all_files(run: Run, path: Path) -> None:
    out = path.parent / "all.ply"
    done = run("decode", path, out, "--stats")
    assert done.exit_code == 0, done.output
    assert "600 Gaussians" in done.stderr
    whole = load(out)
    assert isinstance(whole, GaussianScene)
    assert len(whole) == 600
    arrays = path.parent / "first.npz"
    assert run("decode", path, arrays, "--layers", 1, "-q").exit_code == 0
    assert len(np.load(arrays)["positions"]) == parse_index(path.read_bytes()).layer(1).gaussians
    assert run("decode", path, out, "--force", "--tiles", "0").exit_code == 2
    assert run("decode", path, path.parent / "x.npz", "--attributes", "opacity").exit_code == 2


def test_decoding_writes_other_formats(run: Run, path: Path) -> None:
    """All files in one, and what a view needs of them."""
    out, part = path.parent / "all.glb", path.parent / "seen.spz"
    assert run("decode", path, out, "-q").exit_code == 0
    assert run("decode", path, path.parent / "all.ply", "-q").exit_code == 0
    glb, ply = load(out), load(path.parent / "all.ply")
    assert isinstance(glb, GaussianScene)
    assert isinstance(ply, GaussianScene)
    np.testing.assert_array_equal(glb.sh, ply.sh)
    np.testing.assert_array_equal(glb.positions, ply.positions)
    assert run("decode", path, part, "--budget", 150, "-q").exit_code == 0
    assert 0 < len(load(part)) <= 150


def test_decoding_for_a_view_keeps_to_the_budget(run: Run, path: Path) -> None:
    """The budget holds for an index and for a file; if everything is behind the eye, nothing is decoded."""
    out = path.parent / "seen.ply"
    for name in (path, path.parent / NAMES[0]):
        done = run("decode", name, out, "--budget", 150, "--force", "--json")
        assert done.exit_code == 0, done.output
        assert 0 < json.loads(done.stdout)["decoded"]["anchors"] <= 150
    assert run("decode", path, out, "--camera", "0,0,-50", "--target", "0,0,-60", "--force").exit_code == 0
    assert "element vertex 0\n" in out.read_text(errors="replace")
    assert run("decode", path, out, "--camera", "0,0,-50", "--target", "0,0,-60", "--outside", "--force").exit_code == 0
    first = parse_index(path.read_bytes()).layer(1).gaussians
    assert f"element vertex {first}\n".encode() in out.read_bytes()
    assert run("decode", path, out, "--budget", 9, "--bake", "--force").exit_code == 2


def test_truncating_an_index_cuts_its_files(run: Run, path: Path) -> None:
    out = path.parent / "cut"
    done = run("truncate", path, out, "--layers", 1)
    assert done.exit_code == 0, done.output
    made = parse_index((out / path.name).read_bytes())
    assert all((out / name).stat().st_size == file.length for name, file in zip(NAMES, made.files, strict=True))
    assert run("validate", out / path.name, "-q").exit_code == 0
    named = path.parent / "other" / "x.json"
    assert run("truncate", path, named, "--layers", 4, "-q").exit_code == 0
    assert parse_index(named.read_bytes()) == parse_index(path.read_bytes())


def test_validating_says_what_is_wrong(run: Run, path: Path) -> None:
    assert run("validate", path).exit_code == 0
    (path.parent / NAMES[0]).unlink()
    found = json.loads(run("validate", path, "--json").stdout)
    assert [one["refusal"] for one in found["findings"]] == ["input-source"]
    path.write_bytes(path.read_bytes().replace(b'"version": 1', b'"version": 9'))
    done = run("validate", path)
    assert done.exit_code == 1
    assert "unsupported-scene" in done.stderr


def test_an_index_from_a_pipe_has_no_files(run: Run, path: Path) -> None:
    data = path.read_bytes()
    assert run("inspect", "-", input=data).exit_code == 0
    for arguments in (("decode", "-", path.parent / "x.ply"), ("truncate", "-", path.parent / "y", "--layers", "1")):
        done = run(*arguments, input=data)
        assert (done.exit_code, "input-scene" in done.stderr) == (1, True)
