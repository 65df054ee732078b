"""Reading and writing USD: prims of the schema ParticleField3DGaussianSplat; usd-core is needed.

Sizes are standard deviations, quaternions unit ones, harmonics grouped by Gaussian in INRIA's sign and order. The stage
says which axis is up: y, or z where the scene does.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64
from scarfmt.blocks.metadata import check_registered
from scarfmt.errors import InvalidInput, Malformed, Unsupported, missing_package
from scarfmt.formats.frame import RUB_TO_RDF, Signs, flip_axes, signs_to
from scarfmt.formats.output import Described, Losses, Parts, Says, Written, check_float32, finite, gaussian_sizes
from scarfmt.formats.quantise import log_scale, logit_of_opacity, opacities, unit_quaternions
from scarfmt.formats.source import Source, is_zip, member_names
from scarfmt.scene.description import USUAL_UP, Description
from scarfmt.scene.gaussians import GaussianScene, concatenate
from scarfmt.scene.placement import place_scene

_KIND = "ParticleField3DGaussianSplat"
_HARMONICS = "radiance:sphericalHarmonicsCoefficients"
_DEGREE = "radiance:sphericalHarmonicsDegree"
_REFERENCE = "coordinate_reference"
_PROJECTION, _PERSPECTIVE = "projectionModeHint", "perspective"
_ENDINGS = (".usd", ".usda", ".usdc", ".usdz")
_MOST_DEGREE = 3
_METHOD = slice(8, 10)
"""Where the first header of a ZIP archive has the method of compression; 0 is none."""


def sniff(source: Source) -> bool:
    """Whether the content begins as a layer of USD does, or is a ZIP archive whose first file is one, and stored.

    What is deflated is no .usdz, but a scene that somebody packed.
    """
    head = source.head(10)
    if head.startswith((b"PXR-USDC", b"#usda ")):
        return True
    if not is_zip(source) or any(head[_METHOD]):
        return False
    return PurePosixPath(next(iter(member_names(source)), "")).suffix in _ENDINGS[:3]


def load(source: Source) -> GaussianScene:
    """Read all Gaussians that the stage shows at its first moment, each where its transforms put it, in RDF or z up.

    Raises:
        InvalidInput: damaged; ``input-not-gaussians``: it shows none; ``input-dependency``: usd-core is missing.
        Unsupported: ``input-usd``: another kind of particles, an instancer, or a transform that shears or mirrors.
        LimitExceeded: more Gaussians than any scene has.

    Warns:
        InputWarning: other geometry, later moments or higher degrees of harmonics are left out; the unit is no metre,
            or the projection another one.
    """
    with _open_stage(source) as stage:
        _warn_of_units(source, stage)
        parts = [_read_prim(source, prim) for prim in _find_prims(source, stage)]
        source.check_count(sum(map(len, parts)))
        return flip_axes(concatenate(parts), (1, 1, 1) if _is_z_up(stage) else RUB_TO_RDF)


def describe(source: Source) -> Description:
    """What the stage says: z up, and the coordinate reference that :func:`write_usd` keeps.

    Warns:
        InputWarning: the coordinate reference cannot be used.
    """
    with _open_stage(source) as stage:
        description = Description(up_axis="z" if _is_z_up(stage) else None)
        said = stage.GetMetadataByDictKey("customLayerData", _REFERENCE)
    if not isinstance(said, dict):
        return description
    try:
        metadata = {_REFERENCE: {"crs": said.get("crs"), "origin": [float(number) for number in said["origin"]]}}
        check_registered(metadata)
    except (Malformed, KeyError, TypeError, ValueError) as error:
        source.warn(f"the coordinate reference cannot be used ({error}); it is left out")
        return description
    return description.with_metadata(metadata)


@contextmanager
def _open_stage(source: Source) -> Iterator[Any]:
    """The stage of an input. One in memory is put into a file, for USD reads nothing else."""
    try:
        from pxr import Tf, Usd
    except ModuleNotFoundError as error:
        raise missing_package("usd-core", "usd") from error
    with tempfile.TemporaryDirectory() as folder:
        path = source.path
        if path is None or path.suffix not in _ENDINGS:
            path = Path(folder) / ("scene.usdz" if is_zip(source) else "scene.usd")
            with source.open() as stream, path.open("wb") as copy:
                shutil.copyfileobj(stream, copy)
        try:
            yield Usd.Stage.Open(os.fspath(path))
        except Tf.ErrorException as error:
            reason = str(error).strip().splitlines()[-1][:200]
            raise source.corrupt(f"USD cannot open it ({reason})") from error


def _warn_of_units(source: Source, stage: Any) -> None:
    """Tell where the stage says that its unit is no metre: numbers are kept, and outputs say metre."""
    from pxr import UsdGeom

    metres = UsdGeom.GetStageMetersPerUnit(stage)
    if UsdGeom.StageHasAuthoredMetersPerUnit(stage) and metres != 1:
        source.warn(f"its unit is {metres:g} m; numbers are kept, and other programs may take them for metres")


def _is_z_up(stage: Any) -> bool:
    from pxr import UsdGeom

    return bool(UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z)


def _find_prims(source: Source, stage: Any) -> list[Any]:
    """All prims with Gaussians that are to be seen."""
    from pxr import Usd, UsdGeom, UsdVol

    found, hidden, others = [], 0, 0
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.PointInstancer):
            message = f"{source.name}: {prim.GetPath()} repeats what lies below it; export the scene without instancers"
            raise Unsupported("input-usd", message)
        if prim.GetTypeName() == _KIND:
            visible = UsdGeom.Imageable(prim).ComputeVisibility() != UsdGeom.Tokens.invisible
            found += [prim] if visible else []
            hidden += not visible
        elif prim.IsA(UsdVol.ParticleField) or prim.IsA(UsdVol.Volume):
            message = f"{source.name}: {prim.GetPath()} is a {prim.GetTypeName()}; this importer reads {_KIND}"
            raise Unsupported("input-usd", message)
        else:
            others += prim.IsA(UsdGeom.Gprim)
    if not found:
        what = f"its {hidden} {_KIND} are invisible" if hidden else f"no prim is a {_KIND}"
        raise InvalidInput("input-not-gaussians", f"{source.name}: {what}; give a scene of Gaussians")
    for count, what in ((hidden, "invisible prims of Gaussians"), (others, "prims of other geometry")):
        if count:
            source.warn(f"{count} {what} left out")
    return found


def _read_prim(source: Source, prim: Any) -> GaussianScene:
    projection = prim.GetAttribute(_PROJECTION).Get(_first_moment())
    if projection != _PERSPECTIVE:
        source.warn(f"{_PROJECTION} {projection!r} is taken for {_PERSPECTIVE!r}")
    positions, _ = _read(source, prim, "positions", (3,))
    scales, _ = _read(source, prim, "scales", (3,))
    # Arrays hold x, y, z, w, though the constructor of one quaternion takes w first.
    rotations, _ = _read(source, prim, "orientations", (4,))
    opacity, half = _read(source, prim, "opacities", ())
    sh = _read_harmonics(source, prim, len(positions))
    if any(len(values) != len(positions) for values in (scales, rotations, opacity)):
        raise source.corrupt("the attributes of a prim have different counts", field=str(prim.GetPath()))
    if (scales < 0).any():
        raise source.corrupt("a scale is below 0", field="scales")
    if not ((opacity >= 0) & (opacity <= 1)).all():
        raise source.corrupt("an opacity is not within 0 to 1", field="opacities")
    scene = GaussianScene(
        positions.astype(np.float64),
        log_scale(scales),
        rotations[:, [3, 0, 1, 2]].astype(np.float32),
        logit_of_opacity(opacity, "f2" if half else "f4"),
        sh,
    )
    try:
        return place_scene(scene, _transform(source, prim))
    except ValueError as error:
        message = f"{source.name}: transforms of {prim.GetPath()} mirror, shear or flatten its Gaussians ({error})"
        raise Unsupported("input-usd", f"{message}; apply them in the program that made the scene") from error


def _read_harmonics(source: Source, prim: Any, count: int) -> NDArray[np.float32]:
    """(N, (degree + 1)^2, 3) coefficients, of degree 3 at most."""
    degree = prim.GetAttribute(_DEGREE).Get(_first_moment())
    coefficients, _ = _read(source, prim, _HARMONICS, (3,))
    if not 0 <= degree < 1 << 8 or len(coefficients) != count * (degree + 1) ** 2:
        message = f"{len(coefficients)} coefficients of {count} Gaussians of degree {degree}"
        raise source.corrupt(message, field=_HARMONICS)
    if degree > _MOST_DEGREE:
        source.warn(f"spherical harmonics above degree {_MOST_DEGREE} are left out: scenes here have degree 3")
    kept = (min(degree, _MOST_DEGREE) + 1) ** 2
    return coefficients.reshape(count, (degree + 1) ** 2, 3)[:, :kept].astype(np.float32)


def _read(source: Source, prim: Any, name: str, element: tuple[int, ...]) -> tuple[NDArray[np.floating], bool]:
    """(N, *element) values of an attribute at the first moment, and whether they are of float16.

    Where the attribute of float32 is there, the one of float16 does not count.
    """
    for half, attribute in ((False, prim.GetAttribute(name)), (True, prim.GetAttribute(f"{name}h"))):
        if not attribute.HasAuthoredValue():
            continue
        if attribute.GetNumTimeSamples() > 1:
            source.warn(f"{name} has {attribute.GetNumTimeSamples()} moments, of which the first is read")
        values = np.asarray(attribute.Get(_first_moment()))
        return values.reshape(-1, *element), half
    raise source.corrupt("a prim of Gaussians lacks this attribute", field=name)


def _first_moment() -> Any:
    from pxr import Usd

    return Usd.TimeCode.EarliestTime()


def _transform(source: Source, prim: Any) -> F64:
    """The (4, 4) matrix, by columns as mathematics has it, that takes the prim's axes to those of the stage."""
    from pxr import UsdGeom

    above = prim
    while above and not UsdGeom.Xformable(above).TransformMightBeTimeVarying():
        above = above.GetParent()
    if above:
        source.warn(f"{above.GetPath()} moves; it stays where it first is")
    return np.array(UsdGeom.XformCache(_first_moment()).GetLocalToWorldTransform(prim), np.float64).T


