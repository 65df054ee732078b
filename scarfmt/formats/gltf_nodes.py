"""The nodes of a glTF scene: where they put its meshes, and how they move, turn and scale Gaussians."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from scarfmt.arrays import F64
from scarfmt.errors import Unsupported
from scarfmt.formats.gltf_buffers import Asset
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.placement import TOLERANCE, Placement
from scarfmt.scene.rotation import matrix_from_quaternion, quaternion_from_matrix


def placed_meshes(asset: Asset) -> Iterator[tuple[int, F64]]:
    """Index of each mesh of the default scene, and the (4, 4) matrix from its axes to those of the scene.

    Raises:
        InvalidInput: damaged, or a node is in the tree twice.
    """
    waiting = [(node, np.eye(4)) for node in reversed(_roots(asset))]
    seen: set[int] = set()
    while waiting:
        index, above = waiting.pop()
        node = asset.entry("nodes", index)
        if index in seen:
            raise asset.source.corrupt(f"node {index} is in the tree twice", field="nodes.children")
        seen.add(index)
        matrix = above @ _local(asset, node)
        if "mesh" in node:
            yield asset.natural(node, "mesh"), matrix
        waiting.extend((child, matrix) for child in reversed(asset.array(node, "children")))


def _roots(asset: Asset) -> list[Any]:
    """Nodes of the default scene; of an asset without scenes, all that are no children."""
    if asset.array(asset.document, "scenes"):
        return asset.array(asset.entry("scenes", asset.document.get("scene", 0)), "nodes")
    nodes = asset.array(asset.document, "nodes")
    children = {
        child
        for node in nodes
        if isinstance(node, dict)
        for child in asset.array(node, "children")
        if type(child) is int
    }
    return [index for index in range(len(nodes)) if index not in children]


def _local(asset: Asset, node: dict[str, Any]) -> F64:
    if "matrix" in node:
        return _vector(asset, node, "matrix", np.eye(4).ravel()).reshape(4, 4).T
    x, y, z, w = _vector(asset, node, "rotation", np.array([0.0, 0, 0, 1]))
    matrix = np.eye(4)
    scale = _vector(asset, node, "scale", np.ones(3))
    matrix[:3, :3] = matrix_from_quaternion(np.array([[w, x, y, z]]))[0] * scale
    matrix[:3, 3] = _vector(asset, node, "translation", np.zeros(3))
    return matrix


def _vector(asset: Asset, node: dict[str, Any], field: str, default: F64) -> F64:
    numbers = node.get(field)
    if numbers is None:
        return default
    right = isinstance(numbers, list) and len(numbers) == len(default)
    if right and all(type(number) in (int, float) and abs(number) < 1e30 for number in numbers):
        return np.array(numbers, np.float64)
    raise asset.source.corrupt(f"expected {len(default)} numbers", field=f"nodes.{field}")


def moved(scene: GaussianScene, matrix: F64, name: str) -> GaussianScene:
    """The scene where a node puts it: means, covariances and colours.

    Args:
        scene: in the axes of its mesh.
        matrix: (4, 4), made of a translation, a rotation and a scale of each axis.
        name: of the file, for messages.

    Raises:
        Unsupported: ``input-gltf``: the matrix is made of something else, for which glTF defines no picture.
    """
    if np.array_equal(matrix, np.eye(4)):
        return scene
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    uniform = bool(np.ptp(lengths) <= TOLERANCE * lengths.max())
    rest = matrix.copy()
    try:
        if not uniform:
            rest[:3, :3] /= np.where(lengths > 0, lengths, 1.0)
        placement = Placement.of(rest.tolist())
    except (ValueError, np.linalg.LinAlgError) as error:
        message = f"{name}: a node mirrors, shears or flattens its Gaussians ({error}); glTF defines no picture of that"
        raise Unsupported("input-gltf", message, field="nodes") from error
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is not finite, which a later check reports
        return placement.scene(scene if uniform else _stretched(scene, lengths))


def _stretched(scene: GaussianScene, lengths: F64) -> GaussianScene:
    """The scene scaled along each axis: ellipsoids become other ellipsoids, colours stay."""
    log_scales = scene.log_scales.astype(np.float64)
    # As matrices of moderate size, so that neither tiny nor huge ellipsoids leave the range of float64.
    largest = log_scales.max(axis=1, keepdims=True)
    sides = matrix_from_quaternion(scene.rotations) * np.exp(log_scales - largest)[:, None, :]
    axes, stretched, _ = np.linalg.svd(lengths[:, None] * sides)
    axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]
    with np.errstate(divide="ignore"):
        grown = (np.log(stretched) + largest).astype(np.float32)
    quaternions = quaternion_from_matrix(axes).astype(np.float32)
    return GaussianScene(scene.positions * lengths, grown, quaternions, scene.opacity_logits, scene.sh)
