"""Values in files of work directories and checkpoints: a digest, JSON for how they nest, and the bytes of arrays.

Nothing is run by reading one: a record is of one of `_RECORDS`, made of its fields.

    8 bytes  mark             8 bytes   length of the JSON
    32       SHA-256 of what  ...       JSON; then payloads, each at a multiple of 16 bytes
             follows

In the JSON a list is a list. An object has one member, whose name is the kind of value: `(` tuple, `{` dictionary, of
pairs, `[` array (dtype, shape, offset), `b` bytes (offset, length), or the class of a record, number or dictionary.
"""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from enum import IntEnum
from typing import Any

import numpy as np

_MARK = b"scarwrk1"
_DIGEST, _LENGTH, _ALIGNMENT = 32, 8, 16
_NUMBERS = "biuf"
_HERE = "reference_encoder.out_of_core"
_MODULES = {
    "reference_encoder.importance.view_sampling": "ViewSet Views",
    "reference_encoder.importance.weights": "Weights",
    "reference_encoder.options": "EncodeOptions",
    f"{_HERE}.fit": "Fit LatentFit",
    f"{_HERE}.judge": "Pictures",
    f"{_HERE}.overview": "Overview",
    f"{_HERE}.scan": "Scanned",
    f"{_HERE}.tasks": "Scene",
    f"{_HERE}.types": "Bounds Histograms Models Range Rows",
    "reference_encoder.rdo.classes": "ClassBounds",
    "reference_encoder.rdo.lattice": "RootCube",
    "reference_encoder.training.index_entropy": "Lesson",
    "reference_encoder.training.networks.dataset": "IndexRows",
    "reference_encoder.training.networks.layers": "NetworkShape",
    "reference_encoder.training.vq_features": "Coordinates",
    "scarfmt.blocks.mlp": "Linear QuantisedMlp",
    "scarfmt.coding.writer": "RecordedTile",
    "scarfmt.container.directory": "Tile",
    "scarfmt.container.file": "Block",
    "scarfmt.container.header": "HeaderFields",
    "scarfmt.container.registries": "BlockFlag BlockKind ColourSpace CoordinateFrame Profile RenderModel Stream",
    "scarfmt.entropy.keys": "StepKey TableKey",
    "scarfmt.entropy.recorded": "RecordedSymbols",
    "scarfmt.entropy.symbol_tables": "StaticTables SymbolTable",
    "scarfmt.render.camera": "Camera",
    "scarfmt.render.viewpoints": "Upright",
    "scarfmt.scene.description": "Description",
    "scarfmt.scene.gaussians": "GaussianScene",
    "scarfmt.scene.model": "Channel Codebooks DecodedContext LayerRow SceneModel",
}
_RECORDS = {name: module for module, names in _MODULES.items() for name in names.split()}
"""The module of each class that a file may name."""


def pack(value: Any) -> list[bytes | memoryview]:
    """The pieces of the file of a value.

    Raises:
        TypeError: it holds something of another kind.
    """
    payloads: list[bytes | memoryview] = []
    offset = 0

    def place(data: bytes | memoryview) -> int:
        nonlocal offset
        at, fill = offset, -len(data) % _ALIGNMENT
        payloads.extend((data, bytes(fill)))
        offset += len(data) + fill
        return at

    text = json.dumps(_pack_part(value, place)).encode()
    text += b" " * (-(len(_MARK) + _DIGEST + _LENGTH + len(text)) % _ALIGNMENT)
    content = [len(text).to_bytes(_LENGTH, "little"), text, *payloads]
    digest = hashlib.sha256()
    for piece in content:
        digest.update(piece)
    return [_MARK, digest.digest(), *content]


def _pack_part(value: Any, place: Callable[[bytes | memoryview], int]) -> Any:
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is list:
        return [_pack_part(part, place) for part in value]
    if kind is bytes:
        return {"b": [place(value), len(value)]}
    if kind is np.ndarray and value.dtype.kind in _NUMBERS:
        array = np.ascontiguousarray(value)
        return {"[": [array.dtype.str, list(value.shape), place(array.reshape(-1).view(np.uint8).data)]}
    name = "(" if kind is tuple else "{" if kind is dict else kind.__name__
    if len(name) > 1 and _RECORDS.get(name) != kind.__module__:
        raise TypeError(f"no value to keep: {kind}")
    if isinstance(value, IntEnum):
        return {name: int(value)}
    if isinstance(value, dict):
        return {name: [[_pack_part(key, place), _pack_part(part, place)] for key, part in value.items()]}
    parts = [getattr(value, field.name) for field in fields(value)] if is_dataclass(value) else value
    return {name: [_pack_part(part, place) for part in parts]}


def unpack(data: bytes) -> Any:
    """The value of a file; its arrays can be written to.

    Raises:
        ValueError: the file is damaged, or holds what :func:`pack` does not write.
    """
    head = len(_MARK) + _DIGEST
    content = memoryview(bytearray(data))[head:]
    if data[: len(_MARK)] != _MARK or hashlib.sha256(content).digest() != data[len(_MARK) : head]:
        raise ValueError("damaged, or of another version")
    length = int.from_bytes(content[:_LENGTH], "little")
    try:
        return _unpack_part(json.loads(bytes(content[_LENGTH : _LENGTH + length])), content[_LENGTH + length :])
    except (LookupError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise ValueError(f"not what this program writes ({error})") from error


def _unpack_part(value: Any, payloads: memoryview) -> Any:
    if isinstance(value, list):
        return [_unpack_part(part, payloads) for part in value]
    if not isinstance(value, dict):
        return value
    [(name, parts)] = value.items()
    if name == "[":
        dtype, shape, offset = np.dtype(parts[0]), tuple(parts[1]), parts[2]
        if dtype.kind not in _NUMBERS:
            raise TypeError(f"an array of {dtype}")
        return np.ndarray(shape, dtype, payloads, offset)
    if name == "b":
        offset, length = parts
        return bytes(payloads[offset : offset + length])
    kind: Any = {"(": tuple, "{": dict}.get(name) or getattr(importlib.import_module(_RECORDS[name]), name)
    if issubclass(kind, IntEnum):
        return kind(parts)
    if issubclass(kind, dict):
        return kind((_unpack_part(key, payloads), _unpack_part(part, payloads)) for key, part in parts)
    made = [_unpack_part(part, payloads) for part in parts]
    if hasattr(kind, "__dataclass_fields__"):
        return kind(**dict(zip((field.name for field in fields(kind)), made, strict=True)))
    return tuple(made) if kind is tuple else kind(*made)
