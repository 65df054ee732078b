"""USD files as usd-core writes them are read back; what cannot be drawn is refused or named."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scarfmt.errors import InputWarning, InvalidInput, ScarError, Unsupported
from scarfmt.formats import load
from scarfmt.formats.output import Described
from scarfmt.formats.outputs import write_parts
from scarfmt.formats.quantise import opacities
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.placement import Placement
from tests.formats.scene_files import read_scene, zipped
from tests.formats.test_descriptions import some_scene
from tests.samples.codec_samples import refuses

usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
gf, geometry, volume, vt = (__import__(f"pxr.{name}", fromlist=["_"]) for name in ("Gf", "UsdGeom", "UsdVol", "Vt"))


def written(scene: GaussianScene) -> bytes:
    out = io.BytesIO()
    write_parts("usd", [scene], Described.of(scene), out)
    return out.getvalue()


def edited(change: Callable[[Any], None], scene: GaussianScene, folder: Path, ending: str = ".usda") -> Path:
    """A file of `scene` after a change of its stage."""
    (folder / "before.usdc").write_bytes(written(scene))
    stage = usd.Stage.Open(str(folder / "before.usdc"))
    change(stage)
    path = folder / f"after{ending}"
    stage.Flatten().Export(str(path))
    return path


def assert_equal(found: GaussianScene, expected: GaussianScene) -> None:
    np.testing.assert_allclose(found.positions, expected.positions, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.log_scales, expected.log_scales, atol=1e-5)
    np.testing.assert_allclose(opacities(found.opacity_logits), opacities(expected.opacity_logits), atol=1e-6)
    np.testing.assert_allclose(found.sh, expected.sh, atol=1e-5)
    unit = [scene.rotations / np.linalg.norm(scene.rotations, axis=1, keepdims=True) for scene in (found, expected)]
    np.testing.assert_allclose(np.abs((unit[0] * unit[1]).sum(axis=1)), 1, atol=1e-5)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("up_axis", [None, "z"])
def test_there_and_back(degree: int, up_axis: str | None) -> None:
    scene = replace(some_scene(degree=degree), description=Description(up_axis=up_axis))
    back = read_scene(written(scene))
    assert_equal(back, scene)
    assert back.description.up_axis == up_axis


def test_the_file_holds_floats_under_the_names_of_its_schema(tmp_path: Path) -> None:
    scene = replace(some_scene(), description=Description(up_axis="z"))
    (tmp_path / "a.usdc").write_bytes(written(scene))
    stage = usd.Stage.Open(str(tmp_path / "a.usdc"))
    prim = stage.GetDefaultPrim()
    np.testing.assert_array_equal(np.array(prim.GetAttribute("positions").Get()), scene.positions.astype(np.float32))
    real = np.array([q.GetReal() for q in prim.GetAttribute("orientations").Get()])
    np.testing.assert_allclose(real, scene.rotations[:, 0] / np.linalg.norm(scene.rotations, axis=1), atol=1e-6)
    # USD takes a layer that does not say its unit for one of centimetres.
    assert geometry.GetStageMetersPerUnit(stage) == 1
    # USD computes no extent of Gaussians: without one, the box of the scene is empty.
    box = geometry.BBoxCache(0, ["default"]).ComputeWorldBound(prim).ComputeAlignedRange()
    reach = 3 * np.exp(scene.log_scales).max(axis=1, keepdims=True)
    np.testing.assert_allclose(box.GetMin(), (scene.positions - reach).min(axis=0), rtol=1e-5)
    np.testing.assert_allclose(box.GetMax(), (scene.positions + reach).max(axis=0), rtol=1e-5)


def test_the_coordinate_reference_and_the_origin_come_back() -> None:
    said = Description(coordinate_reference="EPSG:25832", origin=(5e5, 5e6, 400.0))
    back = read_scene(written(replace(some_scene(), description=said))).description
    assert (back.coordinate_reference, back.origin) == ("EPSG:25832", (5e5, 5e6, 400.0))


@pytest.mark.parametrize("ending", [".usda", ".usdc", ".usd"])
def test_layers_of_each_kind_are_read_by_content(ending: str, tmp_path: Path) -> None:
    scene = some_scene(20)
    path = edited(lambda stage: None, scene, tmp_path, ending)
    assert_equal(read_scene(path.read_bytes()), scene)
    assert_equal(read_scene(path), scene)


def test_a_package_is_read(tmp_path: Path) -> None:
    from pxr import UsdUtils

    scene = some_scene(20)
    path = edited(lambda stage: None, scene, tmp_path, ".usdc")
    assert UsdUtils.CreateNewUsdzPackage(str(path), str(tmp_path / "a.usdz"))
    assert_equal(read_scene(tmp_path / "a.usdz"), scene)
    assert_equal(read_scene((tmp_path / "a.usdz").read_bytes()), scene)
    for name in (path.name, "a.usdz"):
        packed = zipped({f"export/{name}": (tmp_path / name).read_bytes()}, zipfile.ZIP_DEFLATED)
        assert_equal(read_scene(packed), scene)


def test_transforms_of_parents_place_the_gaussians(tmp_path: Path) -> None:
    scene = replace(some_scene(50), description=Description(up_axis="z"))

    def move(stage: Any) -> None:
        above = geometry.Xform.Define(stage, "/World")
        above.AddTranslateOp().Set(gf.Vec3d(1, 2, 3))
        above.AddRotateZOp().Set(90.0)
        above.AddScaleOp().Set(gf.Vec3f(2, 2, 2))
        copy = volume.ParticleField3DGaussianSplat.Define(stage, "/World/Gaussians").GetPrim()
        for attribute in stage.GetPrimAtPath("/Gaussians").GetAuthoredAttributes():
            copy.GetAttribute(attribute.GetName()).Set(attribute.Get())
        stage.RemovePrim("/Gaussians")

    found = read_scene(edited(move, scene, tmp_path))
    placement = Placement.of([[0, -2, 0, 1], [2, 0, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]])
    assert_equal(found, placement.scene(scene))


def test_values_of_float16_are_read_where_there_are_none_of_float32(tmp_path: Path) -> None:
    scene = some_scene(20)

    def halve(stage: Any) -> None:
        prim = stage.GetPrimAtPath("/Gaussians")
        values = np.array(prim.GetAttribute("opacities").Get()).astype(np.float16)
        values[0] = 1.0
        prim.GetAttribute("opacitiesh").Set(vt.HalfArray.FromNumpy(values))
        prim.RemoveProperty("opacities")

    found = read_scene(edited(halve, scene, tmp_path))
    np.testing.assert_allclose(opacities(found.opacity_logits[1:]), opacities(scene.opacity_logits[1:]), atol=1e-3)
    assert np.isfinite(found.opacity_logits[0])


def hide_one(stage: Any) -> None:
    hidden = volume.ParticleField3DGaussianSplat.Define(stage, "/Hidden")
    hidden.CreateVisibilityAttr("invisible")


def add_mesh(stage: Any) -> None:
    geometry.Mesh.Define(stage, "/Mesh")


def move_in_time(stage: Any) -> None:
    attribute = stage.GetPrimAtPath("/Gaussians").GetAttribute("positions")
    first = attribute.Get()
    attribute.Clear()
    attribute.Set(first, 1.0)
    attribute.Set(first, 2.0)


def move_above(stage: Any) -> None:
    operation = geometry.Xformable(stage.GetPrimAtPath("/Gaussians")).AddTranslateOp()
    operation.Set(gf.Vec3d(0, 0, 0), 1.0)
    operation.Set(gf.Vec3d(0, 0, 9), 2.0)


def project(stage: Any) -> None:
    stage.GetPrimAtPath("/Gaussians").GetAttribute("projectionModeHint").Set("tangential")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (hide_one, "1 invisible"),
        (add_mesh, "1 prims of other geometry"),
        (move_in_time, "2 moments"),
        (move_above, "/Gaussians moves"),
        (project, "'tangential' is taken for 'perspective'"),
        (lambda stage: geometry.SetStageMetersPerUnit(stage, 0.01), "its unit is 0.01 m; numbers are kept"),
    ],
)
def test_what_is_left_out_is_named(change: Callable[[Any], None], message: str, tmp_path: Path) -> None:
    scene = some_scene(20)
    with pytest.warns(InputWarning, match=message):
        assert_equal(read_scene(edited(change, scene, tmp_path)), scene)


def set_value(name: str, value: object) -> Callable[[Any], None]:
    return lambda stage: stage.GetPrimAtPath("/Gaussians").GetAttribute(name).Set(value)


def mirror(stage: Any) -> None:
    geometry.Xformable(stage.GetPrimAtPath("/Gaussians")).AddScaleOp().Set(gf.Vec3f(1, 1, -1))


def repeat(stage: Any) -> None:
    geometry.PointInstancer.Define(stage, "/Many")


@pytest.mark.parametrize(
    ("change", "kind", "refusal"),
    [
        (repeat, Unsupported, "input-usd"),
        (lambda stage: stage.RemovePrim("/Gaussians"), InvalidInput, "input-not-gaussians"),
        (lambda stage: stage.GetPrimAtPath("/Gaussians").SetTypeName("ParticleField"), Unsupported, "input-usd"),
        (mirror, Unsupported, "input-usd"),
        (set_value("opacities", vt.FloatArray([1.5] * 20)), InvalidInput, "input-corrupt"),
        (set_value("scales", vt.Vec3fArray([(1, -1, 1)] * 20)), InvalidInput, "input-corrupt"),
        (set_value("scales", vt.Vec3fArray([(1, 1, 1)] * 19)), InvalidInput, "input-corrupt"),
        (set_value("radiance:sphericalHarmonicsDegree", 2), InvalidInput, "input-corrupt"),
        (set_value("radiance:sphericalHarmonicsDegree", -1), InvalidInput, "input-corrupt"),
        (lambda stage: stage.GetPrimAtPath("/Gaussians").RemoveProperty("scales"), InvalidInput, "input-corrupt"),
    ],
    ids=["repeat", "none", "particles", "mirror", "opacity", "scale", "counts", "degree", "negative", "lacking"],
)
def test_what_cannot_be_read_is_refused(
    change: Callable[[Any], None], kind: type[ScarError], refusal: str, tmp_path: Path
) -> None:
    refuses(refusal, lambda: load(edited(change, some_scene(20), tmp_path)), kind=kind)


def test_damage_is_refused() -> None:
    refuses("input-corrupt", lambda: load(written(some_scene(20))[:200]), "USD cannot open it")
