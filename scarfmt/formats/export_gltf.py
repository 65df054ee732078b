"""Writing glTF 2.0 with KHR_gaussian_splatting: a .glb, or a .gltf with its buffer beside it. Floats, uncompressed.

Each attribute has a buffer view of its own, which is what most readers expect; they wait spool until their sizes are
known. Memory does not grow with the scene.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64, U8
from scarfmt.container.registries import ColourSpace
from scarfmt.errors import InvalidInput
from scarfmt.formats import gltf as layout
from scarfmt.formats.frame import LUF_TO_RDF, Signs, flip_axes, flip_up, signs_to
from scarfmt.formats.output import Described, Losses, Parts, Says, Spool, Written, check_float32, finite, gaussian_sizes
from scarfmt.formats.quantise import SH_C0, opacities, unit_quaternions
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.rotation import matrix_from_quaternion

MAX_GLB_BYTES = 2**32 - 1
_ARRAY_BUFFER = 34962
_PER_VERTEX = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


@dataclass(frozen=True)
class Beside:
    """The buffer of a .gltf.

    Attributes:
        name: of the file, relative to the .gltf.
        stream: where to write it.
    """

    name: str
    stream: BinaryIO


def write_gltf(parts: Parts, described: Described, target: BinaryIO, beside: Beside | None = None) -> Written:
    """Write a glTF asset of one point primitive, in the axes of glTF. COLOR_0 is there for viewers of point clouds.

    Args:
        parts: of the scene; Gaussians keep their order.
        target: of the .glb, or of the JSON.
        beside: where the buffer goes; None for a .glb, which holds it.

    Raises:
        InvalidInput: ``output-range``: a value is not finite or too large for float32, or a .glb would have over 4 GiB;
            ``output-empty``.
    """
    signs, losses = signs_to(LUF_TO_RDF, described.frame), Losses()
    linear = described.description.colour_space == ColourSpace.LINEAR
    count, low, high = 0, np.full(3, np.inf), np.full(3, -np.inf)
    with Spool(_attributes(described.sh_degree)) as spool:
        for part in finite(parts, "glTF"):
            values = _values(flip_axes(part, signs), linear, losses)
            for name, array in values.items():
                spool.add(name, array)
            count += len(part)
            positions = values[layout.POSITION]
            steps = np.spacing(np.abs(positions).max(axis=1)).astype(np.float64)
            losses.compare_steps(steps, gaussian_sizes(part.log_scales))
            low, high = np.minimum(low, positions.min(axis=0)), np.maximum(high, positions.max(axis=0))
        document, size = _document(spool, count, linear, {"min": low.tolist(), "max": high.tolist()})
        _place(document, described, signs)
        _write(document, size, spool, target, beside)
    return Written(count, losses.notes(described, count, "glTF", _SAYS))


def write_gltf_beside(parts: Parts, described: Described, target: BinaryIO, beside: Beside | None = None) -> Written:
    """Write a .gltf and its buffer, which it cannot do without; for the rest see :func:`write_gltf`."""
    if beside is None:
        raise InvalidInput("output-format", "a .gltf needs a place for its buffer; write a .glb")
    return write_gltf(parts, described, target, beside)


_SAYS = Says.AXES | Says.LINEAR | Says.UP | Says.ORIGIN | Says.ANY_REFERENCE


def _place(document: dict[str, Any], described: Described, signs: Signs) -> None:
    """Move the node to where its positions were, turn what was up to +y, and say what the coordinates mean."""
    [node], up = document["nodes"], flip_up(described.description.up_axis, signs)
    if up not in (None, "y"):
        node["rotation"] = _UPWARD[up]
    if any(described.moved):
        moved = np.array(described.moved) * signs
        turn = matrix_from_quaternion(np.array(_UPWARD[up or "y"])[None, [3, 0, 1, 2]])[0]
        node["translation"] = (turn @ moved).tolist()
    said = described.description.metadata()
    if said:
        document["asset"]["extras"] = said


_HALF = math.sqrt(0.5)
_UPWARD = {
    "y": [0, 0, 0, 1],
    "-y": [0, 0, 1, 0],
    "x": [0, 0, _HALF, _HALF],
    "-x": [0, 0, -_HALF, _HALF],
    "z": [-_HALF, 0, 0, _HALF],
    "-z": [_HALF, 0, 0, _HALF],
}
"""Quaternions x, y, z, w that take an axis to +y."""


def _attributes(degree: int) -> list[str]:
    names = [layout.POSITION, layout.COLOUR, layout.ROTATION, layout.SCALE, layout.OPACITY]
    return names + [name for band in range(degree + 1) for name in layout.harmonics(band)]


def _values(scene: GaussianScene, linear: bool, losses: Losses) -> dict[str, NDArray[Any]]:
    """The attributes, (N, width) each, in the order of `_attributes`."""
    opacity = opacities(scene.opacity_logits)
    with np.errstate(over="ignore", under="ignore"):  # what overflows is refused below
        positions = scene.positions.astype("<f4")
        scales = np.exp(scene.log_scales.astype(np.float64)).astype("<f4")
    check_float32(positions, scales, "glTF")
    losses.count("scales too small for float32, written as 0", scales == 0)
    rotations = unit_quaternions(scene.rotations)[:, [1, 2, 3, 0]].astype("<f4")
    arrays = [positions, _colour(scene, opacity, linear), rotations, scales, opacity.astype("<f4")[:, None]]
    arrays += [scene.sh[:, number].astype("<f4") for number in range(scene.sh.shape[1])]
    return dict(zip(_attributes(scene.sh_degree), arrays, strict=True))


def _colour(scene: GaussianScene, opacity: F64, linear: bool) -> U8:
    """(N, 4) uint8: linear light, as glTF has vertex colours, and opacity."""
    colour = np.clip(scene.sh[:, 0].astype(np.float64) * SH_C0 + 0.5, 0.0, 1.0)
    if not linear:
        colour = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    rgba: U8 = np.rint(np.concatenate([colour, opacity[:, None]], axis=1) * 255).astype(np.uint8)
    return rgba


def _document(spool: Spool, count: int, linear: bool, bounds: Mapping[str, Any]) -> tuple[dict[str, Any], int]:
    """The JSON but for the place of its buffer, and the bytes of that."""
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    offset = 0
    for name in spool.names:
        size = spool.size(name)
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": size, "target": _ARRAY_BUFFER})
        if name == layout.COLOUR:
            kind = {"componentType": layout.UBYTE, "normalized": True, "type": _PER_VERTEX[size // count]}
        else:
            kind = {"componentType": layout.FLOAT, "type": _PER_VERTEX[size // count // 4]}
        place = {"bufferView": len(accessors), "count": count}
        accessors.append({**place, **kind, **(bounds if name == layout.POSITION else {})})
        offset += size
    splatting = {
        "kernel": layout.KERNEL,
        "colorSpace": layout.LINEAR if linear else layout.SRGB,
        "projection": layout.PROJECTION,
        "sortingMethod": layout.SORTING,
    }
    attributes = {name: number for number, name in enumerate(spool.names)}
    primitive = {"attributes": attributes, "mode": layout.POINTS, "extensions": {layout.EXTENSION: splatting}}
    document = {
        "asset": {"version": "2.0", "generator": "scarfmt"},
        "extensionsUsed": [layout.EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": offset}],
        "bufferViews": views,
        "accessors": accessors,
    }
    return document, offset


def _write(document: dict[str, Any], size: int, spool: Spool, target: BinaryIO, beside: Beside | None) -> None:
    if beside is not None:
        document["buffers"][0]["uri"] = beside.name
        target.write(json.dumps(document, indent=1).encode())
        _copy_all(spool, beside.stream)
        return
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    length = layout.GLB.size + 2 * layout.CHUNK.size + len(text) + size
    if length > MAX_GLB_BYTES:
        raise InvalidInput("output-range", f"a .glb holds at most 4 GiB, and this would have {length}; write a .gltf")
    target.write(layout.GLB.pack(layout.GLB_MAGIC, layout.GLB_VERSION, length))
    target.write(layout.CHUNK.pack(len(text), layout.JSON_CHUNK) + text)
    target.write(layout.CHUNK.pack(size, layout.BINARY_CHUNK))
    _copy_all(spool, target)


def _copy_all(spool: Spool, target: BinaryIO) -> None:
    for name in spool.names:
        spool.copy(name, target)
