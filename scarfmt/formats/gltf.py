"""Reading Gaussians of glTF 2.0 assets, .glb or .gltf, with KHR_gaussian_splatting (:mod:`gltf_layout`).

All point primitives of the default scene that have the extension make one scene, each where its nodes put it.
Attributes are floats or, where the extension has them, integers. Axes are turned to RDF, those of INRIA's PLY.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64
from scarfmt.errors import InputWarning, InvalidInput, Unsupported
from scarfmt.formats import gltf_layout as layout
from scarfmt.formats.frame import LUF_TO_RDF, flip_axes
from scarfmt.formats.gltf_buffers import Asset
from scarfmt.formats.gltf_nodes import moved, placed_meshes
from scarfmt.formats.joined import together
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import GaussianScene

_UNDERSTOOD = frozenset({layout.EXTENSION, "KHR_mesh_quantization"})
_POSITIONS = frozenset({layout.FLOAT, layout.BYTE, layout.UBYTE, layout.SHORT, layout.USHORT})
_ROTATIONS = frozenset({layout.FLOAT, layout.BYTE, layout.SHORT})
_UNSIGNED = frozenset({layout.FLOAT, layout.UBYTE, layout.USHORT})
_HALF_TINIEST = 2.0**-150
"""Half the least number of float32 above 0. It stands for a scale of 0, which has no logarithm."""
_OPACITY_ENDS = {
    layout.FLOAT: (_HALF_TINIEST, 2.0**-25),
    layout.UBYTE: (0.5 / 255, 0.5 / 255),
    layout.USHORT: (0.5 / 65535, 0.5 / 65535),
}
"""Half the steps of opacity next to 0 and to 1, which have no logits and are read as that much more and less."""


@dataclass(frozen=True)
class _Placed:
    """A primitive with Gaussians: its JSON, the matrix of its node, and how many it declares."""

    primitive: dict[str, Any]
    matrix: F64
    count: int


def sniff(source: Source) -> bool:
    """Whether the content is a .glb, or JSON that names a glTF asset in its first bytes."""
    head = source.head(1 << 14)
    return head[:4] == layout.GLB_MAGIC or (head.lstrip()[:1] == b"{" and b'"asset"' in head)


def load(source: Source) -> GaussianScene:
    """Read the Gaussians of a glTF asset.

    Raises:
        InvalidInput: damaged, a buffer is missing, or there are no Gaussians in it (``input-not-gaussians``).
        Unsupported: another version, kernel or colour space; compressed or sparse; a node that shears or mirrors.
        LimitExceeded: more JSON, or more Gaussians, than any scene has.
    """
    asset = Asset(source)
    required = [str(name)[:80] for name in asset.array(asset.document, "extensionsRequired")]
    unknown = sorted(set(required) - _UNDERSTOOD)
    if unknown:
        message = f"{source.name}: it requires {', '.join(unknown)}; export the scene without"
        raise Unsupported("input-gltf", message, field="extensionsRequired")
    parts = [
        moved(_gaussians(asset, placed.primitive), placed.matrix, source.name) for placed in _placed_gaussians(asset)
    ]
    return flip_axes(together(parts), LUF_TO_RDF)


def _placed_gaussians(asset: Asset) -> list[_Placed]:
    """All primitives with Gaussians, counted before any of them is read."""
    found: list[_Placed] = []
    others = total = 0
    for mesh, matrix in placed_meshes(asset):
        for primitive in asset.array(asset.entry("meshes", mesh), "primitives"):
            if not isinstance(primitive, dict):
                raise asset.source.corrupt("a primitive is not an object", field="meshes.primitives")
            if layout.EXTENSION not in asset.member(primitive, "extensions"):
                others += 1
                continue
            accessor = asset.entry("accessors", asset.member(primitive, "attributes").get(layout.POSITION))
            count = asset.natural(accessor, "count")
            total += count
            asset.source.check_count(total, file_bytes=_buffer_bytes(asset))
            found.append(_Placed(primitive, matrix, count))
    if not found:
        message = f"{asset.source.name}: no primitive of its scene has {layout.EXTENSION}; give a scene of Gaussians"
        raise InvalidInput("input-not-gaussians", message, field="meshes.primitives.extensions")
    if others:
        warnings.warn(
            f"{asset.source.name}: {others} primitives without Gaussians (meshes, lines) are left out", InputWarning,
            stacklevel=4,
        )  # fmt: skip
    return found


def _buffer_bytes(asset: Asset) -> int:
    buffers = asset.array(asset.document, "buffers")
    return sum(asset.natural(buffer, "byteLength") for buffer in buffers if isinstance(buffer, dict))


def _gaussians(asset: Asset, primitive: dict[str, Any]) -> GaussianScene:
    """The Gaussians of one primitive, in its own axes."""
    _check_terms(asset, primitive)
    attributes = asset.member(primitive, "attributes")

    def read(name: str, kind: str, allowed: frozenset[int]) -> NDArray[Any]:
        if name not in attributes:
            raise asset.source.corrupt("a primitive of Gaussians lacks this attribute", field=name)
        return asset.numbers(attributes[name], kind, allowed, name)

    positions = read(layout.POSITION, "VEC3", _POSITIONS)
    scales = read(layout.SCALE, "VEC3", _UNSIGNED)
    rotations = read(layout.ROTATION, "VEC4", _ROTATIONS)
    opacity = read(layout.OPACITY, "SCALAR", _UNSIGNED)
    floats = frozenset({layout.FLOAT})
    coefficients = [read(name, "VEC3", floats) for name in _harmonics(asset, attributes)]
    if any(len(values) != len(positions) for values in (scales, rotations, opacity, *coefficients)):
        raise asset.source.corrupt("the attributes of a primitive have different counts", field="meshes.primitives")
    if (scales < 0).any():
        raise asset.source.corrupt("a scale is below 0", field=layout.SCALE)
    if ((opacity < 0) | (opacity > 1)).any():
        raise asset.source.corrupt("an opacity is not within 0 to 1", field=layout.OPACITY)
    return GaussianScene(
        positions.astype(np.float64),
        np.log(np.maximum(scales.astype(np.float64), _HALF_TINIEST)).astype(np.float32),
        rotations[:, [3, 0, 1, 2]].astype(np.float32),
        _logits(opacity[:, 0], asset.entry("accessors", attributes[layout.OPACITY])["componentType"]),
        np.stack(coefficients, axis=1).astype(np.float32, copy=False),
    )


def _check_terms(asset: Asset, primitive: dict[str, Any]) -> None:
    """Refuse what would look different from what the extension's first version defines."""
    name = asset.source.name
    terms = asset.member(asset.member(primitive, "extensions"), layout.EXTENSION)
    if primitive.get("mode") != layout.POINTS:
        raise asset.source.corrupt("Gaussians must be points (mode 0)", field="meshes.primitives.mode")
    if terms.get("kernel") != layout.KERNEL:
        message = f"{name}: kernel {str(terms.get('kernel'))[:40]!r}; this importer reads {layout.KERNEL!r}"
        raise Unsupported("input-gltf", message, field="kernel")
    if terms.get("colorSpace") != layout.SRGB:
        message = f"{name}: colour space {str(terms.get('colorSpace'))[:40]!r}; scenes here are {layout.SRGB!r}"
        raise Unsupported("input-gltf", message, field="colorSpace")
    for field, default in (("projection", layout.PROJECTION), ("sortingMethod", layout.SORTING)):
        if terms.get(field, default) != default:
            text = f"{name}: {field} {str(terms[field])[:40]!r} is taken for {default!r}"
            warnings.warn(text, InputWarning, stacklevel=5)


def _harmonics(asset: Asset, attributes: dict[str, Any]) -> list[str]:
    """Names of the attributes of all degrees there are, in order."""
    names: list[str] = layout.harmonics(0)
    missing = ""
    for degree in (1, 2, 3):
        band = layout.harmonics(degree)
        there = [name for name in band if name in attributes]
        if there and (missing or len(there) < len(band)):
            lacking = missing or next(name for name in band if name not in attributes)
            raise asset.source.corrupt(f"{lacking} is missing below {there[-1]}", field=lacking)
        missing = missing or ("" if there else band[0])
        names += there
    return names


def _logits(opacity: NDArray[Any], component: int) -> F32:
    above, below = _OPACITY_ENDS[component]
    values = np.clip(opacity.astype(np.float64), above, 1 - below)
    logits: F32 = (np.log(values) - np.log1p(-values)).astype(np.float32)
    return logits
