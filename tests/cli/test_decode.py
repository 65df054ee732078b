"""decode: what is asked for is what is written."""

from __future__ import annotations

import importlib.util
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode as decode_file
from reference_decoder.decode import decode_scene
from scarfmt.blocks.streaming import View
from scarfmt.cli.outputs import SUFFIXES
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.container.source import HEAD_BYTES
from scarfmt.counters import Counters
from scarfmt.formats import load
from scarfmt.formats.outputs import OUTPUTS
from scarfmt.render.native import binding
from tests.blocks.test_streaming import random_boxes
from tests.cli.conftest import gaussians, run, shell
from tests.formats.scene_files import read_scene, scene_ply
from tests.render.capture import files


def test_a_ply_holds_what_the_decoder_gives(encoded: Path, tmp_path: Path) -> None:
    assert run("decode", encoded, tmp_path / "a.ply").exit_code == 0
    written, expected = read_scene(tmp_path / "a.ply"), decode_scene(encoded)
    np.testing.assert_array_equal(written.positions, expected.positions.astype(np.float32))
    np.testing.assert_array_equal(written.sh, expected.sh)


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        (("--layers", 1), {"layers": 1}),
        (("--tiles", "0,2"), {"tiles": [0, 2]}),
        (("--box", "-1.5,0,0,0,2,5"), {"box": ((-1.5, 0, 0), (0, 2, 5))}),
        (("--threads", 2), {}),
        (("--camera", "1e5,0,0", "--target", "2e5,0,0", "--outside"), {"layers": 1}),
    ],
)
def test_parts(explicit_scar: Path, tmp_path: Path, options: tuple[object, ...], arguments: dict[str, Any]) -> None:
    assert run("decode", explicit_scar, tmp_path / "a.npz", *options).exit_code == 0
    expected = decode_scene(explicit_scar, **arguments)
    assert len(expected) > 0
    with np.load(tmp_path / "a.npz") as arrays:
        assert set(arrays) == set(expected.arrays())
        for name in arrays:
            np.testing.assert_array_equal(arrays[name], getattr(expected, name))


def test_attributes_are_written_alone(explicit_scar: Path, tmp_path: Path) -> None:
    assert run("decode", explicit_scar, tmp_path / "a.npz", "--attributes", "positions,latents").exit_code == 0
    expected = decode_file(explicit_scar)
    with np.load(tmp_path / "a.npz") as arrays:
        assert set(arrays) == {"tiles", "classes", "positions", "latents"}
        np.testing.assert_array_equal(arrays["positions"], expected.positions)
        np.testing.assert_array_equal(arrays["latents"], expected.latents)


def test_a_cut_file_needs_leave(explicit_scar: Path, tmp_path: Path) -> None:
    cut = explicit_scar.read_bytes()[:-1]
    refused = run("decode", "-", tmp_path / "a.ply", input=cut)
    assert refused.exit_code == 1
    assert "truncated-file" in refused.stderr
    allowed = run("decode", "-", tmp_path / "a.ply", "--allow-truncated", input=cut)
    assert allowed.exit_code == 0
    expected = decode_file(cut, allow_truncated=True)
    assert expected.layers == 2
    assert len(load(tmp_path / "a.ply")) == len(expected)


def test_stats_are_a_small_table_on_stderr(explicit_scar: Path, tmp_path: Path) -> None:
    """The table shows what was read beside what the file has, then what was computed."""
    result = run("decode", explicit_scar, tmp_path / "a.npz", "--layers", 1, "--stats")
    counters = Counters()
    decode_file(explicit_scar, layers=1, counters=counters)
    row = next(line.split() for line in result.stderr.splitlines() if line.startswith("bytes"))
    assert row[1:4] == [f"{counters.bytes_read:,}", "of", f"{explicit_scar.stat().st_size:,}"]
    assert result.stdout == ""


def test_stats_as_json_are_the_counters_of_the_decode(explicit_scar: Path, tmp_path: Path) -> None:
    """On stdout, with or without the table; they are those of a decode."""
    began = time.perf_counter()
    result = run("decode", explicit_scar, tmp_path / "a.npz", "--json", "--quiet")
    spent = time.perf_counter() - began
    found = json.loads(result.stdout)
    counters = Counters()
    decode_file(explicit_scar, counters=counters)
    assert found["decoded"] == {**vars(counters), "blocks": counters.model_blocks + counters.tile_blocks}
    assert found["file"]["bytes"] == explicit_scar.stat().st_size
    assert found["decoded"]["anchors"] == found["file"]["anchors"]
    assert 0 < found["seconds"] < spent
    assert result.stderr == ""


