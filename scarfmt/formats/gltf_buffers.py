"""The document of a glTF asset and the numbers of its accessors, none of which is trusted."""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Collection
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from scarfmt.errors import LimitExceeded, Unsupported
from scarfmt.formats import gltf_layout as layout
from scarfmt.formats.source import Source

MAX_JSON_BYTES = 1 << 28
_DATA = ("data:application/octet-stream;base64,", "data:application/gltf-buffer;base64,")
_LARGEST = {layout.BYTE: 127.0, layout.UBYTE: 255.0, layout.SHORT: 32767.0, layout.USHORT: 65535.0}


class Asset:
    """A .glb or .gltf, its JSON parsed and its buffers read when they are needed.

    Args:
        source: the file.

    Raises:
        InvalidInput: damaged.
        Unsupported: another version of glTF, or of its container.
        LimitExceeded: more JSON than any scene has.
    """

    def __init__(self, source: Source):
        self.source = source
        text, self._binary = _glb_chunks(source) if source.head(4) == layout.GLB_MAGIC else (_whole(source), None)
        try:
            document = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise source.corrupt(f"the JSON of the glTF is damaged ({str(error)[:100]})") from error
        if not isinstance(document, dict):
            raise source.corrupt("the JSON of the glTF is not an object")
        self.document: dict[str, Any] = document
        self._buffers: dict[int, bytes | memoryview] = {}
        version = self.member(document, "asset").get("version")
        if not isinstance(version, str) or not version.startswith("2."):
            raise Unsupported("input-version", f"{source.name}: glTF {str(version)[:20]}; this importer reads 2")

    def member(self, holder: dict[str, Any], field: str) -> dict[str, Any]:
        """A member that is an object; empty where there is none."""
        value = holder.get(field, {})
        if not isinstance(value, dict):
            raise self.source.corrupt("expected a JSON object", field=field)
        return value

    def array(self, holder: dict[str, Any], field: str) -> list[Any]:
        """A member that is an array; empty where there is none."""
        value = holder.get(field, [])
        if not isinstance(value, list):
            raise self.source.corrupt("expected a JSON array", field=field)
        return value

    def natural(self, holder: dict[str, Any], field: str, default: int | None = None) -> int:
        """A member that is an integer of at least 0."""
        value = holder.get(field, default)
        if type(value) is not int or value < 0:
            raise self.source.corrupt(f"expected a number of at least 0, got {str(value)[:40]!r}", field=field)
        return value

    def entry(self, field: str, index: object) -> dict[str, Any]:
        """An object of one of the document's arrays, by its index."""
        entries = self.array(self.document, field)
        if type(index) is not int or not 0 <= index < len(entries) or not isinstance(entries[index], dict):
            raise self.source.corrupt(f"there is no object {str(index)[:40]}", field=field)
        entry: dict[str, Any] = entries[index]
        return entry

    def numbers(self, index: object, kind: str, allowed: Collection[int], name: str) -> NDArray[Any]:
        """The elements of an accessor, integers as they are or, where it is normalised, scaled to 1.

        Args:
            index: of the accessor.
            kind: SCALAR, VEC3 and so on.
            allowed: component types.
            name: of the attribute, for messages.

        Returns:
            (count, width), float32 of floats, else float64.
        """
        accessor = self.entry("accessors", index)
        component, count = self.natural(accessor, "componentType"), self.natural(accessor, "count")
        if accessor.get("type") != kind or component not in allowed:
            raise self.source.corrupt(f"{accessor.get('type')!r} of component type {component}", field=name)
        if "sparse" in accessor or "bufferView" not in accessor:
            message = f"{self.source.name}: {name} is sparse or compressed; export the scene uncompressed"
            raise Unsupported("input-gltf", message, field=name)
        element = np.dtype((layout.COMPONENTS[component], (layout.WIDTHS[kind],)))
        stored = self._elements(accessor, element, count, name)
        if component == layout.FLOAT:
            return stored
        values = stored.astype(np.float64)
        return np.maximum(values / _LARGEST[component], -1.0) if accessor.get("normalized") is True else values

    def _elements(self, accessor: dict[str, Any], element: np.dtype[Any], count: int, name: str) -> NDArray[Any]:
        view = self.entry("bufferViews", accessor["bufferView"])
        data = self._buffer(self.natural(view, "buffer"))
        start, length = self.natural(view, "byteOffset", 0), self.natural(view, "byteLength")
        offset = self.natural(accessor, "byteOffset", 0)
        stride = self.natural(view, "byteStride", element.itemsize)
        needed = offset + (count - 1) * stride + element.itemsize
        if not count or stride < element.itemsize or needed > length or start + length > len(data):
            message = f"{count} elements, {stride} bytes apart, do not fit a view of {length} bytes"
            raise self.source.corrupt(f"{message} in a buffer of {len(data)}", field=name)
        shape = (count, *element.shape)
        strides = (stride, element.base.itemsize)
        return np.ndarray(shape, element.base, buffer=data, offset=start + offset, strides=strides)

    def _buffer(self, index: int) -> bytes | memoryview:
        if index not in self._buffers:
            self._buffers[index] = self._read_buffer(index)
        return self._buffers[index]

    def _read_buffer(self, index: int) -> bytes | memoryview:
        buffer = self.entry("buffers", index)
        length, uri = self.natural(buffer, "byteLength"), buffer.get("uri")
        data: bytes | memoryview | None
        if uri is None:
            data = self._binary if index == 0 else None
        elif isinstance(uri, str) and uri.startswith("data:"):
            data = _inline(self.source, uri)
        else:
            data = self._beside(uri)
        there = 0 if data is None else len(data)
        if data is None or there < length:
            raise self.source.corrupt(f"a buffer of {length} bytes has {there}", field="buffers")
        return data

    def _beside(self, uri: object) -> bytes:
        """A buffer in a file below the directory of the asset."""
        text = unquote(uri) if isinstance(uri, str) else ""
        path = PurePosixPath(text)
        if not text or path.is_absolute() or ".." in path.parts or "\0" in text or "\\" in text or ":" in text:
            raise self.source.corrupt(f"{str(uri)[:80]!r} is no relative path of a file", field="buffers.uri")
        if self.source.path is None:
            message = f"{self.source.name}: its buffers are in files beside it; give its path, or write a .glb"
            raise Unsupported("input-gltf", message, field="buffers.uri")
        return Source(self.source.path.parent / path).read()


