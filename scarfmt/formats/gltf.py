"""Reading Gaussians of glTF 2.0 assets, .glb or .gltf, with the extension KHR_gaussian_splatting.

The extension is a release candidate (text of 2026-07-17, github.com/KhronosGroup/glTF). Gaussians are the vertices of a
primitive of points: POSITION; unit quaternions x, y, z, w; linear scales; opacities 0..1; spherical harmonics in
INRIA's sign and order, an attribute for each coefficient. Axes are those of glTF assets: x left, y up, z forward.

The draft extension KHR_gaussian_splatting_compression_spz_2 puts all attributes of a primitive into an SPZ file, which
is unpacked in the axes of glTF.

All point primitives of the default scene that have the extension make one scene, each where its nodes put it.
Attributes are floats or, where the extension has them, integers. Axes are turned to RDF, those of INRIA's PLY. No
number of the document is trusted.
"""

from __future__ import annotations

import base64
import binascii
import struct
from collections.abc import Collection, Iterator
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64
from scarfmt.blocks.metadata import check_registered
from scarfmt.container.registries import ColourSpace, RenderModel
from scarfmt.errors import InvalidInput, Malformed, Unsupported
from scarfmt.formats import spz
from scarfmt.formats.frame import LUF_TO_RDF, flip_axes
from scarfmt.formats.quantise import log_scale, logit_of_opacity
from scarfmt.formats.source import Source
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene, concatenate
from scarfmt.scene.placement import compose, place_scene

_REFERENCE = "coordinate_reference"
EXTENSION = "KHR_gaussian_splatting"
POINTS = 0
KERNEL, PROJECTION, SORTING = "ellipse", "perspective", "cameraDistance"
SRGB, LINEAR = "srgb_rec709_display", "lin_rec709_display"

POSITION, COLOUR = "POSITION", "COLOR_0"
ROTATION, SCALE, OPACITY = (f"{EXTENSION}:{name}" for name in ("ROTATION", "SCALE", "OPACITY"))

BYTE, UBYTE, SHORT, USHORT, UINT, FLOAT = 5120, 5121, 5122, 5123, 5125, 5126
COMPONENTS = {BYTE: "<i1", UBYTE: "<u1", SHORT: "<i2", USHORT: "<u2", UINT: "<u4", FLOAT: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}

GLB = struct.Struct("<4sII")
"""Magic, version, length of a .glb file."""
CHUNK = struct.Struct("<I4s")
"""Length and type of a chunk."""
GLB_MAGIC, GLB_VERSION, JSON_CHUNK, BINARY_CHUNK = b"glTF", 2, b"JSON", b"BIN\0"


def harmonic(degree: int, coefficient: int) -> str:
    """The attribute of a coefficient, 0..2 * degree."""
    return f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{coefficient}"


def harmonics(degree: int) -> list[str]:
    """The attributes of one degree, lowest order first."""
    return [harmonic(degree, coefficient) for coefficient in range(2 * degree + 1)]


_LARGEST = {BYTE: 127.0, UBYTE: 255.0, SHORT: 32767.0, USHORT: 65535.0}


