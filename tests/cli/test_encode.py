"""encode: what reaches the encoder, and what comes out."""

from __future__ import annotations

import json
import re
from pathlib import Path

import click
import numpy as np

from reference_encoder.options import MAX_QUALITY, MIN_QUALITY, MIN_TILE_ANCHORS
from scarfmt.cli import load
from scarfmt.cli.encode import FORMAT_IDS, parse_metadata
from scarfmt.container.source import FileSource
from scarfmt.formats import FORMATS
from scarfmt.limits import MAX_ANCHORS_PER_TILE
from scarfmt.render.camera import look_at, orbit_cameras
from scarfmt.tools.inspection import inspect
from tests.cli.conftest import gaussians, run, shell
from tests.formats.scene_files import scene_ply
from tests.render.capture import files

FAST = ("--effort", 1, "--layers", 1, "--quality", 25)


def test_the_file_is_valid_and_counts_its_input(encoded: Path) -> None:
    assert run("validate", encoded).exit_code == 0
    with FileSource(encoded) as source:
        report = inspect(source)
    assert report["source_count"] == 300
    assert report["sh_degree"] == 1


def test_the_summary_ends_with_a_verdict_and_has_figures_on_request(ply: Path, tmp_path: Path) -> None:
    target = tmp_path / "a.scar"
    result = run("encode", ply, target, *FAST, "--verbose")
    found = json.loads(run("inspect", target, "--json", "--metadata").stdout)["metadata"]["quality"]
    assert f"quality on {found['views']} test views" in result.stderr
    for name, figures in {"all": found, **found["kinds"]}.items():
        line = next(line for line in result.stderr.splitlines() if line.startswith(f"  {name} "))
        numbers = [float(word) for word in line.replace("5th", "").split() if word[0].isdigit()]
        assert numbers == [figures["mean_db"], figures["p5_db"], figures["worst_db"]]
    assert re.fullmatch(r"looks like the source from .* worst .*, [\d.]+ dB", result.stderr.splitlines()[-1])
    assert len(run("encode", ply, target, *FAST, "--force").stderr.splitlines()) == 2


def test_a_preset_is_a_set_of_options_and_those_given_win(ply: Path, tmp_path: Path) -> None:
    few = ("--layers", 1, "--corrections", 0, "-q")
    for name, options in (
        ("a", ("--preset", "preview")),
        ("b", ("--quality", 36, "--effort", 1)),
        ("c", ("--preset", "preview", "--quality", 25)),
        ("d", ("--effort", 1, "--quality", 25)),
    ):
        assert run("encode", ply, tmp_path / f"{name}.scar", *options, *few).exit_code == 0
    a, b, c, d = ((tmp_path / f"{name}.scar").read_bytes() for name in "abcd")
    assert a == b != c == d


def test_many_scenes_go_into_a_folder_and_failures_are_listed_at_the_end(ply: Path, tmp_path: Path) -> None:
    """What fails stops nothing else."""
    out = tmp_path / "new" / "out"
    (tmp_path / "bad.ply").write_bytes(b"no scene")
    (tmp_path / "b.compressed.ply").write_bytes(ply.read_bytes())
    result = run("encode", ply, tmp_path / "bad.ply", tmp_path / "b.compressed.ply", "--out-dir", out, *FAST)
    assert result.exit_code == 1
    assert sorted(path.name for path in out.iterdir()) == ["b.scar", "scene.scar"]
    first, second, third, end, failure = result.stderr.splitlines()
    assert first.startswith(f"{ply} -> {out / 'scene.scar'}: ")
    assert (second, end) == (f"{tmp_path / 'bad.ply'}: failed", "2 of 3 scenes encoded; failed:")
    assert third.startswith(str(tmp_path / "b.compressed.ply"))
    assert failure.strip().startswith(f"{tmp_path / 'bad.ply'}: input-")


def test_many_scenes_overwrite_nothing_and_each_other_never(ply: Path, tmp_path: Path) -> None:
    """Refused before any work: equal names of two folders, and outputs that exist."""
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.ply").write_bytes(ply.read_bytes())
    out = tmp_path / "out"
    same = run("encode", tmp_path / "a" / "scene.ply", tmp_path / "b" / "scene.ply", "--out-dir", out)
    assert same.exit_code == 2
    assert "would both become" in same.stderr
    assert not out.exists()
    out.mkdir()
    (out / "scene.scar").write_bytes(b"precious")
    taken = run("encode", ply, "--out-dir", out)
    assert (taken.exit_code, (out / "scene.scar").read_bytes()) == (2, b"precious")
    assert "--force" in taken.stderr


def test_a_folder_of_scenes_is_explained(ply: Path, tmp_path: Path) -> None:
    result = run("encode", ply.parent, tmp_path / "a.scar")
    assert "input-folder" in result.stderr
    assert "--out-dir" in result.stderr


def test_a_floor_can_be_asked_for(ply: Path, tmp_path: Path) -> None:
    assert run("encode", ply, tmp_path / "a.scar", "--worst", 22, "--effort", 1, "--layers", 1).exit_code == 0


def test_pipes_give_the_file_that_files_give(ply: Path, tmp_path: Path) -> None:
    done = shell("encode", "-", "-", *FAST, "-q", cwd=tmp_path, input=ply.read_bytes())
    assert (done.returncode, done.stderr) == (0, b"")
    assert run("encode", ply, tmp_path / "a.scar", *FAST, "-q").exit_code == 0
    assert done.stdout == (tmp_path / "a.scar").read_bytes()