def _whole(source: Source) -> bytes:
    if source.size > MAX_JSON_BYTES:
        raise LimitExceeded("input-limit", f"{source.name}: a glTF of over {MAX_JSON_BYTES >> 20} MiB of JSON")
    return source.read()


def _glb_chunks(source: Source) -> tuple[bytes, memoryview | None]:
    """JSON and binary chunk of a .glb; chunks of other kinds are passed over, as glTF wants it."""
    data = memoryview(source.read())
    if len(data) < layout.GLB.size:
        raise source.corrupt("cut within the header of the .glb")
    _, version, length = layout.GLB.unpack_from(data)
    if version != layout.GLB_VERSION:
        raise Unsupported("input-version", f"{source.name}: .glb container version {version}; this importer reads 2")
    if length > len(data):
        raise source.corrupt(f"{len(data)} bytes of {length}")
    chunks: list[tuple[bytes, memoryview]] = []
    at = layout.GLB.size
    while at + layout.CHUNK.size <= length and len(chunks) < 2:
        size, kind = layout.CHUNK.unpack_from(data, at)
        at += layout.CHUNK.size
        if at + size > length:
            raise source.corrupt(f"a chunk of {size} bytes does not fit", offset=at)
        chunks.append((kind, data[at : at + size]))
        at += size
    if not chunks or chunks[0][0] != layout.JSON_CHUNK:
        raise source.corrupt("the first chunk of the .glb is not JSON", offset=layout.GLB.size)
    if len(chunks[0][1]) > MAX_JSON_BYTES:
        raise LimitExceeded("input-limit", f"{source.name}: a glTF of over {MAX_JSON_BYTES >> 20} MiB of JSON")
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == layout.BINARY_CHUNK else None
    return bytes(chunks[0][1]), binary


def _inline(source: Source, uri: str) -> bytes:
    head = next((head for head in _DATA if uri.startswith(head)), None)
    if head is None:
        raise source.corrupt(f"a buffer in place must be base64, not {uri[:60]!r}", field="buffers.uri")
    try:
        return base64.b64decode(uri[len(head) :], validate=True)
    except (binascii.Error, ValueError) as error:
        raise source.corrupt(f"damaged base64 ({error})", field="buffers.uri") from error