class Asset:
    """A .glb or .gltf, its JSON parsed and its buffers read when they are needed.

    Raises:
        InvalidInput: damaged.
        Unsupported: another version of glTF, or of its container.
        LimitExceeded: more JSON than any scene has.
    """

    def __init__(self, source: Source):
        self.source = source
        self._binary: memoryview | None = None
        text = None
        if source.head(4) == GLB_MAGIC:
            text, self._binary = _glb_chunks(source)
        self.document = source.json(text)
        self._buffers: dict[int, bytes | memoryview] = {}
        self._files: dict[str, bytes] = {}
        version = self.source.member(self.document, "asset").get("version")
        if not isinstance(version, str) or not version.startswith("2."):
            raise Unsupported("input-version", f"{source.name}: glTF {str(version)[:20]}; this importer reads 2")

    def entry(self, field: str, index: object) -> dict[str, Any]:
        """An object of one of the document's arrays, by its index."""
        entries = self.source.array(self.document, field)
        if type(index) is not int or not 0 <= index < len(entries) or not isinstance(entries[index], dict):
            raise self.source.corrupt(f"there is no object {str(index)[:40]}", field=field)
        entry: dict[str, Any] = entries[index]
        return entry

    def numbers(self, index: object, kind: str, allowed: Collection[int], name: str) -> NDArray[Any]:
        """The elements of an accessor, integers as they are or, where it is normalised, scaled to 1.

        Args:
            kind: SCALAR, VEC3 and so on.
            allowed: component types.
            name: of the attribute, for messages.

        Returns:
            (count, width), float32 of floats, else float64.
        """
        accessor = self.entry("accessors", index)
        component, count = self.source.natural(accessor, "componentType"), self.source.natural(accessor, "count")
        if accessor.get("type") != kind or component not in allowed:
            raise self.source.corrupt(f"{accessor.get('type')!r} of component type {component}", field=name)
        if "sparse" in accessor or "bufferView" not in accessor:
            message = f"{self.source.name}: {name} is sparse or compressed; export the scene uncompressed"
            raise Unsupported("input-gltf", message, field=name)
        element = np.dtype((COMPONENTS[component], (WIDTHS[kind],)))
        stored = self._elements(accessor, element, count, name)
        if component == FLOAT:
            return stored
        values = stored.astype(np.float64)
        return np.maximum(values / _LARGEST[component], -1.0) if accessor.get("normalized") is True else values

    def view(self, index: object, name: str) -> bytes:
        """The bytes of a buffer view."""
        view = self.entry("bufferViews", index)
        data = self._buffer(self.source.natural(view, "buffer"))
        start, length = self.source.natural(view, "byteOffset", 0), self.source.natural(view, "byteLength")
        if start + length > len(data):
            raise self.source.corrupt(f"a view of {length} bytes in a buffer of {len(data)}", field=name)
        return bytes(data[start : start + length])

    def _elements(self, accessor: dict[str, Any], element: np.dtype[Any], count: int, name: str) -> NDArray[Any]:
        view = self.entry("bufferViews", accessor["bufferView"])
        data = self._buffer(self.source.natural(view, "buffer"))
        start, length = self.source.natural(view, "byteOffset", 0), self.source.natural(view, "byteLength")
        offset = self.source.natural(accessor, "byteOffset", 0)
        stride = self.source.natural(view, "byteStride", element.itemsize)
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
        length, uri = self.source.natural(buffer, "byteLength"), buffer.get("uri")
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
        """A buffer in a file below the directory of the asset, which is read once however many buffers name it."""
        file = self.source.file_beside(unquote(uri) if isinstance(uri, str) else uri, "buffers.uri")
        if file.name not in self._files:
            self._files[file.name] = file.read()
        return self._files[file.name]


def _glb_chunks(source: Source) -> tuple[memoryview, memoryview | None]:
    """JSON and binary chunk of a .glb; chunks of other kinds are passed over, as glTF wants it."""
    data = memoryview(source.read())
    if len(data) < GLB.size:
        raise source.corrupt("cut within the header of the .glb")
    _, version, length = GLB.unpack_from(data)
    if version != GLB_VERSION:
        raise Unsupported("input-version", f"{source.name}: .glb container version {version}; this importer reads 2")
    if length > len(data):
        raise source.corrupt(f"{len(data)} bytes of {length}")
    chunks: list[tuple[bytes, memoryview]] = []
    at = GLB.size
    while at + CHUNK.size <= length and len(chunks) < 2:
        size, kind = CHUNK.unpack_from(data, at)
        at += CHUNK.size
        if at + size > length:
            raise source.corrupt(f"a chunk of {size} bytes does not fit", offset=at)
        chunks.append((kind, data[at : at + size]))
        at += size
    if not chunks or chunks[0][0] != JSON_CHUNK:
        raise source.corrupt("the first chunk of the .glb is not JSON", offset=GLB.size)
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == BINARY_CHUNK else None
    return chunks[0][1], binary


def _inline(source: Source, uri: str) -> bytes:
    head, _, text = uri.partition(",")
    if not head.endswith(";base64"):
        raise source.corrupt(f"a buffer in place must be base64, not {uri[:60]!r}", field="buffers.uri")
    try:
        return base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError) as error:
        raise source.corrupt(f"damaged base64 ({error})", field="buffers.uri") from error


def place_meshes(asset: Asset) -> Iterator[tuple[int, F64]]:
    """Index of each mesh of the default scene, and the (4, 4) matrix from its axes to those of the scene.

    Raises:
        InvalidInput: damaged, or a node is in the tree twice.
        Unsupported: ``input-gltf``: a node has an extension that may hide, move or repeat its mesh.
    """
    waiting = [(node, np.eye(4)) for node in reversed(_roots(asset))]
    seen: set[int] = set()
    while waiting:
        index, above = waiting.pop()
        node = asset.entry("nodes", index)
        if index in seen:
            raise asset.source.corrupt(f"node {index} is in the tree twice", field="nodes.children")
        seen.add(index)
        unknown = sorted(asset.source.member(node, "extensions").keys() - _HARMLESS)
        if unknown:
            message = f"{asset.source.name}: node {index} has {unknown[0][:80]}, which may hide, move or repeat it"
            raise Unsupported("input-gltf", f"{message}; export the scene without", field="nodes.extensions")
        matrix = above @ _local(asset, node)
        if "mesh" in node:
            yield asset.source.natural(node, "mesh"), matrix
        waiting.extend((child, matrix) for child in reversed(asset.source.array(node, "children")))