def test_metadata_and_sh_degree_arrive_in_the_file(ply: Path, tmp_path: Path) -> None:
    target = tmp_path / "a.scar"
    pairs = ("--metadata", "title=Old oak", "--metadata", "year=2024", "--metadata", 'tags=["tree"]')
    assert run("encode", ply, target, *FAST, *pairs, "--sh-degree", 0).exit_code == 0
    report = json.loads(run("inspect", target, "--json", "--metadata").stdout)
    assert report["metadata"].items() >= {"title": "Old oak", "year": 2024}.items()
    assert (report["metadata"]["tags"], report["sh_degree"]) == (["tree"], 0)


def test_metadata_that_json_cannot_say_stays_text() -> None:
    command = load("encode")
    context = click.Context(command)
    assert parse_metadata(context, command.params[0], ("a=NaN", "b=", "c=x=y")) == {"a": "NaN", "b": "", "c": "x=y"}


def test_invalid_rows_are_refused_or_dropped(tmp_path: Path) -> None:
    scene = gaussians(50)
    scene.positions[7] = np.nan
    (tmp_path / "bad.ply").write_bytes(scene_ply(scene))
    refused = run("encode", tmp_path / "bad.ply", tmp_path / "a.scar", *FAST)
    assert refused.exit_code == 1
    assert "input-not-finite" in refused.stderr
    assert not (tmp_path / "a.scar").exists()
    dropped = run("encode", tmp_path / "bad.ply", tmp_path / "a.scar", *FAST, "--drop-invalid")
    assert dropped.exit_code == 0, dropped.stderr
    assert "left out 1 of 50 Gaussians" in dropped.stderr


def test_choices_are_those_of_the_encoder() -> None:
    options = {parameter.name: parameter.type for parameter in load("encode").params}
    assert tuple(known.id for known in FORMATS) == FORMAT_IDS
    ranges = {"quality": (MIN_QUALITY, MAX_QUALITY), "tile_anchors": (MIN_TILE_ANCHORS, MAX_ANCHORS_PER_TILE)}
    for name, (least, most) in ranges.items():
        found = options[name]
        assert isinstance(found, click.FloatRange | click.IntRange)
        assert (found.min, found.max) == (least, most)


def test_smaller_tiles_are_more_tiles(tmp_path: Path) -> None:
    """--tile-size reaches the lattice: 3000 Gaussians are one tile unless asked otherwise."""
    (tmp_path / "many.ply").write_bytes(scene_ply(gaussians(3000)))
    tiles = {}
    for size in (1024, 65536):
        target = tmp_path / f"{size}.scar"
        assert run("encode", tmp_path / "many.ply", target, *FAST, "--tile-size", size).exit_code == 0
        with FileSource(target) as source:
            tiles[size] = inspect(source)["tiles"]
    assert tiles[1024] > tiles[65536] == 1


def test_cameras_of_another_frame_get_a_warning(ply: Path, tmp_path: Path) -> None:
    """The cameras are used in spite of the warning; --quiet prints no warning."""
    away = look_at(np.array([0.0, 0, 1e4]), np.array([0.0, 0, 2e4]), np.array([0.0, 1, 0]), 64, 48)
    listing = files.in_json(files.inria([away, *orbit_cameras(gaussians(300), 2, 64, 48)]), tmp_path / "near.json")
    strangers = files.in_json(files.inria([away]), tmp_path / "away.json")
    for given, warned, quiet in ((strangers, True, ()), (strangers, False, ("-q",)), (listing, False, ())):
        target = tmp_path / "a.scar"
        result = run("encode", ply, target, *FAST, "--cameras", given, "--force", *quiet)
        assert result.exit_code == 0, result.stderr
        assert ("scarfmt: warning: the cameras do not look at the scene" in result.stderr) == warned


def test_cameras_may_be_all_and_the_frame_may_be_left_to_the_encoder(ply: Path, tmp_path: Path) -> None:
    target = tmp_path / "a.scar"
    assert run("encode", ply, target, *FAST, "--frame", "auto").exit_code == 0
    listing = files.in_json(files.inria(orbit_cameras(gaussians(300), 2, 64, 48)), tmp_path / "cameras.json")
    result = run("encode", ply, target, *FAST, "--cameras", listing, "--only-cameras", "--force")
    assert result.exit_code == 0, result.stderr


def test_what_a_ply_says_travels_through_the_file(tmp_path: Path) -> None:
    """Render model, up axis and a coordinate reference with its origin."""
    said = ["SplatRenderMode: mip", "Vertical Axis: z", "epsg 25832", "offsetx 500000.5", "offsety 0.0", "offsetz 0.0"]
    source, coded, back = (tmp_path / name for name in ("a.ply", "a.scar", "b.ply"))
    source.write_bytes(scene_ply(gaussians(300), said))
    assert run("encode", source, coded, *FAST, "--quiet").exit_code == 0
    assert json.loads(run("inspect", coded, "--json").stdout)["render_model"] == "antialiased"
    assert run("decode", coded, back, "--quiet").exit_code == 0
    header = back.read_bytes().partition(b"end_header")[0].decode().splitlines()
    assert [line.removeprefix("comment ") for line in header if line.startswith("comment ")] == said
