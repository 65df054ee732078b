"""Writing USD: one prim of the schema ParticleField3DGaussianSplat, in a binary layer, .usdc; usd-core is needed.

Sizes are standard deviations, quaternions unit ones, harmonics grouped by Gaussian in INRIA's sign and order. The stage
says which axis is up: y, or z where the scene does.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from scarfmt.errors import InvalidInput, missing_package
from scarfmt.formats.frame import RUB_TO_RDF, Signs, flip_axes, signs_to
from scarfmt.formats.output import CoarseSteps, Described, Losses, Parts, Says, Written, finite
from scarfmt.formats.quantise import opacities, unit_quaternions
from scarfmt.scene.description import USUAL_UP
from scarfmt.scene.gaussians import GaussianScene, concatenate


def write_usd(parts: Parts, described: Described, target: BinaryIO) -> Written:
    """Write a binary USD layer. The whole scene has to be in memory.

    Args:
        parts: of the scene; Gaussians keep their order.
        described: the scene.
        target: where to.

    Raises:
        InvalidInput: ``output-range``: a value is not finite or too large for float32; ``output-empty``;
            ``input-dependency``: usd-core is missing.
    """
    try:
        from pxr import Gf, Usd, UsdGeom, UsdVol, Vt
    except ModuleNotFoundError as error:
        raise missing_package("usd-core", "usd") from error
    up_axis = described.description.up_axis
    signs: Signs = (1, 1, 1) if up_axis == "z" else signs_to(RUB_TO_RDF, described.frame)
    scene = flip_axes(concatenate(list(finite(parts, "USD"))), signs)
    losses, steps = Losses(), CoarseSteps()
    values = _values(scene, losses)
    steps.add(np.spacing(np.abs(values["positions"]).max(axis=1)).astype(np.float64), scene.log_scales)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.usdc"
        stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z if up_axis == "z" else UsdGeom.Tokens.y)
        splats = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/Gaussians")
        prim = splats.GetPrim()
        stage.SetDefaultPrim(prim)
        kinds = {"positions": Vt.Vec3fArray, "orientations": Vt.QuatfArray, "scales": Vt.Vec3fArray}
        kinds |= {
            "opacities": Vt.FloatArray,
            "radiance:sphericalHarmonicsCoefficients": Vt.Vec3fArray,
            "extent": Vt.Vec3fArray,
        }
        for name, array in values.items():
            prim.GetAttribute(name).Set(kinds[name].FromNumpy(np.ascontiguousarray(array)))
        prim.GetAttribute("radiance:sphericalHarmonicsDegree").Set(scene.sh_degree)
        if any(described.moved):
            splats.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(
                Gf.Vec3d(*np.multiply(described.moved, signs).tolist())
            )
        for key, said in described.description.metadata().items():
            stage.SetMetadataByDictKey(
                "customLayerData", key, {"crs": said["crs"], "origin": Gf.Vec3d(*said["origin"])}
            )
        stage.Save()
        with path.open("rb") as layer:
            shutil.copyfileobj(layer, target)
    says = Says.ORIGIN | Says.ANY_REFERENCE | Says.AXES
    says |= Says.UP if up_axis in (None, USUAL_UP, "z") else Says.NOTHING
    return Written(len(scene), losses.notes(described, len(scene), "USD", says, steps))


def _values(scene: GaussianScene, losses: Losses) -> dict[str, Any]:
    """The attributes by name, float32."""
    with np.errstate(over="ignore", under="ignore"):  # what overflows is refused below
        positions = scene.positions.astype(np.float32)
        scales = np.exp(scene.log_scales.astype(np.float64)).astype(np.float32)
    if not (np.isfinite(positions).all() and np.isfinite(scales).all()):
        raise InvalidInput("output-range", "a position or a scale is too large for the float32 of USD")
    losses.count("scales too small for float32, written as 0", scales == 0)
    reach = 3 * scales.max(axis=1, keepdims=True)
    return {
        "positions": positions,
        # Arrays hold x, y, z, w, though the constructor of one quaternion takes w first.
        "orientations": unit_quaternions(scene.rotations)[:, [1, 2, 3, 0]].astype(np.float32),
        "scales": scales,
        "opacities": opacities(scene.opacity_logits).astype(np.float32),
        "radiance:sphericalHarmonicsCoefficients": scene.sh.reshape(-1, 3).astype(np.float32),
        "extent": np.stack([(positions - reach).min(axis=0), (positions + reach).max(axis=0)]),
    }