_HARMLESS = frozenset({"KHR_lights_punctual"})
"""Extensions of nodes that leave Gaussians as they are."""


def _roots(asset: Asset) -> list[Any]:
    """Nodes of the default scene; of an asset without scenes, all that are no children."""
    if asset.source.array(asset.document, "scenes"):
        return asset.source.array(asset.entry("scenes", asset.document.get("scene", 0)), "nodes")
    nodes = asset.source.array(asset.document, "nodes")
    children = {
        child
        for node in nodes
        if isinstance(node, dict)
        for child in asset.source.array(node, "children")
        if type(child) is int
    }
    return [index for index in range(len(nodes)) if index not in children]


def _local(asset: Asset, node: dict[str, Any]) -> F64:
    source = asset.source
    if "matrix" in node:
        return np.array(source.vector(node, "matrix", [0.0] * 16)).reshape(4, 4).T
    return compose(
        source.vector(node, "translation", (0, 0, 0)),
        source.vector(node, "rotation", (0, 0, 0, 1)),
        source.vector(node, "scale", (1, 1, 1)),
    )


def _place(scene: GaussianScene, matrix: F64, name: str) -> GaussianScene:
    """The scene where a node puts it.

    Raises:
        Unsupported: ``input-gltf``: the matrix is one for which glTF defines no picture.
    """
    try:
        return place_scene(scene, matrix)
    except ValueError as error:
        message = f"{name}: a node mirrors, shears or flattens its Gaussians ({error}); glTF defines no picture of that"
        raise Unsupported("input-gltf", message, field="nodes") from error


_COMPRESSIONS = ("KHR_gaussian_splatting_compression_spz_2", "KHR_gaussian_splatting_compression_spz")
"""The draft, and the name its own text gives it in places."""
_UNDERSTOOD = frozenset({EXTENSION, "KHR_mesh_quantization", "KHR_materials_unlit", *_COMPRESSIONS})
_PRESENT = "export the scene by the extension's present text"
_PICKED_OR_MOVED = frozenset({"indices", "targets", "JOINTS_0"})
"""What of a primitive picks some of its vertices, or moves them."""
_POSITIONS = frozenset({FLOAT, BYTE, UBYTE, SHORT, USHORT})
_ROTATIONS = frozenset({FLOAT, BYTE, SHORT})
_UNSIGNED = frozenset({FLOAT, UBYTE, USHORT})


def sniff(source: Source) -> bool:
    """Whether the content is a .glb, or JSON with the version of a glTF asset."""
    if source.head(4) == GLB_MAGIC:
        return True
    document = source.document or {}
    asset = document.get("asset")
    # The tilesets of 3D Tiles have an asset with a version, too.
    return isinstance(asset, dict) and "version" in asset and "geometricError" not in document


def load(source: Source) -> GaussianScene:
    """Read the Gaussians of a glTF asset.

    Raises:
        InvalidInput: damaged, a buffer is missing, or there are no Gaussians in it (``input-not-gaussians``).
        Unsupported: another version, kernel or colour space; another compression; a node that shears or mirrors, or
            has an unknown extension.
        LimitExceeded: more JSON, or more Gaussians, than any scene has.

    Warns:
        InputWarning: other scenes, animations, other primitives or harmonics of degree 4 are left out.
    """
    asset = Asset(source)
    for field, most in (("scenes", 1), ("animations", 0)):
        if len(asset.source.array(asset.document, field)) > most:
            source.warn(f"{field} are left out but for the default scene as it stands")
    required = [str(name)[:80] for name in asset.source.array(asset.document, "extensionsRequired")]
    unknown = sorted(set(required) - _UNDERSTOOD)
    if unknown:
        message = f"{source.name}: it requires {', '.join(unknown)}; export the scene without"
        raise Unsupported("input-gltf", message, field="extensionsRequired")
    parts = [_place(_gaussians(asset, primitive), matrix, source.name) for primitive, matrix in _place_gaussians(asset)]
    return flip_axes(concatenate(parts), LUF_TO_RDF)


