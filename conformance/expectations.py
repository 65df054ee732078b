"""What a decoder must get from a file, computed from the scene it was written from, not by decoding it.

Integers are the scene's own. Positions, values and latents follow SPEC §9.1-9.2, one number at a time in Python
floats, which are binary64; `numpy.float32` rounds to binary32.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.container import Tile
from scarfmt.schema import Profile, Stream
from scarfmt.tile import TileContent
from scarfmt.writer import QuantisedScene, keep_layers

Arrays = dict[str, NDArray[Any]]


def pinned(arrays: Arrays) -> dict[str, dict[str, Any]]:
    """Type, shape and SHA-256 of the C-order little-endian bytes of each array."""
    return {
        name: {
            "dtype": array.dtype.str,
            "shape": list(array.shape),
            "sha256": hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest(),
        }
        for name, array in sorted(arrays.items())
    }


def expected_layers(scene: QuantisedScene) -> list[Arrays]:
    """The arrays of a decode to each layer."""
    return [expected(keep_layers(scene, layer)) for layer in range(1, len(scene.model.layers) + 1)]


def expected(scene: QuantisedScene) -> Arrays:
    """The arrays of a decode of the whole scene, anchors in normative order (SPEC §6.3)."""
    parts = [_tile_arrays(scene, number) for number in range(len(scene.tiles))]
    if not parts:
        parts = [_arrays(scene, 0, Tile(0, 0, 0), TileContent.empty(scene.model))]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _tile_arrays(scene: QuantisedScene, number: int) -> Arrays:
    return _arrays(scene, number, scene.tiles[number], scene.contents[number])


def _arrays(scene: QuantisedScene, number: int, tile: Tile, content: TileContent) -> Arrays:
    out: Arrays = {
        "tile": np.full(len(content), number, "<u4"),
        "code": content.codes.astype("<u8"),
        "class": content.classes.astype("u1"),
        "index": content.indices.astype("<u2"),
        "position": _positions(scene, tile, content),
    }
    if scene.fields.profile == Profile.ANCHOR:
        out["slot_layer"] = content.slot_layers.astype("u1")
    for index, channel in enumerate(scene.model.channels):
        out[f"v.{channel.stream.name}"] = content.values[index].astype("<i4")
        if channel.stream != Stream.POSITION_RESIDUAL:
            out[f"value.{channel.stream.name}"] = _values(scene, index, content)
    latent = _latents(scene, content, out)
    if latent is not None:
        out["latent"] = latent
    return out


def _width(step: float, n: int) -> float:
    return step / float(3 ** (n - 1)) if n else 0.0


def _steps(scene: QuantisedScene, index: int, content: TileContent) -> list[int]:
    row = scene.model.layers[-1]
    return [row.steps[c][index] for c in content.classes.tolist()]


def _values(scene: QuantisedScene, index: int, content: TileContent) -> NDArray[np.float32]:
    channel, values = scene.model.channels[index], content.values[index]
    out = np.zeros(values.shape, "<f4")
    columns = int(np.prod(values.shape[1:]))
    flat, source = out.reshape(len(values), columns), values.reshape(len(values), columns)
    steps = _steps(scene, index, content)
    if channel.stream == Stream.OFFSETS:
        steps = [1] * len(values)
    with np.errstate(over="ignore", under="ignore"):
        for anchor, n in enumerate(steps):
            for column in range(columns):
                width = _width(channel.step[column % channel.components], n)
                flat[anchor, column] = np.float32(float(source[anchor, column]) * width)
    return out


def _coordinates(code: int) -> list[int]:
    return [sum((code >> (3 * bit + axis) & 1) << bit for bit in range(21)) for axis in range(3)]


def _positions(scene: QuantisedScene, tile: Tile, content: TileContent) -> NDArray[np.float64]:
    fields, channels = scene.fields, scene.model.channels
    corner = [c << (fields.lattice_bits - tile.depth) for c in _coordinates(tile.prefix)]
    residual = next((i for i, c in enumerate(channels) if c.stream == Stream.POSITION_RESIDUAL), None)
    steps = None if residual is None else _steps(scene, residual, content)
    cell = float(1 << tile.shift)
    out = np.zeros((len(content), 3), "<f8")
    for anchor, code in enumerate(content.codes.tolist()):
        local = _coordinates(code)
        for axis in range(3):
            at = (float(corner[axis]) + float(local[axis]) * cell) + cell / 2.0
            if residual is not None and steps is not None:
                width = _width(channels[residual].step[axis], steps[anchor])
                at = at + cell * (float(content.values[residual][anchor, axis]) * width)
            out[anchor, axis] = fields.origin[axis] + fields.voxel * at
    return out


def _latents(scene: QuantisedScene, content: TileContent, arrays: Arrays) -> NDArray[np.float32] | None:
    refined = arrays.get("value.LATENT")
    row = scene.model.layers[-1]
    latent = next((i for i, c in enumerate(scene.model.channels) if c.stream == Stream.LATENT), None)
    used = any(row.stages) or (latent is not None and any(steps[latent] for steps in row.steps))
    if scene.decoder is None or not used:
        return None
    total = np.zeros((len(content), scene.decoder.inputs), np.int64)
    for anchor, c in enumerate(content.classes.tolist()):
        for stage in range(row.stages[c]):
            assert scene.codebooks is not None
            book = scene.codebooks.residual if stage else scene.codebooks.coarse
            total[anchor] += book[content.indices[anchor, stage]]
    z = total.astype("<f4")
    return z if refined is None else (z + refined).astype("<f4")
