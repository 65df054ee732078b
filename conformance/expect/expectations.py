"""The values that a decoder must get from a file, computed from the scene it was written from, not by decoding it.

Integers and models are the scene's own. Sums, positions, values and latents follow SPEC §9.1-9.2, one number at a time
in Python floats, which are binary64; `numpy.float32` rounds to binary32. Features of hash grids are those of
:mod:`conformance.decoders.python.hash_grid`, of the bits the scene has.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from conformance.decoders.python.hash_grid import Grid, Level
from scarfmt.blocks.streaming import Streaming
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import Profile, Stream

Arrays = dict[str, NDArray[Any]]


def expected_layers(scene: QuantisedScene) -> list[Arrays]:
    """The arrays of a decode to each layer, by their names in PROTOCOL.md."""
    return [expected(_at_layer(scene, layer)) for layer in range(1, len(scene.model.layers) + 1)]


def expected(scene: QuantisedScene) -> Arrays:
    """The arrays of a decode of the whole scene, anchors in normative order (SPEC §6.3).

    Those of what the coding of symbols went through, ``frequencies.*``, ``embedding`` and ``context.*``, are not among
    them: they need the tables that the file has.
    """
    parts = [_tile_arrays(scene, number) for number in range(len(scene.tiles))]
    if not parts:
        parts = [_arrays(scene, 0, Tile(0, 0, 0), TileContent.empty(scene.model))]
    anchors = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return {**anchors, **_models(scene)}


def _at_layer(scene: QuantisedScene, layer: int) -> QuantisedScene:
    """The scene with what its first layers bring; models as they are."""
    model = replace(scene.model, layers=scene.model.layers[:layer])
    contents = tuple(_content_at(scene, layer, content) for content in scene.contents)
    return replace(scene, model=model, contents=contents)


def _content_at(scene: QuantisedScene, layer: int, content: TileContent) -> TileContent:
    now, last = scene.model.layers[layer - 1], scene.model.layers[-1]
    kept = content.classes < len(now.stages)
    classes = content.classes[kept]
    slot_layers = np.where(content.slot_layers[kept] <= layer, content.slot_layers[kept], 0)
    values = []
    for index, channel in enumerate(scene.model.channels):
        v = content.values[index][kept].astype(np.int64)
        if channel.stream == Stream.OFFSETS:
            v = v * (slot_layers > 0)[:, :, None]
        else:
            here = np.array([now.steps[c][index] for c in classes], np.int64)
            missing = np.array([last.steps[c][index] for c in classes], np.int64) - here
            v = _coarser(v, missing) * (here > 0)[:, None]
        values.append(v.astype(np.int32))
    received = np.array([now.stages[c] for c in classes], np.int64)
    most = max(now.stages)
    indices = content.indices[kept][:, :most] * (np.arange(most) < received[:, None])
    return TileContent(content.codes[kept], classes, values, indices, slot_layers)


def _coarser(v: NDArray[np.int64], steps: NDArray[np.int64]) -> NDArray[np.int64]:
    """v before the last so many steps of each anchor: the u of v = 3 u + t, t in {-1, 0, 1}, time and again."""
    for done in range(int(steps.max(initial=0))):
        v = np.where((steps > done)[:, None], (v + 1) // 3, v)
    return v


def expected_metadata(scene: QuantisedScene) -> Any:
    """The object of the METADATA block; None without one."""
    return json.loads(json.dumps(dict(scene.metadata))) if scene.metadata else None


def expected_streaming(told: Streaming) -> dict[str, Any]:
    """The expected STREAMING values, in the form of PROTOCOL.md."""
    view = told.view
    numbers = [] if view is None else [*view.position, *view.target, *view.up, view.fov]
    return {
        "view": _bits(numbers) or None,
        "low": told.low.tolist(),
        "high": told.high.tolist(),
        "reach": told.reach.tolist(),
    }


def _bits(numbers: Sequence[float]) -> list[str]:
    """The bits of numbers rounded to f32, most significant first."""
    return [np.array([number], ">f4").tobytes().hex() for number in numbers]


def _models(scene: QuantisedScene) -> Arrays:
    out: Arrays = {}
    most = max(scene.model.layers[-1].stages)
    if scene.codebooks is not None:
        # Book 0 arrives with the first stage, book 1 with the second (SPEC §7.8).
        books = (scene.codebooks.coarse, scene.codebooks.residual)[:most]
        out = {f"codebook.{b}": book.astype("<i4") for b, book in enumerate(books)}
    if scene.grid is not None and _grid(scene) is not None:
        out |= {f"grid.bits.{number}": bits.astype("u1") for number, bits in enumerate(scene.grid.bits)}
    return out


def _grid(scene: QuantisedScene) -> Grid | None:
    """The hash grid, if a layer has needed it (SPEC §10.4)."""
    if scene.grid is None or not any(row.neural for row in scene.model.layers):
        return None
    levels = [
        (Level(level.axes, level.resolution, level.table_log2, level.features), bits.ravel().tolist())
        for level, bits in zip(scene.grid.levels, scene.grid.bits, strict=True)
    ]
    return Grid(list(scene.grid.origin), scene.grid.extent_bits, levels)


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
    grid = _grid(scene)
    if grid is not None:
        places = _middles(scene, tile, content)
        width = sum(level.features for level, _ in grid.levels)
        out["grid.features"] = np.array([grid.features(place) for place in places], "<i4").reshape(-1, width)
    sums = _codeword_sums(scene, content)
    if sums is not None:
        out["codeword_sum"] = sums.astype("<i4")
        out["latent"] = _latents(sums, out.get("value.LATENT"))
    return out


def _width(first: float, n: int) -> float:
    return first / float(3 ** (n - 1)) if n else 0.0


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
                width = _width(channel.first_width[column % channel.components], n)
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
                width = _width(channels[residual].first_width[axis], steps[anchor])
                at = at + cell * (float(content.values[residual][anchor, axis]) * width)
            out[anchor, axis] = fields.origin[axis] + fields.voxel * at
    return out


def _middles(scene: QuantisedScene, tile: Tile, content: TileContent) -> list[list[int]]:
    """Lattice points in the middle of the anchors' cells (SPEC §10.6)."""
    corner = [c << (scene.fields.lattice_bits - tile.depth) for c in _coordinates(tile.prefix)]
    half = 1 << tile.shift >> 1
    places = (zip(corner, _coordinates(code), strict=True) for code in content.codes.tolist())
    return [[c + (local << tile.shift) + half for c, local in place] for place in places]


def _codeword_sums(scene: QuantisedScene, content: TileContent) -> NDArray[np.int64] | None:
    """S of SPEC §9.2; None where no layer holds a DECODER_MLP (SPEC §7.9)."""
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
    return total


def _latents(sums: NDArray[np.int64], refined: NDArray[np.float32] | None) -> NDArray[np.float32]:
    z = sums.astype("<f4")
    return z if refined is None else (z + refined).astype("<f4")