def describe(source: Source) -> Description:
    """What the colour space of the primitives, SPZ files in them, and the coordinate reference of `asset.extras` say.

    Raises:
        Unsupported: ``input-gltf``: primitives of several colour spaces.

    Warns:
        InputWarning: the coordinate reference cannot be used.
    """
    asset = Asset(source)
    placed = _place_gaussians(asset)
    primitives = [primitive for primitive, _ in placed]
    spaces = {_terms(asset, primitive).get("colorSpace", SRGB) for primitive in primitives}
    if len(spaces) > 1:
        message = f"{source.name}: primitives of several colour spaces; export them one by one"
        raise Unsupported("input-gltf", message, field="colorSpace")
    packed = [spz.describe(file) for primitive in primitives if (file := _spz_file(asset, primitive)) is not None]
    models = {found.render_model for found in packed} or {RenderModel.CLASSIC}
    space = ColourSpace.LINEAR if spaces == {LINEAR} else ColourSpace.SRGB
    turned = any(not np.array_equal(matrix[:3, :3], np.eye(3)) for _, matrix in placed)
    return Description(max(models), colour_space=space).with_metadata(_coordinate_reference(asset, turned))


def _coordinate_reference(asset: Asset, turned: bool) -> dict[str, Any]:
    """The member of `asset.extras` that our writer makes, as METADATA has it (SPEC §7.10), or nothing."""
    extras = asset.source.member(asset.document, "asset").get("extras")
    if not isinstance(extras, dict) or _REFERENCE not in extras:
        return {}
    said = {_REFERENCE: extras[_REFERENCE]}
    try:
        check_registered(said)
    except Malformed as error:
        asset.source.warn(f"asset.extras: {error}; it is left out")
        return {}
    if turned:
        asset.source.warn("the coordinate reference holds before nodes turn the scene; it is left out")
        return {}
    return said


def _terms(asset: Asset, primitive: dict[str, Any]) -> dict[str, Any]:
    return asset.source.member(asset.source.member(primitive, "extensions"), EXTENSION)


def _spz_file(asset: Asset, primitive: dict[str, Any]) -> Source | None:
    """The SPZ file of a primitive; None where its attributes are plain.

    Raises:
        Unsupported: ``input-gltf``: it is compressed otherwise.
    """
    extensions = asset.source.member(_terms(asset, primitive), "extensions")
    for name, extension in extensions.items():
        if name not in _COMPRESSIONS or not isinstance(extension, dict):
            message = f"{asset.source.name}: Gaussians with the extension {name[:80]}; export the scene without"
            raise Unsupported("input-gltf", message, field=f"{EXTENSION}.extensions")
        return Source(asset.view(extension.get("bufferView"), name), f"{asset.source.name}/{name}")
    return None


def _place_gaussians(asset: Asset) -> list[tuple[dict[str, Any], F64]]:
    """All primitives with Gaussians, and the matrices of their nodes; counted before any of them is read."""
    found: list[tuple[dict[str, Any], F64]] = []
    others: list[set[str]] = []
    total = 0
    for mesh, matrix in place_meshes(asset):
        for primitive in asset.source.array(asset.entry("meshes", mesh), "primitives"):
            if not isinstance(primitive, dict):
                raise asset.source.corrupt("a primitive is not an object", field="meshes.primitives")
            extensions = asset.source.member(primitive, "extensions")
            if EXTENSION not in extensions:
                others.append(set(extensions))
                continue
            count = _count_declared(asset, primitive)
            total += count
            asset.source.check_count(total, file_bytes=_buffer_bytes(asset))
            found.append((primitive, matrix))
    if not found:
        names = ", ".join(sorted(set().union(*others)))[:80]
        lacking = f"{EXTENSION}{names and f', but {names}'}"
        message = f"{asset.source.name}: no primitive of its scene has {lacking}; {_PRESENT}"
        raise InvalidInput("input-not-gaussians", message, field="meshes.primitives.extensions")
    if others:
        asset.source.warn(f"{len(others)} primitives without Gaussians (meshes, lines) are left out")
    return found


def _count_declared(asset: Asset, primitive: dict[str, Any]) -> int:
    """Gaussians that the attributes of a primitive declare; compressed ones need not have any."""
    attributes = asset.source.member(primitive, "attributes")
    if POSITION not in attributes and asset.source.member(_terms(asset, primitive), "extensions"):
        return 0
    return asset.source.natural(asset.entry("accessors", attributes.get(POSITION)), "count")


def _buffer_bytes(asset: Asset) -> int:
    """Bytes of all buffers, of those with one address only once."""
    buffers = [buffer for buffer in asset.source.array(asset.document, "buffers") if isinstance(buffer, dict)]
    return sum({str(buffer.get("uri")): asset.source.natural(buffer, "byteLength") for buffer in buffers}.values())


