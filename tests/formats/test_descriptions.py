"""What a file says about its scene reaches every output that has a word for it, and is named where one has none."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scarfmt.container.registries import RenderModel
from scarfmt.errors import InputWarning
from scarfmt.formats.output import Described, Written
from scarfmt.formats.outputs import write_parts
from scarfmt.formats.quantise import FLAT_LOG_SCALE, opacities
from scarfmt.formats.spz import SpzOptions
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.scene_files import read_scene
from tests.samples.codec_samples import refuses

FIXED_ORDER = ("ply", "glb", "spz", "splat")
EVERY = (*FIXED_ORDER, "compressed-ply", "sog")
UTM = np.array([512345.25, 5412345.5, 412.0])


def some_scene(count: int = 300, degree: int = 1) -> GaussianScene:
    rng = np.random.default_rng(7)
    return GaussianScene(
        rng.normal(size=(count, 3)),
        rng.uniform(-3.5, -2.5, (count, 3)).astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        rng.normal(size=count).astype(np.float32),
        (0.3 * rng.normal(size=(count, (degree + 1) ** 2, 3))).astype(np.float32),
    )


def there_and_back(
    format_id: str, scene: GaussianScene, options: SpzOptions | None = None
) -> tuple[GaussianScene, Written]:
    out = io.BytesIO()
    written = write_parts(format_id, [scene], Described.of(scene), out, options)
    named = "splat" if format_id == "splat" else None
    return read_scene(out.getvalue(), format=named), written


@pytest.mark.parametrize("format_id", EVERY)
@pytest.mark.parametrize("model", [RenderModel.ANTIALIASED, RenderModel.TWO_DIMENSIONAL])
def test_the_render_model_is_kept_or_named(format_id: str, model: RenderModel) -> None:
    scene = replace(some_scene(), description=Description(model))
    back, written = there_and_back(format_id, scene)
    kept = back.description.render_model == model
    assert kept == (format_id in ("ply", "compressed-ply", "sog") or (format_id == "spz" and model == 1))
    assert kept != any(model.name.lower().replace("_", "-") in note for note in written.notes)


@pytest.mark.parametrize("up_axis", ["x", "-x", "y", "-y", "z", "-z"])
def test_the_up_axis_is_kept_by_ply_and_turned_upright_by_gltf(up_axis: str) -> None:
    scene = replace(some_scene(), description=Description(up_axis=up_axis))
    back, _ = there_and_back("ply", scene)
    assert back.description.up_axis == up_axis
    upright, _ = there_and_back("glb", scene)
    height = scene.positions[:, "xyz".index(up_axis[-1])]
    np.testing.assert_allclose(-upright.positions[:, 1], -height if up_axis[0] == "-" else height, atol=1e-6)
    named = any("up axis" in note for note in there_and_back("spz", scene)[1].notes)
    assert named == (up_axis != "-y")


@pytest.mark.parametrize("format_id", EVERY)
def test_positions_far_from_zero_keep_their_millimetres(format_id: str) -> None:
    near = some_scene()
    scene = replace(near, positions=near.positions + UTM, description=Description(coordinate_reference="EPSG:25832"))
    back, written = there_and_back(format_id, scene)
    assert any("512345" in note for note in written.notes)
    origin = np.array(back.description.origin)
    if format_id not in ("ply", "compressed-ply", "glb"):
        assert any("keep it with the file" in note for note in written.notes)
        origin = np.rint(np.median(scene.positions, axis=0))
    if format_id in ("ply", "compressed-ply", "glb"):
        assert back.description.coordinate_reference == "EPSG:25832"
    found, wanted = np.sort(back.positions + origin, axis=0), np.sort(scene.positions, axis=0)
    np.testing.assert_allclose(found, wanted, atol=1e-6 if format_id in FIXED_ORDER else 5e-3, rtol=0)


def test_a_reference_of_other_axes_than_those_read_is_named() -> None:
    """Nodes of glTF turn what was up upright: coordinates read there are not those of the system any more."""
    scene = replace(some_scene(), description=Description(up_axis="z", coordinate_reference="EPSG:25832"))
    with pytest.warns(InputWarning, match="coordinate reference"):
        back, _ = there_and_back("glb", scene)
    assert not back.description.coordinate_reference


def test_scenes_near_zero_are_not_moved() -> None:
    scene = some_scene()
    back, written = there_and_back("ply", replace(scene, positions=scene.positions + 3.25))
    assert not any(back.description.origin)
    assert not written.notes


def test_one_gaussian_far_away_is_no_reason_to_lose_the_others() -> None:
    scene = some_scene(500)
    scene.positions[7, 0] = 4e6
    refuses("output-range", lambda: there_and_back("spz", scene), "--spz-fraction-bits 1")
    _, accepted = there_and_back("spz", scene, SpzOptions(fraction_bits=1))
    assert any("rounded to up to 0.5" in note for note in accepted.notes)
    back, written = there_and_back("compressed-ply", scene)
    assert any("more than they are wide: 244 of 500" in note for note in written.notes)
    apart = np.abs(back.positions[:256, None] - scene.positions).max(axis=2).min(axis=1)
    assert apart.max() < 0.01  # the floater spoils its own chunk alone


@pytest.mark.parametrize("format_id", ["spz", "sog", "compressed-ply"])
def test_sizes_of_zero_are_no_measure_of_a_step(format_id: str) -> None:
    scene = some_scene(500)
    scene.log_scales[:400] = FLAT_LOG_SCALE
    back, written = there_and_back(format_id, scene)
    assert len(back) == 500
    assert not any("more than they are wide" in note for note in written.notes)


def test_splat_rounds_to_bytes_and_keeps_floats() -> None:
    scene = some_scene(degree=1)
    back, written = there_and_back("splat", scene)
    assert any("spherical harmonics, left out" in note for note in written.notes)
    np.testing.assert_allclose(back.positions, scene.positions, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(back.log_scales, scene.log_scales, atol=1e-5)
    np.testing.assert_allclose(opacities(back.opacity_logits), opacities(scene.opacity_logits), atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(back.sh, scene.sh[:, :1], atol=0.5 / 255 / 0.282 + 1e-6)


def test_sog_rounds_to_its_codebooks() -> None:
    scene = some_scene(3000, degree=2)
    back, _ = there_and_back("sog", scene)
    nearest = np.array([np.abs(scene.positions - place).max(axis=1).argmin() for place in back.positions])
    assert len(np.unique(nearest)) == len(scene)
    source = scene.take(nearest)
    assert np.abs(back.positions - source.positions).max() < 1e-3
    assert np.abs(back.log_scales - source.log_scales).max() < 0.01
    assert np.sqrt(((back.sh[:, 1:] - source.sh[:, 1:]) ** 2).mean()) < 0.75 * source.sh[:, 1:].std()
    assert np.abs(back.sh[:, 0] - source.sh[:, 0]).mean() < 0.005


@pytest.mark.scene
@pytest.mark.parametrize("name", ["01_mip_comment.ply", "01b_postshot_antialiased.ply"])
def test_marks_of_trainers_are_kept(name: str, shared_data: Path) -> None:
    scene = read_scene(shared_data / "odd-files" / "reports" / name)
    assert there_and_back("spz", scene)[0].description.render_model == RenderModel.ANTIALIASED
