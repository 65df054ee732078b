"""The stages of one decode as the conformance protocol names them: arrays and fields, not yet JSON.

conformance/PROTOCOL.md says what each holds; its table is the order of the functions here.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_decoder.anchors import log_sigmoid, outlook, run, sigmoid, slot_centres, unit_quaternions
from reference_decoder.decode import DecodeRequest, decode
from reference_decoder.decoded import Decoded, empty_anchors
from scarfmt.arrays import F64
from scarfmt.blocks.streaming import Streaming
from scarfmt.coding.models import SceneModels
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.container.directory import tile_frame
from scarfmt.container.file import Container
from scarfmt.container.schema import (
    CHECKSUM_SIZE,
    FILE_HEADER,
    FILE_HEADER_SIZE,
    HEADER_CHECKSUM,
    LAYER_SUMMARY,
    LAYER_SUMMARY_SIZE,
    field_table,
)
from scarfmt.neural.layer_context import cell_centres
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt_conformance.reference.observed import Records

Arrays = dict[str, NDArray[Any]]
"""Arrays of the protocol's types, in the byte order of the machine. They become little-endian in the answer."""


@dataclass(frozen=True)
class Decoding:
    """A file decoded to a layer.

    Attributes:
        reader: of the file.
        models: of its first layers.
        contents: every tile's integers.
        records: what was computed in the last of the layers.
    """

    reader: SceneReader
    models: SceneModels
    contents: list[TileContent]
    records: Records

    @cached_property
    def decoded(self) -> Decoded:
        """The values of all anchors."""
        model, count = self.models.model, sum(map(len, self.contents))
        channels = [(channel.stream, channel.components) for channel in model.channels]
        fields, layers = self.reader.header.fields, len(model.layers)
        out, first = empty_anchors(fields, layers, lambda: self.models, channels, model.max_stages, count), 0
        for number, content in enumerate(self.contents):
            rows = slice(first, first := first + len(content))
            out.rows(rows).put_content(self.reader, model, number, content)
        return out


def streaming(told: Streaming | None) -> dict[str, Any] | None:
    """The STREAMING values; numbers of binary32 as 8 hexadecimal digits."""
    if told is None:
        return None
    view = told.view
    numbers = np.zeros(0) if view is None else np.array([*view.position, *view.target, *view.up, view.fov])
    return {
        "view": [f"{bits:08x}" for bits in numbers.astype(np.float32).view(np.uint32).tolist()] or None,
        "low": told.low.tolist(),
        "high": told.high.tolist(),
        "reach": told.reach.tolist(),
    }


def decoding(reader: SceneReader, models: SceneModels) -> Decoding:
    """Decode all tiles to the layer that `models`, of the file, fix.

    Raises:
        Malformed, Truncated, Unsupported, LimitExceeded: the file is refused (SPEC §12).
    """
    records = Records(len(models.model.layers))
    found = reader.tiles(models, observe=records.observe)
    return Decoding(reader, models, [content for _, content in found], records)


def check_native(found: Decoding) -> None:
    """Check that the C library gives the same exact values.

    Raises:
        AssertionError: it gives others.
    """
    container = found.reader.container
    request = DecodeRequest(layers=len(found.models.model.layers), limits=container.limits, allow_truncated=True)
    native = decode(container.source, request)
    pairs = zip(native.arrays(), found.decoded.arrays(), strict=True)
    if not all(np.array_equal(one, other, equal_nan=one.dtype.kind == "f") for one, other in pairs):
        raise AssertionError("the C library decodes other values")


def container(source: Container) -> dict[str, Any]:
    """Every field of the tables of SPEC §5, as text."""
    size = source.header.header_length
    data = source.source.read(0, size)
    starts = range(FILE_HEADER_SIZE, size - CHECKSUM_SIZE, LAYER_SUMMARY_SIZE)
    tail = _fields(HEADER_CHECKSUM, data[size - CHECKSUM_SIZE :])
    return {
        "header": {**_fields(FILE_HEADER, data), **tail},
        "layers": [_fields(LAYER_SUMMARY, data[start:]) for start in starts],
        "tiles": _rows(source.tile_table),
        "entries": _rows(source.directory),
    }


def _fields(structure: Any, data: bytes) -> dict[str, Any]:
    values = structure.parse(data)
    return {field.name: _text(values[field.name]) for field in field_table(structure)}


def _rows(table: NDArray[np.void]) -> list[dict[str, str]]:
    names = table.dtype.names or ()
    return [dict(zip(names, map(str, row), strict=True)) for row in table.tolist()]


def _text(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, float):
        return struct.pack(">d", value).hex()
    return str(value) if isinstance(value, int) else [_text(part) for part in value]


def models(found: SceneModels) -> Arrays:
    """Codebooks and the bits of the hash grid."""
    out: Arrays = {}
    if found.codebooks is not None:
        books = enumerate((found.codebooks.coarse, found.codebooks.residual))
        out = {f"codebook.{number}": words.astype("i4") for number, words in books if len(words)}
    if found.grid is not None:
        out |= {f"grid.bits.{level}": bits.astype("u1") for level, bits in enumerate(found.grid.bits)}
    return out