def _gaussians(asset: Asset, primitive: dict[str, Any]) -> GaussianScene:
    """The Gaussians of one primitive, in its own axes."""
    file = _spz_file(asset, primitive)
    _check_terms(asset, primitive, compressed=file is not None)
    if file is not None:
        return _unpack(asset, primitive, file)
    attributes = asset.source.member(primitive, "attributes")

    def read(name: str, kind: str, allowed: frozenset[int]) -> NDArray[Any]:
        if name not in attributes:
            message = f"{asset.source.name}: Gaussians without {name}, as of an earlier draft; {_PRESENT}"
            raise Unsupported("input-gltf", message, field=name)
        return asset.numbers(attributes[name], kind, allowed, name)

    positions = read(POSITION, "VEC3", _POSITIONS)
    scales = read(SCALE, "VEC3", _UNSIGNED)
    rotations = read(ROTATION, "VEC4", _ROTATIONS)
    opacity = read(OPACITY, "SCALAR", _UNSIGNED)
    floats = frozenset({FLOAT})
    coefficients = [read(name, "VEC3", floats) for name in _harmonic_names(asset, attributes)]
    if any(len(values) != len(positions) for values in (scales, rotations, opacity, *coefficients)):
        raise asset.source.corrupt("the attributes of a primitive have different counts", field="meshes.primitives")
    if (scales < 0).any():
        raise asset.source.corrupt("a scale is below 0", field=SCALE)
    if ((opacity < 0) | (opacity > 1)).any():
        raise asset.source.corrupt("an opacity is not within 0 to 1", field=OPACITY)
    return GaussianScene(
        positions.astype(np.float64),
        log_scale(scales),
        rotations[:, [3, 0, 1, 2]].astype(np.float32),
        logit_of_opacity(opacity[:, 0], COMPONENTS[asset.entry("accessors", attributes[OPACITY])["componentType"]][1:]),
        np.stack(coefficients, axis=1).astype(np.float32, copy=False),
    )


def _unpack(asset: Asset, primitive: dict[str, Any], file: Source) -> GaussianScene:
    """The Gaussians of an SPZ file, in the axes of glTF."""
    scene = flip_axes(spz.load(file), LUF_TO_RDF)
    declared = _count_declared(asset, primitive)
    if declared not in (0, len(scene)):
        raise asset.source.corrupt(f"{len(scene)} Gaussians in an SPZ file, {declared} declared", field=POSITION)
    return scene


def _check_terms(asset: Asset, primitive: dict[str, Any], compressed: bool) -> None:
    """Refuse what would look different from what the extension's first version defines.

    Compressed files of before that version leave out kernel and colour space.
    """
    name = asset.source.name
    terms = _terms(asset, primitive)
    if compressed:
        terms = {"kernel": KERNEL, "colorSpace": SRGB, **terms}
    if primitive.get("mode") != POINTS:
        raise asset.source.corrupt("Gaussians must be points (mode 0)", field="meshes.primitives.mode")
    if terms.get("kernel") != KERNEL:
        message = f"{name}: kernel {str(terms.get('kernel'))[:40]!r}; this importer reads {KERNEL!r}; {_PRESENT}"
        raise Unsupported("input-gltf", message, field="kernel")
    if terms.get("colorSpace") not in (SRGB, LINEAR):
        message = f"{name}: colour space {str(terms.get('colorSpace'))[:40]!r}; known are {SRGB!r} and {LINEAR!r}"
        raise Unsupported("input-gltf", message, field="colorSpace")
    for field, default in (("projection", PROJECTION), ("sortingMethod", SORTING)):
        if terms.get(field, default) != default:
            asset.source.warn(f"{field} {str(terms[field])[:40]!r} is taken for {default!r}")
    members = primitive.keys() | asset.source.member(primitive, "attributes").keys()
    for field in sorted(members & _PICKED_OR_MOVED):
        asset.source.warn(f"{field} of Gaussians is not read: all are shown, where they stand at rest")


def _harmonic_names(asset: Asset, attributes: dict[str, Any]) -> list[str]:
    """Names of the attributes of all degrees there are, in order."""
    names: list[str] = harmonics(0)
    missing = ""
    if harmonic(4, 0) in attributes:
        asset.source.warn("spherical harmonics of degree 4 are left out: scenes here have degree 3")
    for degree in (1, 2, 3):
        band = harmonics(degree)
        there = [name for name in band if name in attributes]
        if there and (missing or len(there) < len(band)):
            lacking = missing or next(name for name in band if name not in attributes)
            raise asset.source.corrupt(f"{lacking} is missing below {there[-1]}", field=lacking)
        missing = missing or ("" if there else band[0])
        names += there
    return names
