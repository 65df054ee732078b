"""Projects of SuperSplat: each splat where the document puts it, and a word on what is not applied."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from scarfmt.container.registries import RenderModel
from scarfmt.errors import InputWarning
from scarfmt.formats import load
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.scene_files import inria_ply, odd_scene, read_scene, scene_ply, zipped
from tests.samples.codec_samples import refuses

AS_LOADED = {"position": [0, 0, 0], "rotation": [0, 0, 1, 0], "scale": [1, 1, 1], "visible": True}
UNGRADED = {"tintClr": [1, 1, 1, 1], "temperature": 0, "saturation": 1, "brightness": 0, "blackPoint": 0}


def project(*splats: dict[str, Any], scene: GaussianScene | None = None, version: object = 0) -> bytes:
    """A project whose splats all have the same Gaussians."""
    ply = inria_ply() if scene is None else scene_ply(scene, ["SplatRenderMode: mip"])
    document = {"version": version, "camera": {}, "splats": [AS_LOADED | UNGRADED | splat for splat in splats]}
    files = {"document.json": json.dumps(document).encode()}
    return zipped(files | {f"splat_{index}.ply": ply for index in range(len(splats))})


def test_a_splat_that_nobody_moved_is_its_ply() -> None:
    """The editor turns a PLY by half a turn about z when it loads it, and back when it exports."""
    scene = odd_scene(1, 40, 3)
    read = read_scene(project({}, scene=scene))
    np.testing.assert_allclose(read.positions, scene.positions, atol=1e-9)
    np.testing.assert_allclose(read.sh, scene.sh, atol=1e-5)
    assert read.description.render_model == RenderModel.ANTIALIASED


def test_splats_stand_where_the_document_puts_them() -> None:
    """Moved up by 3 and made twice as large, beside one that was not touched."""
    scene = odd_scene(2, 10, 0, reach=1)
    read = read_scene(project({}, {"position": [0, 3, 0], "scale": [2, 2, 2]}, scene=scene))
    np.testing.assert_allclose(read.positions[10:], 2 * scene.positions - (0, 3, 0), atol=1e-6)
    np.testing.assert_allclose(read.log_scales[10:, :2], scene.log_scales[:, :2] + np.log(2), atol=1e-5)


def test_what_is_not_applied_is_told() -> None:
    with pytest.warns(InputWarning, match=r"grading \(tintClr, transparency\)"):
        load(project({"tintClr": [1, 0.5, 1, 1], "transparency": 0.5}))
    with pytest.warns(InputWarning, match="1 hidden splat left out"):
        assert len(load(project({}, {"visible": False}))) == 5


@pytest.mark.parametrize(
    ("data", "refusal"),
    [
        (project({"visible": False}), "input-empty"),
        (project({}, version=1), "input-version"),
        (project({}, version=None), "input-version"),
        (project({"scale": [1, -1, 1]}), "input-range"),
        (project({"position": [0, "x", 0]}), "input-corrupt"),
        (zipped({"document.json": b'{"version": 0, "splats": [{}]}'}), "input-corrupt"),
        (zipped({"document.json": b'{"version": 0, "splats": [1]}', "splat_0.ply": inria_ply()}), "input-corrupt"),
        (zipped({"document.json": b'{"version": 0, "splats": []}'}), "input-empty"),
    ],
)
def test_what_cannot_be_read_is_refused(data: bytes, refusal: str) -> None:
    refuses(refusal, lambda: load(data))