@pytest.mark.parametrize("options", [(), ("--layers", 1), ("--tiles", "1"), ("--attributes", "positions")])
def test_of_a_url_less_is_transferred_and_computed(
    explicit_scar: Path, tmp_path: Path, options: tuple[object, ...]
) -> None:
    """Decoding from a URL has the counts of decoding from a file, except for the first read, which brings what lies
    next to the header."""
    pytest.importorskip("fsspec")
    arguments = (tmp_path / "a.npz", "--json", "--force", *options)
    local = json.loads(run("decode", explicit_scar, *arguments).stdout)["decoded"]
    remote = json.loads(run("decode", f"file://{explicit_scar}", *arguments).stdout)["decoded"]
    assert remote["bytes_read"] <= max(local["bytes_read"], HEAD_BYTES)
    for found in (local, remote):
        del found["bytes_read"], found["reads"]
    assert remote == local


@pytest.fixture(scope="module", params=[3, 4], ids=["without distance", "with distance"])
def anchors(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An anchor file whose networks take the distance, and one whose networks do not (SPEC §9.6)."""
    scenes = (random_scene(seed, Profile.ANCHOR, anchors=40) for seed in range(100))
    scene = next(s for s in scenes if s.decoder and s.scene_mlps[0].inputs == s.decoder.outputs + request.param)
    path = tmp_path_factory.mktemp("anchors") / "anchors.scar"
    path.write_bytes(write_scene(scene))
    return path


def test_that_npz_can_be_compared_and_encoded_again(anchors: Path, tmp_path: Path) -> None:
    """The help of `decode` promises that the .npz can be read again."""
    pytest.importorskip("torch", reason="needs the extra encode")
    run("decode", anchors, tmp_path / "a.npz")
    view = ("--views", 1, "--from", "survey", "--size", "32x24", "--no-ssim")
    result = run("compare", anchors, tmp_path / "a.npz", *view, "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["results"]["b"]["psnr_db"] == [None]
    options = ("--effort", 1, "--layers", 1, "--corrections", 0, "-q")
    result = run("encode", tmp_path / "a.npz", tmp_path / "b.scar", *options)
    assert result.exit_code == 0, result.stderr
    assert run("validate", tmp_path / "b.scar").exit_code == 0


def test_an_anchor_model_does_not_fit_a_ply_as_it_is(anchors: Path, tmp_path: Path) -> None:
    """Neither from a .scar nor from the .npz of it."""
    run("decode", anchors, tmp_path / "a.npz")
    for command, source in (("decode", anchors), ("convert", tmp_path / "a.npz")):
        result = run(command, source, tmp_path / "a.ply")
        assert (result.exit_code, "--bake" in result.stderr) == (2, True)
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_an_anchor_model_can_be_baked(anchors: Path, tmp_path: Path) -> None:
    """Into any format."""
    for name in ("a.ply", "a.glb"):
        result = run("decode", anchors, tmp_path / name, "--bake", "--bake-steps", 2)
        assert result.exit_code == 0, result.stderr
    assert b"comment baked from a .scar anchor model" in (tmp_path / "a.ply").read_bytes()[:500]
    np.testing.assert_array_equal(read_scene(tmp_path / "a.ply").sh, read_scene(tmp_path / "a.glb").sh)


def test_baking_for_cameras_is_another_scene(anchors: Path, tmp_path: Path) -> None:
    """Without refining, which needs no renderer; only the eye of the camera that is not for tests is used, if any."""
    train, test = files.camera(0, "train"), files.camera(1, "test")
    mixed, tests = (files.in_json(files.own(some), tmp_path / f"{len(some)}") for some in ([train, test], [test]))
    for name, options in {"a": (), "b": ("--cameras", mixed), "c": ("--cameras", tests)}.items():
        result = run("decode", anchors, tmp_path / f"{name}.ply", "--bake", "--bake-steps", 0, *options)
        assert result.exit_code == 0, result.stderr
    told = (tmp_path / "b.ply").read_bytes()
    assert b"fitted over 1 eyes in 0 steps" in told[:500]
    assert b"fitted over 1 eyes" in (tmp_path / "c.ply").read_bytes()[:500]
    assert len({told, *((tmp_path / f"{name}.ply").read_bytes() for name in "ac")}) == 3


def test_baking_without_the_renderer_says_what_to_install(
    anchors: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = importlib.util.find_spec
    library = "scarfmt.render.native.native"
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == library else found(name))
    binding.load.cache_clear()
    result = run("decode", anchors, tmp_path / "a.ply", "--bake")
    assert result.exit_code == 1
    assert "input-dependency: drawing needs the compiled renderer" in result.stderr
    assert "GCC or Clang" in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "options"),
    [("a.compressed.ply", ()), ("a.spz", ()), ("a.SPZ", ("--spz-version", 3, "--spz-fraction-bits", 9)), ("a.glb", ())],
)
def test_other_formats_hold_the_gaussians_of_the_ply(
    explicit_scar: Path, tmp_path: Path, name: str, options: tuple[object, ...]
) -> None:
    """Chosen by the ending of the name. A random scene may lie far out: positions agree to SPZ's step."""
    result = run("decode", explicit_scar, tmp_path / name, *options)
    assert result.exit_code == 0, result.output
    run("decode", explicit_scar, tmp_path / "a.ply")
    written, expected = read_scene(tmp_path / name), read_scene(tmp_path / "a.ply")
    assert f"{len(expected):,} Gaussians" in result.stderr
    assert written.sh.shape == expected.sh.shape
    ends = (np.sort(scene.positions, axis=0) for scene in (written, expected))
    np.testing.assert_allclose(*ends, atol=2.0**-9)


def test_a_gltf_has_its_buffer_beside_it(explicit_scar: Path, tmp_path: Path) -> None:
    assert run("decode", explicit_scar, tmp_path / "my scene.gltf").exit_code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["my scene.bin", "my scene.gltf"]
    assert run("decode", explicit_scar, tmp_path / "a.glb").exit_code == 0
    np.testing.assert_array_equal(read_scene(tmp_path / "my scene.gltf").sh, read_scene(tmp_path / "a.glb").sh)
    again = run("decode", explicit_scar, tmp_path / "my scene.gltf")
    assert (again.exit_code, "output-exists" in again.stderr) == (2, True)


def test_a_format_may_be_named(explicit_scar: Path, tmp_path: Path) -> None:
    assert run("decode", explicit_scar, tmp_path / "scene", "--format", "glb").exit_code == 0
    assert (tmp_path / "scene").read_bytes()[:4] == b"glTF"
    assert len(load(tmp_path / "scene")) > 0


def test_what_a_format_cannot_hold_is_said(tmp_path: Path) -> None:
    """On stderr, unless --quiet; the file is written."""
    scene = gaussians(5)
    scene.log_scales[2] = -30.0
    (tmp_path / "a.ply").write_bytes(scene_ply(scene))
    said = run("convert", tmp_path / "a.ply", tmp_path / "a.spz")
    assert (said.exit_code, "1 of 5 Gaussians" in said.stderr) == (0, True)
    quiet = run("convert", tmp_path / "a.ply", tmp_path / "a.spz", "--quiet", "--force")
    assert (quiet.exit_code, quiet.stderr) == (0, "")


def test_convert_goes_between_formats_of_others(tmp_path: Path) -> None:
    """Conversions work through pipes, too, and floats come back as they were."""
    scene = gaussians(40)
    (tmp_path / "a.ply").write_bytes(scene_ply(scene))
    assert run("convert", tmp_path / "a.ply", tmp_path / "a.glb").exit_code == 0
    done = shell("convert", "-", "-", "-q", cwd=tmp_path, input=(tmp_path / "a.glb").read_bytes())
    assert (done.returncode, done.stderr) == (0, b"")
    np.testing.assert_array_equal(read_scene(done.stdout).sh, scene.sh)
    assert run("convert", tmp_path / "a.glb", tmp_path / "flat.ply", "--sh-degree", 0).exit_code == 0
    assert read_scene(tmp_path / "flat.ply").sh.shape == (40, 1, 3)


def test_the_formats_of_the_command_line_are_those_of_the_writers() -> None:
    assert {output.id: output.suffix for output in OUTPUTS} == SUFFIXES


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--box", "900,900,900,901,901,901"), "nothing lies in the box; the scene lies in "),
        (("--budget", 1), "no tile fits into the budget: the smallest first layer in the picture has "),
        (("--camera", "1e5,0,0", "--target", "2e5,0,0"), "nothing of the scene is in the picture"),
    ],
)
def test_a_decode_of_nothing_says_why(
    explicit_scar: Path, tmp_path: Path, options: tuple[object, ...], said: str
) -> None:
    result = run("decode", explicit_scar, tmp_path / "a.ply", *options)
    assert result.exit_code == 0, result.stderr
    assert f"scarfmt: warning: {said}" in result.stderr
    assert result.stderr.endswith("0 Gaussians\n")


def test_the_view_of_a_file_is_the_one_that_a_budget_is_for(tmp_path: Path) -> None:
    """Here it looks away."""
    scene, away = random_scene(5, tiles=8), View(np.full(3, 1e12), np.full(3, 2e12), np.array([0.0, 1.0, 0.0]), 1.0)
    (tmp_path / "a.scar").write_bytes(write_scene(replace(scene, streaming=random_boxes(len(scene.tiles), away))))
    result = run("decode", tmp_path / "a.scar", tmp_path / "a.ply", "--budget", 10**6)
    assert "nothing of the scene is in the picture" in result.stderr


@pytest.mark.parametrize(("start", "said"), [(b"", "the file is empty"), (b"glTF", "encode it first")])
def test_what_is_no_scar_file_is_told_what_it_is(tmp_path: Path, start: bytes, said: str) -> None:
    (tmp_path / "a.scar").write_bytes(start.ljust(40 * len(start), b"x"))
    assert said in run("inspect", tmp_path / "a.scar").stderr
