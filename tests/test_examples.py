"""The example scene and its cameras."""

from __future__ import annotations

import io
import json
import os
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

import scarfmt
from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import assemble_file, code_blocks
from scarfmt.container.file import Block
from scarfmt.container.schema import SIGNATURE, BlockKind
from scarfmt.formats import load
from scarfmt.formats.quantise import SH_C0
from scarfmt.render.capture import load_cameras
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.rotation import matrix_from_quaternion
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


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder that has the command scarfmt."""
    (tmp_path / "bin").mkdir()
    command = f"cd {shlex.quote(str(REPOSITORY))} && exec {shlex.quote(sys.executable)} -m scarfmt"
    (tmp_path / "bin" / "scarfmt").write_text(f'#!/bin/sh\n{command} "$@"\n')
    (tmp_path / "bin" / "scarfmt").chmod(0o755)
    return tmp_path / "bin"


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


def test_the_thumbnailer_fills_the_file_that_it_is_given(scene_file: Path, programs: Path, tmp_path: Path) -> None:
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
    subprocess.run(command, check=True, env={"PATH": f"{programs}:/usr/bin:/bin"})
    with Image.open(out) as picture:
        assert picture.format == "PNG"
    assert out.stat().st_ino == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bin", "of another", "scene.scar"]


IN_BLENDER = """
import json, sys, bpy
attributes = bpy.data.objects["scene"].data.attributes
shown = bpy.context.evaluated_depsgraph_get().object_instances
found = {
    "matrices": [[list(row) for row in item.matrix_world] for item in shown if item.is_instance],
    "color": [list(item.color) for item in attributes["color"].data],
    "opacity": [item.value for item in attributes["opacity"].data],
}
open(sys.argv[-1], "w").write(json.dumps(found))
"""


@pytest.mark.skipif(shutil.which("blender") is None, reason="no Blender here")
def test_blender_shows_an_upright_ellipsoid_for_each_gaussian(scene_file: Path, programs: Path, tmp_path: Path) -> None:
    """Places, sizes and turns are those of the file, where z is up; colours are in linear light."""
    script = EXAMPLES / "blender" / "import_scar.py"
    command = ["blender", "--background", "--factory-startup", "--python-exit-code", "1", "--python", script]
    command += ["--python-expr", IN_BLENDER, "--", scene_file, tmp_path / "found.json"]
    subprocess.run(command, check=True, env={**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"})
    found = {name: np.array(rows) for name, rows in json.loads((tmp_path / "found.json").read_text()).items()}
    scene = scarfmt.load(scene_file)
    assert isinstance(scene, GaussianScene)
    upright = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # x right, y down, z forward
    np.testing.assert_allclose(found["matrices"][:, :3, 3], scene.positions @ upright.T, atol=1e-5)
    axes = upright @ matrix_from_quaternion(scene.rotations) * np.exp(scene.log_scales)[:, None]
    largest = np.exp(2 * scene.log_scales.max(axis=1))[:, None, None]
    shapes, expected = (m @ m.transpose(0, 2, 1) / largest for m in (found["matrices"][:, :3, :3], axes))
    np.testing.assert_allclose(shapes, expected, atol=1e-4)
    np.testing.assert_allclose(found["opacity"], 1 / (1 + np.exp(-scene.opacity_logits)), atol=1e-6)
    shown = np.maximum(0.5 + SH_C0 * scene.sh[:, 0], 0)
    back = np.where(found["color"] <= 0.0031308, found["color"] * 12.92, 1.055 * found["color"] ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(back[:, :3], shown, atol=1e-5)
