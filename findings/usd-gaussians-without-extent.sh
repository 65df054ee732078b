#!/usr/bin/env bash
# usd-core computes the box of points and meshes, but none of Gaussians whose extent is not written.
#
# One would expect: BBoxCache to compute the box of a ParticleField3DGaussianSplat from its positions and sizes, as it does
#   for Points, Mesh and every other geometry: the schema is a Boundable like those.
# What happens: no plugin of usd-core computes it. ComputeExtentFromPlugins gives None, BBoxCache an empty box, and a stage
#   that holds nothing else has none; no warning is given. The file is valid: `extent` is not required.
# Package: usd-core 26.11 (PyPI). Date: 2026-11-28.
# Why it matters: viewers frame, cull and place clipping planes by this box. A scene without `extent` opens empty, or is
#   culled away beside a mesh. Write `extent`, with room for the sizes; do not rely on the box of a file you read.
# Output seen:
#   Points: computed (0.75, 1.75, 2.75) to (4.25, 5.25, 6.25), empty box: False
#   ParticleField3DGaussianSplat: computed none, empty box: True
#   the same with extent: empty box: False
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv tools
tools/bin/pip install --quiet usd-core==26.11 2>pip.log
tools/bin/python - <<'PY'
import sys

from pxr import Gf, Usd, UsdGeom, UsdVol, Vt

stage = Usd.Stage.CreateInMemory()
places = Vt.Vec3fArray([Gf.Vec3f(1, 2, 3), Gf.Vec3f(4, 5, 6)])
points = UsdGeom.Points.Define(stage, "/Points")
points.CreatePointsAttr(places)
points.CreateWidthsAttr([0.5, 0.5])
splats = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/Splats")
splats.GetPrim().GetAttribute("positions").Set(places)
splats.GetPrim().GetAttribute("scales").Set(Vt.Vec3fArray([Gf.Vec3f(0.25)] * 2))


def is_empty(prim):
    return UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(prim).GetRange().IsEmpty()


found = []
for shape in (points, splats):
    prim = shape.GetPrim()
    computed = UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(prim), Usd.TimeCode.Default())
    box = "none" if computed is None else f"{computed[0]} to {computed[1]}"
    found.append((computed is None, is_empty(prim)))
    print(f"{prim.GetTypeName()}: computed {box}, empty box: {is_empty(prim)}")
splats.GetPrim().GetAttribute("extent").Set(Vt.Vec3fArray([Gf.Vec3f(0.25), Gf.Vec3f(6.75)]))
print(f"the same with extent: empty box: {is_empty(splats.GetPrim())}")
sys.exit(found != [(False, False), (True, True)] or is_empty(splats.GetPrim()))
PY