def write_usd(parts: Parts, described: Described, target: BinaryIO) -> Written:
    """Write a binary USD layer. The whole scene has to be in memory.

    Args:
        parts: of the scene; Gaussians keep their order.

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
    losses = Losses()
    values = _values(scene, losses)
    steps = np.spacing(np.abs(values["positions"]).max(axis=1)).astype(np.float64)
    losses.compare_steps(steps, gaussian_sizes(scene.log_scales))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.usdc"
        stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z if up_axis == "z" else UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)  # else programs take the numbers for centimetres, USD's own default
        splats = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/Gaussians")
        prim = splats.GetPrim()
        stage.SetDefaultPrim(prim)
        kinds = {"positions": Vt.Vec3fArray, "orientations": Vt.QuatfArray, "scales": Vt.Vec3fArray}
        kinds |= {"opacities": Vt.FloatArray, _HARMONICS: Vt.Vec3fArray, "extent": Vt.Vec3fArray}
        for name, array in values.items():
            prim.GetAttribute(name).Set(kinds[name].FromNumpy(np.ascontiguousarray(array)))
        prim.GetAttribute(_DEGREE).Set(scene.sh_degree)
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
    return Written(len(scene), losses.notes(described, len(scene), "USD", says))


def _values(scene: GaussianScene, losses: Losses) -> dict[str, Any]:
    """The attributes by name, float32."""
    with np.errstate(over="ignore", under="ignore"):  # what overflows is refused below
        positions = scene.positions.astype(np.float32)
        scales = np.exp(scene.log_scales.astype(np.float64)).astype(np.float32)
    check_float32(positions, scales, "USD")
    losses.count("scales too small for float32, written as 0", scales == 0)
    reach = 3 * scales.max(axis=1, keepdims=True)
    return {
        "positions": positions,
        # Arrays hold x, y, z, w, though the constructor of one quaternion takes w first.
        "orientations": unit_quaternions(scene.rotations)[:, [1, 2, 3, 0]].astype(np.float32),
        "scales": scales,
        "opacities": opacities(scene.opacity_logits).astype(np.float32),
        _HARMONICS: scene.sh.reshape(-1, 3).astype(np.float32),
        "extent": np.stack([(positions - reach).min(axis=0), (positions + reach).max(axis=0)]),
    }