def context(found: Decoding) -> Arrays:
    """Grid features of every anchor; embeddings and predictor contexts of the last layer."""
    grid, out = found.models.grid, found.records.contexts()
    if grid is not None:
        fields = found.reader.header.fields
        places = zip(found.reader.container.tiles, found.contents, strict=True)
        filled = ((tile_frame(fields, tile), content.codes) for tile, content in places if len(content))
        parts = [grid.features(cell_centres(frame, codes)) for frame, codes in filled]
        out["grid.features"] = _stack(parts, (grid.width,), "i4")
    return out


def frequencies(found: Decoding) -> Arrays:
    """The first table of each sub-stream and stage of the last layer."""
    return found.records.frequencies()


def indices(found: Decoding) -> Arrays:
    """Codeword numbers."""
    width = found.models.model.max_stages
    return {"index": _stack([content.indices for content in found.contents], (width,), "u2")}


def integers(found: Decoding) -> Arrays:
    """Tiles, codes, classes, masks and channel values."""
    model, contents = found.models.model, found.contents
    empty = TileContent.empty(model)
    sizes = [len(content) for content in contents]
    out: Arrays = {
        "tile": np.repeat(np.arange(len(contents), dtype="u4"), sizes),
        "code": _stack([content.codes for content in contents], (), "u8"),
        "class": _stack([content.classes for content in contents], (), "u1"),
    }
    if empty.slot_layers.shape[1]:
        slots = [content.slot_layers for content in contents]
        out["slot_layer"] = _stack(slots, empty.slot_layers.shape[1:], "u1")
    for index, channel in enumerate(model.channels):
        values = [content.values[index] for content in contents]
        out[f"v.{channel.stream.name}"] = _stack(values, empty.values[index].shape[1:], "i4")
    return out


def sums(found: Decoding) -> Arrays:
    """Sums of codewords."""
    decoded, decoder, books = found.decoded, found.models.decoder, found.models.codebooks
    if decoder is None:
        return {}
    total = np.zeros((len(decoded), decoder.inputs), "i4")
    if books is not None and decoded.indices is not None:
        total[:] = books.latents(decoded.indices, decoded.stages)
    return {"codeword_sum": total}


def values(found: Decoding) -> Arrays:
    """Positions, channel values and latents."""
    decoded = found.decoded
    assert decoded.positions is not None  # all attributes are decoded
    out: Arrays = {"position": decoded.positions.astype("f8")}
    out |= {f"value.{stream.name}": array.astype("f4") for stream, array in decoded.values.items()}
    if found.models.decoder is not None:
        out["latent"] = decoded.latents.astype("f4")
    return out


def activated_arrays(decoded: Decoded, dtype: type, camera: Sequence[float] | None = None) -> Arrays:
    """The values of SPEC §9.3 to §9.6.

    Args:
        decoded: with all attributes.
        dtype: float32, what a decode gives; float64, the reference of the tolerances, and free of overflow
            where only float32 is too narrow.
        camera: centre of the camera, world units, for Gaussians of the anchor profile; None: `origin` of the header.
    """
    scene = decoded.activate(dtype)
    if isinstance(scene, GaussianScene):
        return _gaussians(scene)
    return {"feature": scene.features, **_slots(scene, np.array(camera or decoded.fields.origin), dtype)}


def _gaussians(scene: GaussianScene) -> Arrays:
    logits = scene.opacity_logits
    return {"rotation": scene.rotations, "logit": logits, "opacity": sigmoid(logits), "sh": scene.sh}


def _slots(model: AnchorModel, camera_centre: F64, dtype: type) -> Arrays:
    """Every slot of every anchor, on or off, for a camera (SPEC §9.6)."""
    count, slots = len(model), model.slots
    anchors, numbers = np.divmod(np.arange(count * slots), slots)
    with np.errstate(all="ignore"):  # what overflows is an infinity, or not a number: not a reason to warn
        inputs = outlook(model, np.arange(count), camera_centre, dtype)
        covariance = run(model.mlps["cov"], inputs).reshape(count, slots, 7)
        log_scales = model.log_scaling[:, None, 3:6].astype(dtype) + log_sigmoid(covariance[:, :, :3])
        return {
            "gaussian.opacity": np.tanh(run(model.mlps["opacity"], inputs)),
            "gaussian.scale": np.exp(log_scales),
            "gaussian.rotation": unit_quaternions(covariance[:, :, 3:].reshape(-1, 4)).reshape(count, slots, 4),
            "gaussian.colour": sigmoid(run(model.mlps["color"], inputs)).reshape(count, slots, 3),
            "gaussian.centre": slot_centres(model, anchors, numbers).reshape(count, slots, 3),
        }


EXACT: dict[str, Callable[[Decoding], Arrays]] = {
    stage.__name__: stage for stage in (context, frequencies, indices, integers, sums, values)
}
"""Exact stages that need a decode of the tiles."""


def _stack(parts: list[NDArray[Any]], row: tuple[int, ...], dtype: str) -> NDArray[Any]:
    """The rows of all tiles, of shape `row` each; none where there is no tile."""
    return np.concatenate([np.zeros((0, *row), dtype), *(part.astype(dtype) for part in parts)])
