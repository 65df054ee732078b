#!/usr/bin/env bash
# A USD prim does not keep its stage alive, though a stage keeps its layers alive.
#
# One would expect: a function that opens a stage and returns a prim of Gaussians returns something that can be read;
#   in Python an object holds what it needs.
# What happens: the stage is freed when the function returns. The prim is invalid, and reading from it raises an error
#   of an expired prim. An attribute that was taken before is as dead. While anything else holds the stage, the same
#   code works, so a test that keeps the stage in a variable passes. A layer behaves otherwise: a stage holds it.
# Package: usd-core 26.11 (PyPI). Date: 2026-11-28.
# Why it matters: readers of splats in USD walk to a prim and pass it on; they must pass the stage on with it.
# Output seen:
#   usd-core 26.11
#   prim, stage held: valid, 3 positions
#   prim, stage not held: invalid
#   its attribute: RuntimeError
#   attribute that was taken while the stage was there: invalid, RuntimeError
#   stage, layer not held: valid
set -euo pipefail
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
python3 -m venv "$place/venv"
"$place/venv/bin/pip" install --quiet --disable-pip-version-check 'usd-core==26.11'
cd "$place"
mkdir work && cd work
"$place/venv/bin/python" - <<'PYTHON'
import sys
from importlib.metadata import version

from pxr import Gf, Sdf, Usd, Vt

stage = Usd.Stage.CreateNew("splats.usda")
made = stage.DefinePrim("/splats", "ParticleField3DGaussianSplat")
places = Vt.Vec3fArray([Gf.Vec3f(k, 0, 0) for k in range(3)])
made.CreateAttribute("positions", Sdf.ValueTypeNames.Point3fArray).Set(places)
stage.Save()
del made, stage


def open_prim() -> Usd.Prim:
    return Usd.Stage.Open("splats.usda").GetPrimAtPath("/splats")


def open_attribute() -> Usd.Attribute:
    return open_prim_of(Usd.Stage.Open("splats.usda"))


def open_prim_of(stage: Usd.Stage) -> Usd.Attribute:
    return stage.GetPrimAtPath("/splats").GetAttribute("positions")


def stage_of_layer() -> Usd.Stage:
    return Usd.Stage.Open(Sdf.Layer.FindOrOpen("splats.usda"))


def failure(call) -> str:
    try:
        call()
    except Exception as error:
        return type(error).__name__
    return "nothing"


def state(thing) -> str:
    return "valid" if thing else "invalid"


print(f"usd-core {version('usd-core')}")
held = Usd.Stage.Open("splats.usda")
prim = held.GetPrimAtPath("/splats")
count = len(prim.GetAttribute("positions").Get())
with_stage = state(prim)
print(f"prim, stage held: {with_stage}, {count} positions")
del prim, held
prim = open_prim()
print(f"prim, stage not held: {state(prim)}")
first = failure(lambda: prim.GetAttribute("positions"))
print(f"its attribute: {first}")
attribute = open_attribute()
read = failure(lambda: attribute.Get())
print(f"attribute that was taken while the stage was there: {state(attribute)}, {read}")
layered = stage_of_layer()
print(f"stage, layer not held: {state(layered.GetPrimAtPath('/splats'))}")
as_seen = (
    (with_stage, count) == ("valid", 3)
    and not prim
    and first == "RuntimeError"
    and not attribute
    and read == "RuntimeError"
    and bool(layered.GetPrimAtPath("/splats"))
)
sys.exit(0 if as_seen else "behaviour has changed")
PYTHON
