"""compare and render."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from scarfmt.formats.gltf import EXTENSION, LINEAR, SRGB
from scarfmt.render.camera import Camera, orbit_cameras
from scarfmt.render.images import read_image, write_png
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from tests.cli.conftest import gaussians, run
from tests.formats.scene_files import glb, gltf_document, scene_ply
from tests.render.capture import files

SMALL = ("--size", "64x48", "--views", 2, "--from", "survey")


def camera_list(cameras: list[Camera], path: Path) -> Path:
    """The first camera is for training, the others are for tests."""
    named = [replace(c, name=f"{index}.png", split="test" if index else "train") for index, c in enumerate(cameras)]
    return files.in_json(files.own(named), path)


def take_photos(cameras: list[Camera], folder: Path) -> Path:
    """Photos of the scene beside the list of their cameras; the list."""
    (folder / "images").mkdir()
    for index, camera in enumerate(cameras):
        write_png(folder / "images" / f"{index}.png", render(gaussians(300), camera))
    return camera_list(cameras, folder / "cameras.json")


def compare_json(*arguments: object) -> Any:
    result = run("compare", *arguments, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def test_scenes_that_lie_apart_are_warned_of(ply: Path, tmp_path: Path) -> None:
    """A format that cannot say its origin makes a file that no view shows. What cannot be drawn is left out."""
    far = tmp_path / "far.ply"
    scene = gaussians(300)
    scene.opacity_logits[3] = np.nan
    far.write_bytes(scene_ply(replace(scene, positions=scene.positions + 500.0)))
    assert "lie apart" in run("compare", ply, far, *SMALL).stderr
    assert "lie apart" not in run("compare", ply, ply, *SMALL).stderr


@pytest.mark.parametrize("height", [0.0, 0.5])
def test_a_flat_scene_does_not_lie_apart_from_one_rounded(ply: Path, tmp_path: Path, height: float) -> None:
    """Along the axis that it has no extent on, rounding moves all of it; a greater distance is none of rounding."""
    names = tmp_path / "flat.ply", tmp_path / "rounded.ply"
    for name, moved in zip(names, (0.0, 1e-4 + height), strict=True):
        scene = gaussians(300)
        name.write_bytes(scene_ply(replace(scene, positions=scene.positions * [1, 0, 1] + [0, moved, 0])))
    assert ("lie apart" in run("compare", *names, *SMALL).stderr) == (height > 0)


def test_a_scene_equals_itself(ply: Path) -> None:
    result = compare_json(ply, ply, *SMALL)["results"]["b"]
    assert result["psnr_db"] == [None, None]  # infinite, which JSON cannot say
    assert result["ssim"] == [1.0, 1.0]
    text = run("compare", ply, ply, *SMALL, "--no-ssim").stdout
    assert "equal" in text
    assert "inf" not in text


def test_a_coded_scene_is_near_and_its_first_layer_less_so(ply: Path, encoded: Path) -> None:
    whole = compare_json(ply, encoded, *SMALL, "--no-ssim")["results"]["b"]
    first = compare_json(ply, encoded, *SMALL, "--no-ssim", "--layers-b", 1)["results"]["b"]
    assert whole["mean_psnr_db"] > first["mean_psnr_db"] > 10
    assert whole["mean_ssim"] is None
    same = compare_json(encoded, encoded, *SMALL, "--layers-a", 1, "--layers-b", 1)["results"]["b"]
    assert same["psnr_db"] == [None, None]
    assert compare_json(encoded, encoded, *SMALL, "--layers-a", 1, "--all-layers")["layers"][0]["mean_psnr_db"] is None


def test_all_layers_are_tabled_with_their_sizes(ply: Path, encoded: Path) -> None:
    rows = compare_json(ply, encoded, *SMALL, "--all-layers")["layers"]
    inspected = json.loads(run("inspect", encoded, "--json").stdout)["layers"]
    assert [row["bytes"] for row in rows] == [layer["end_offset"] for layer in inspected]
    assert [row["bytes_per_source"] for row in rows] == [layer["end_offset"] / 300 for layer in inspected]
    single = compare_json(ply, encoded, *SMALL, "--layers-b", 1)["results"]["b"]
    assert rows[0]["mean_psnr_db"] == pytest.approx(single["mean_psnr_db"])
    table = run("compare", ply, encoded, *SMALL, "--all-layers").stdout.splitlines()
    assert len(table) == 1 + len(rows)
    assert "bytes/Gaussian" in table[0]


def test_everywhere_is_compared_from_unless_asked_otherwise(ply: Path, encoded: Path) -> None:
    """Three kinds of views, each with its mean, 5th percentile and worst; each kind can be asked for alone."""
    few = ("--size", "64x48", "--views", 2, "--no-ssim")
    everywhere = compare_json(ply, encoded, *few)["results"]["b"]
    assert everywhere["names"] == [f"{kind} {number}" for kind in ("orbit", "near", "inside") for number in (1, 2)]
    assert list(everywhere["kinds"]) == ["orbit", "near", "inside"]
    for first, (kind, summary) in enumerate(everywhere["kinds"].items()):
        alone = compare_json(ply, encoded, *few, "--from", kind)["results"]["b"]
        assert alone["psnr_db"] == everywhere["psnr_db"][2 * first : 2 * first + 2]
        assert alone["worst_psnr_db"] == summary["worst_psnr_db"] == min(alone["psnr_db"])
        assert alone["mean_psnr_db"] == summary["mean_psnr_db"] == pytest.approx(sum(alone["psnr_db"]) / 2)
    text = run("compare", ply, encoded, *few).stdout
    assert "of near:" in text
    assert "of all views:" in text


def test_the_first_file_alone_places_the_cameras(ply: Path, tmp_path: Path) -> None:
    """A second file whose Gaussians lie elsewhere is looked at from where the first is, by render --like too."""
    scene = gaussians(300)
    far = tmp_path / "far.ply"
    far.write_bytes(scene_ply(replace(scene, positions=scene.positions + 1e4, sh=scene.sh * 0)))
    for kind in ("survey", "near"):
        run("render", ply, tmp_path / "a", *SMALL[:4], "--from", kind, "--force")
        like = run("render", far, tmp_path / "b", *SMALL[:4], "--from", kind, "--like", ply, "--force")
        assert like.exit_code == 0, like.stderr
        names = sorted(path.name for path in (tmp_path / "a").iterdir())
        assert sorted(path.name for path in (tmp_path / "b").iterdir()) == names
    black = read_image(tmp_path / "b" / names[0])
    assert black.max() == 0
    decibels = compare_json(ply, far, *SMALL, "--no-ssim")["results"]["b"]["psnr_db"]
    empty = psnr(np.zeros((48, 64, 3)), render(scene, orbit_cameras(scene, 2, 64, 48)[0]))
    assert decibels[0] == pytest.approx(empty, abs=1e-3)


def test_what_files_say_of_origin_and_up_counts(ply: Path, tmp_path: Path) -> None:
    """Of two origins the second scene is moved to the first; views stand upright."""
    scene, names = gaussians(300), (tmp_path / "said.ply", tmp_path / "said.scar")
    moved = replace(scene, positions=scene.positions - [100.0, 0, 0])
    names[0].write_bytes(scene_ply(moved, ["Vertical Axis: z", "offsetx 100.0", "offsety 0.0", "offsetz 0.0"]))
    run("encode", *names, "--effort", 0, "-q")
    assert compare_json(ply, names[0], *SMALL)["results"]["b"]["mean_psnr_db"] > 60
    assert compare_json(ply, names[1], *SMALL, "--all-layers")["layers"][-1]["mean_psnr_db"] > 25
    for name in names:
        frames: tuple[tuple[str, ...], ...] = ((), ("--frame", "z"), ("--frame", "-y"))
        for number, frame in enumerate(frames):
            run("render", name, tmp_path / f"{number}.png", *SMALL, *frame, "--force")
        first, same, other = ((tmp_path / f"{number}.png").read_bytes() for number in range(3))
        assert first == same != other


def test_every_format_of_cameras_is_taken(ply: Path, tmp_path: Path) -> None:
    cameras = orbit_cameras(gaussians(300), 2, 80, 60)
    model = files.colmap_binary(cameras, tmp_path / "capture" / "sparse" / "0")
    listing = files.in_json(files.inria(cameras), tmp_path / "cameras.json")
    for given in (tmp_path / "capture", model, listing):
        found = compare_json(ply, ply, "--cameras", given, "--no-ssim")["results"]["b"]
        assert found["names"] == [camera.name for camera in cameras]
        assert list(found["kinds"]) == ["cameras"]


def test_wrong_cameras_and_frames_are_told_before_a_scene_is_read(tmp_path: Path) -> None:
    """The scenes named here do not exist."""
    (tmp_path / "wrong.json").write_text("{}")
    a, b = tmp_path / "a.ply", tmp_path / "b.scar"
    commands = {"compare": (a, b), "render": (a, tmp_path / "out"), "encode": (a, b)}
    for command, names in commands.items():
        wrong = run(command, *names, "--cameras", tmp_path / "wrong.json")
        assert (wrong.exit_code, wrong.stderr.count("\n")) == (1, 1)
        assert "input-cameras" in wrong.stderr
        wrong = run(command, *names, "--frame", "-y:125")
        assert (wrong.exit_code, wrong.stderr.count("\n")) == (2, 1)
        assert "input-frame: cannot read the frame '-y:125': an arc has two numbers" in wrong.stderr


def test_listed_cameras_replace_the_orbit(ply: Path, tmp_path: Path) -> None:
    listing = camera_list(orbit_cameras(gaussians(300), 5, 80, 60), tmp_path / "cameras.json")
    everything = compare_json(ply, ply, "--cameras", listing, "--no-ssim")["results"]["b"]
    assert everything["names"] == ["1.png", "2.png", "3.png", "4.png"]  # the test split
    two = compare_json(ply, ply, "--cameras", listing, "--no-ssim", "--views", 2)["results"]["b"]
    assert two["names"] == ["1.png", "3.png"]
    run("render", ply, tmp_path / "a.png", "--cameras", listing, "--views", 1, "--size", "40x30")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == (40, 30)


def test_photos_judge_both_scenes(ply: Path, encoded: Path, tmp_path: Path) -> None:
    take_photos(orbit_cameras(gaussians(300), 2, 64, 48), tmp_path)
    results = compare_json(ply, encoded, "--photos", tmp_path)["results"]
    assert results["a"]["mean_psnr_db"] > 45 > results["b"]["mean_psnr_db"]


def test_photos_held_out_of_training_are_compared_and_what_cannot_be_known_is_said(ply: Path, tmp_path: Path) -> None:
    """As the file says; else as the list of cameras marks them; else all of them."""
    trained = tmp_path / "trained.scar"
    said = 'training={"held_out": ["0.png", "2.png"]}'
    assert run("encode", ply, trained, "--effort", 0, "--metadata", said).exit_code == 0
    listing = take_photos(orbit_cameras(gaussians(300), 3, 64, 48), tmp_path)
    options = ("--photos", tmp_path, "--no-ssim")
    assert compare_json(ply, trained, *options)["results"]["b"]["names"] == ["0.png", "2.png"]
    assert compare_json(ply, ply, *options)["results"]["b"]["names"] == ["1.png", "2.png"]
    listing.write_text(listing.read_text().replace('"split"', '"nobody"'))
    assert compare_json(ply, trained, *options)["results"]["a"]["names"] == ["0.png", "2.png"]
    result = run("compare", ply, ply, *options, "--json")
    assert len(json.loads(result.stdout)["results"]["b"]["names"]) == 3
    assert "nobody says which photos were held out" in result.stderr


def test_render_writes_a_picture_per_view_and_a_sheet(encoded: Path, tmp_path: Path) -> None:
    result = run("render", encoded, tmp_path / "out", *SMALL, "--sheet")
    assert result.exit_code == 0, result.stderr
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["000-0-deg.png", "001-180-deg.png", "sheet.png"]
    with Image.open(tmp_path / "out" / names[0]) as picture:
        assert picture.size == (64, 48)
        assert picture.getextrema() != ((0, 0),) * 3


def test_render_layers_into_one_sheet_a_row_each(encoded: Path, tmp_path: Path) -> None:
    result = run("render", encoded, tmp_path / "sheet.png", *SMALL, "--layers", "all")
    assert result.exit_code == 0, result.stderr
    with Image.open(tmp_path / "sheet.png") as picture:
        assert picture.width == 2 * 64
        assert picture.height > 2 * 48
    run("render", encoded, tmp_path / "each", *SMALL, "--layers", "all")
    run("render", encoded, tmp_path / "last", *SMALL)
    each, last = ([path.read_bytes() for path in sorted((tmp_path / name).iterdir())] for name in ("each", "last"))
    assert each[-2:] == last != each[:2]


def test_a_file_cut_short_is_drawn_as_far_as_it_goes_and_that_is_said(encoded: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.scar"
    cut.write_bytes(encoded.read_bytes()[:-1])
    said = "cut.scar is cut short: 1 of its 2 layers are used"
    assert said in run("compare", encoded, cut, *SMALL).stderr
    assert "cut short" not in run("compare", encoded, encoded, *SMALL).stderr
    assert len(compare_json(encoded, cut, *SMALL, "--all-layers")["layers"]) == 1
    assert said in run("render", cut, tmp_path / "a.png", *SMALL).stderr
    assert said not in run("render", cut, tmp_path / "b.png", *SMALL, "--layers", 1).stderr


def test_linear_colours_are_told_of(tmp_path: Path) -> None:
    """The numbers of the files are the same, but what other programs show of them is not."""
    document, data = gltf_document()
    names = tmp_path / "srgb.glb", tmp_path / "linear.glb"
    for name, space in zip(names, (SRGB, LINEAR), strict=True):
        document["meshes"][0]["primitives"][0]["extensions"][EXTENSION]["colorSpace"] = space
        name.write_bytes(glb(document, data))
    warnings = run("compare", *names, *SMALL).stderr
    assert "linear.glb: its colours are linear light" in warnings
    assert "srgb.glb" not in warnings


def test_render_refuses_names_of_other_pictures(ply: Path, tmp_path: Path) -> None:
    """No folder is made that is named as a picture."""
    result = run("render", ply, tmp_path / "a.JPG", *SMALL)
    assert result.exit_code == 2
    assert "end in .png, not .jpg" in result.stderr
    assert not list(tmp_path.iterdir())


def test_pictures_that_exist_are_kept_unless_forced(ply: Path, tmp_path: Path) -> None:
    target = tmp_path / "one.png"
    target.write_bytes(b"precious")
    assert run("render", ply, target, "--size", "64x48", "--views", 1).exit_code == 2
    assert target.read_bytes() == b"precious"
    assert run("render", ply, target, "--size", "64x48", "--views", 1, "--force").exit_code == 0
    with Image.open(target) as picture:
        assert picture.size == (64, 48)
