"""inspect, validate and truncate."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from conformance.surgery.parts import flip_bits
from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import assemble_file, code_blocks, write_scene
from scarfmt.container.file import Block, write_container
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import FileSource
from scarfmt.tools.truncate import truncate
from tests.blocks.test_streaming import random_boxes
from tests.cli.conftest import run
from tests.formats.scene_files import inria_ply
from tests.samples.container_samples import FIELDS


def test_inspect_reads_stdin_and_urls(explicit_scar: Path) -> None:
    direct = run("inspect", explicit_scar).stdout
    assert run("inspect", "-", input=explicit_scar.read_bytes()).stdout == direct
    assert run("inspect", explicit_scar.as_uri()).stdout == direct


def test_inspect_warns_as_every_command_does(tmp_path: Path) -> None:
    """One line without the place in our code, whichever command reads the scene."""
    (tmp_path / "four.ply").write_bytes(inria_ply(rest=72))
    result = run("inspect", tmp_path / "four.ply")
    assert result.exit_code == 0
    assert [line.startswith("scarfmt: warning: ") for line in result.stderr.splitlines()] == [True]


def with_thumbnail(path: Path, picture: bytes) -> Path:
    """A file with this picture."""
    scene = random_scene(2, sh_degree=1)
    path.write_bytes(assemble_file(scene, [*code_blocks(scene), Block(BlockKind.THUMBNAIL, 1, picture)]))
    return path


def test_inspect_writes_the_thumbnail(explicit_scar: Path, tmp_path: Path) -> None:
    """The picture as it is in the file; a file without one is refused, and so is one that is in the way."""
    path, picture = with_thumbnail(tmp_path / "with.scar", b"a picture"), tmp_path / "picture.webp"
    assert run("inspect", path, "--thumbnail", picture).exit_code == 0
    assert picture.read_bytes() == b"a picture"
    assert "9 bytes" in run("inspect", path, "--metadata").stdout
    cut = path.read_bytes().partition(b"a picture")[0]
    assert run("inspect", "-", "--thumbnail", tmp_path / "cut.webp", input=cut).exit_code == 2
    assert run("inspect", path, "--thumbnail", picture).exit_code == 2
    assert run("inspect", explicit_scar, "--thumbnail", picture, "--force").exit_code == 2
    assert picture.read_bytes() == b"a picture"
    assert run("inspect", path, "--thumbnail", tmp_path / "picture.png").exit_code == 1
    largest = with_thumbnail(tmp_path / "largest.scar", bytes(65_535))
    assert run("inspect", largest, "--thumbnail", tmp_path / "largest.webp").exit_code == 0
    large = with_thumbnail(tmp_path / "large.scar", bytes(65_536))
    assert "entry-length" in run("inspect", large, "--thumbnail", picture, "--force").stderr
    assert "entry-length" in run("validate", large).stderr
    assert not (tmp_path / "picture.png").exists()


@pytest.mark.parametrize(("name", "format_"), [("picture.png", "PNG"), ("picture", "PNG"), ("picture.jpg", "JPEG")])
def test_inspect_writes_the_thumbnail_in_the_format_of_the_name(tmp_path: Path, name: str, format_: str) -> None:
    """Whatever the file holds. File managers (`examples/desktop`) want PNG under a name without an ending."""
    drawn, stored = Image.new("RGB", (6, 4), (0, 90, 200)), io.BytesIO()
    drawn.save(stored, "WEBP", lossless=True)
    path = with_thumbnail(tmp_path / "scene.scar", stored.getvalue())
    assert run("inspect", path, "--thumbnail", tmp_path / name).exit_code == 0
    with Image.open(tmp_path / name) as picture:
        assert (picture.format, picture.size) == (format_, drawn.size)
        assert format_ != "PNG" or picture.tobytes() == drawn.tobytes()


def test_inspect_tells_of_models(explicit_scar: Path) -> None:
    """The models are reported as text and as JSON, only when requested."""
    assert "index network" in run("inspect", explicit_scar, "--models").stdout
    assert "index network" not in run("inspect", explicit_scar).stdout
    report = json.loads(run("inspect", explicit_scar, "--models", "--json").stdout)
    assert report["models"]["index_network"] is None


def test_dump_lists_a_file_field_by_field(explicit_scar: Path) -> None:
    """With offset, length, section and value, and what is inside frames marked."""
    result = run("dump", explicit_scar)
    assert (result.exit_code, result.stderr) == (0, "")
    lines = [line.split() for line in result.stdout.splitlines()]
    assert lines[1][:4] == ["0", "9", "header.signature", "5.2"]
    assert any(line[0].startswith("+") and line[4].startswith("TABLES.table_count") for line in lines)


def test_dump_prints_one_json_document(explicit_scar: Path) -> None:
    """Rows cover the file; nothing is refused."""
    report = json.loads(run("dump", explicit_scar, "--json", "--full").stdout)
    assert sum(row["length"] for row in report["rows"] if not row["content"]) == explicit_scar.stat().st_size
    assert report["refusals"] == []


def test_dump_shows_only_the_blocks_asked_for(explicit_scar: Path) -> None:
    """Kinds may be given in any case, more than once."""
    lines = run("dump", explicit_scar, "--block", "layer", "--block", "TILE").stdout.splitlines()[1:]
    assert {line.split()[4].split(".")[0] for line in lines} == {"LAYER", "TILE"}


def test_dump_ends_with_what_is_refused(explicit_scar: Path) -> None:
    """All rows first; then a line a refusal, and exit code 1."""
    data = explicit_scar.read_bytes()
    result = run("dump", "-", input=data[: len(data) // 2])
    assert result.exit_code == 1
    assert "truncated-file" in result.stderr
    assert len(result.stdout.splitlines()) > 50
    report = json.loads(run("dump", "-", "--json", input=b"not a file").stdout)
    assert [row["refusal"] for row in report["refusals"]] == ["bad-signature"]


def test_validate_prints_each_fault_with_its_place(explicit_scar: Path) -> None:
    result = run("validate", explicit_scar)
    assert (result.exit_code, result.stdout) == (0, "")
    assert "valid; 3 of 3 layers" in result.stderr
    result = run("validate", "-", input=flip_bits(explicit_scar.read_bytes(), -2))
    assert result.exit_code == 1
    assert result.stderr.startswith("error: crc-mismatch @ ")
    assert "not valid" in result.stderr


def test_validate_as_json_or_quiet(explicit_scar: Path) -> None:
    cut = explicit_scar.read_bytes()[:-1]
    result = run("validate", "-", "--json", input=cut)
    document = json.loads(result.stdout)
    assert (result.exit_code, document["valid"], document["layers_available"]) == (1, False, 2)
    found = [(finding["refusal"], finding["offset"]) for finding in document["findings"]]
    assert found == [("truncated-file", len(cut))]
    quiet = run("validate", "-", "-q", input=cut)
    assert (quiet.exit_code, quiet.output) == (1, "")


@pytest.mark.parametrize("layers", [1, 2, 3])
def test_truncate_writes_what_the_module_makes(explicit_scar: Path, tmp_path: Path, layers: int) -> None:
    target = tmp_path / "out.scar"
    assert run("truncate", explicit_scar, target, "--layers", layers).exit_code == 0
    with FileSource(explicit_scar) as source:
        assert target.read_bytes() == truncate(source, layers)


def test_metadata_that_no_stream_can_carry_is_refused_and_the_deepest_is_printed(tmp_path: Path) -> None:
    """Half a surrogate pair has no UTF-8, and printers recurse: neither ends in a traceback, as text or as JSON."""
    deepest = b'{"a":' + 63 * b"[" + 63 * b"]" + b"}"
    for text, status in ((b'{"a":"\\ud800"}', 1), (b'{"a":' + 700 * b"[" + 700 * b"]" + b"}", 1), (deepest, 0)):
        target = tmp_path / "a.scar"
        target.write_bytes(write_container(FIELDS, [], [Block(BlockKind.METADATA, 1, text)], [(0, 0)]))
        for form in ((), ("--json",)):
            done = run("inspect", target, "--metadata", *form)
            assert (done.exit_code, type(done.exception)) == (status, SystemExit if status else type(None))


def test_inspect_shows_the_boxes_and_the_view(tmp_path: Path) -> None:
    """With --streaming alone, as text and as JSON, and that there is nothing."""
    scene = random_scene(5, anchors=40)
    boxes, plain = tmp_path / "boxes.scar", tmp_path / "plain.scar"
    boxes.write_bytes(write_scene(replace(scene, streaming=random_boxes(len(scene.tiles)))))
    plain.write_bytes(write_scene(scene))
    report = json.loads(run("inspect", boxes, "--json", "--streaming").stdout)["streaming"]
    assert report["view"]["target"] == [0.0, 0.0, 0.0]
    assert "tight boxes" in run("inspect", boxes, "--streaming").stdout
    assert "tight boxes" not in run("inspect", boxes).stdout
    assert json.loads(run("inspect", plain, "--json", "--streaming").stdout)["streaming"] is None


def test_inspect_reports_scenes_of_other_formats(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    path.write_bytes(inria_ply(3, 9).replace(b"made for a test", b"SplatRenderMode: mip"))
    report = json.loads(run("inspect", path, "--json").stdout)
    assert report["format"] == "ply"
    assert (report["gaussians"], report["sh_degree"], report["render_model"]) == (3, 1, "antialiased")
    assert json.loads(run("inspect", "-", "--json", input=path.read_bytes()).stdout) == report
