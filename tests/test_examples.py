"""The example scene and its cameras."""

from __future__ import annotations

import io
import shlex
import shutil
import subprocess
import sys
from configparser import ConfigParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import assemble_file, code_blocks
from scarfmt.container.file import Block
from scarfmt.container.schema import SIGNATURE, BlockKind
from scarfmt.formats import load
from scarfmt.render.capture import load_cameras
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from tests.conftest import REPOSITORY

EXAMPLES = REPOSITORY / "examples"
DESKTOP = EXAMPLES / "desktop"
SHARED_MIME = "{http://www.freedesktop.org/standards/shared-mime-info}"


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    """A file that has a small picture."""
    stored = io.BytesIO()
    Image.new("RGB", (6, 4), (0, 90, 200)).save(stored, "WEBP")
    scene = random_scene(2, sh_degree=1)
    blocks = [*code_blocks(scene), Block(BlockKind.THUMBNAIL, 1, stored.getvalue())]
    (tmp_path / "scene.scar").write_bytes(assemble_file(scene, blocks))
    return tmp_path / "scene.scar"


def example() -> GaussianScene:
    scene = load(EXAMPLES / "plush-toys.ply")
    assert isinstance(scene, GaussianScene)
    assert not scene.invalid_rows().any()
    return scene


def test_the_encoder_does_not_know_the_views_it_is_judged_from() -> None:
    """Figures from views the encoder was tuned for would flatter it."""
    known = {camera.name for camera in load_cameras(EXAMPLES / "plush-toys.cameras.json")}
    judged = {camera.name for camera in load_cameras(EXAMPLES / "plush-toys.views.json")}
    assert len(known) == len(judged) == 8
    assert not known & judged


def test_the_cameras_look_at_the_toys() -> None:
    """From a wrong pose the picture is black or fog: neither bright in the middle nor rich in contrast."""
    camera = load_cameras(EXAMPLES / "plush-toys.views.json")[0]
    middle = render(example(), camera)[90:270, 120:360]
    assert float(middle.mean()) > 0.2
    assert float(np.std(middle)) > 0.15


def media_type() -> str:
    """What the desktop files call a scene."""
    found = ElementTree.parse(DESKTOP / "scarfmt.xml").find(f".//{SHARED_MIME}mime-type")
    assert found is not None
    return found.attrib["type"]


def test_desktops_know_the_signature_and_the_name() -> None:
    """A scene is found by its first bytes, whatever its name, and by its name before there are any."""
    tree = ElementTree.parse(DESKTOP / "scarfmt.xml")
    match, glob = tree.find(f".//{SHARED_MIME}match"), tree.find(f".//{SHARED_MIME}glob")
    assert match is not None
    assert glob is not None
    assert match.attrib["value"].encode().decode("unicode_escape").encode("latin-1") == SIGNATURE
    assert (match.attrib["offset"], glob.attrib["pattern"]) == ("0", "*.scar")


@pytest.mark.skipif(shutil.which("file") is None, reason="no file(1) here")
def test_file_names_a_scene_and_its_version(scene_file: Path) -> None:
    """The magic number is one that file(1) reads."""
    command = ["file", "-b", "-m", DESKTOP / "scar.magic"]
    said = subprocess.run([*command, scene_file], capture_output=True, text=True, check=True).stdout
    assert said.strip().endswith("version 0.3")
    assert subprocess.check_output([*command, "--mime-type", scene_file], text=True).strip() == media_type()


def test_the_thumbnailer_fills_the_file_that_it_is_given(scene_file: Path, tmp_path: Path) -> None:
    """Tumbler reads the file that it made, so another one of that name is never seen."""
    entry = ConfigParser(interpolation=None)
    entry.read(DESKTOP / "scarfmt.thumbnailer")
    section = entry["Thumbnailer Entry"]
    assert section["MimeType"] == f"{media_type()};"
    out = tmp_path / "of another"
    out.touch()
    before = out.stat().st_ino
    given = {"%i": str(scene_file), "%o": str(out)}
    command = [given.get(word, word) for word in shlex.split(section["Exec"])]
    programs = tmp_path / "bin"
    programs.mkdir()
    (programs / "scarfmt").write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m scarfmt "$@"\n')
    (programs / "scarfmt").chmod(0o755)
    subprocess.run(command, check=True, cwd=REPOSITORY, env={"PATH": f"{programs}:/usr/bin:/bin"})
    with Image.open(out) as picture:
        assert picture.format == "PNG"
    assert out.stat().st_ino == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bin", "of another", "scene.scar"]
