"""Spark's `.rad`, version 1 (github.com/sparkjsdev/spark, MIT; layout as its 2.2.0 reads it).

The head, `RAD0`, lists chunks of up to 65,536 Gaussians, which follow it or lie in files beside it. A chunk, `RADC`,
has a head of its own and a stream for each property. A head has a u32 length, JSON, and zeros up to a multiple of 8;
that of a chunk is followed by a u64 length of all streams. Offsets count from there. All is little-endian.

- A stream has the first number of every Gaussian, then the second, and so on; but `oct88r8` has the three bytes of a
  Gaussian together. Compression `gz` is deflate without a header.
- center; alpha, 0..1; rgb, 0.5 plus what the harmonic of degree 0 adds; scales, standard deviations; orientation,
  x, y, z of a quaternion whose w is not negative; sh1 to sh3, coefficient by coefficient, red first. Axes are those of
  the scene it was made from.
- Where there is sh_label, the harmonics are rows of tables, sh1_code to sh3_code, which the first chunk has.
- Where there is child_count, the Gaussians are a tree of levels of detail, whose leaves are the scene. Inner nodes have
  opacities up to 2, and `r8` then reaches so far.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64
from scarfmt.errors import Unsupported
from scarfmt.formats.quantise import complete_smallest_three, dc_of_colour, logit_of_opacity
from scarfmt.formats.source import Source
from scarfmt.formats.spz import leaves
from scarfmt.limits import MAX_SH_DEGREE
from scarfmt.scene.gaussians import GaussianScene, concatenate

_FILE, _CHUNK = b"RAD0", b"RADC"
_ENCODINGS = {
    "f32": "f4", "f32_lebytes": "f4", "f16": "f2", "f16_lebytes": "f2", "ln_f16": "f2", "u16": "u2", "u32": "u4",
    "r8": "u1", "r8_delta": "u1", "s8": "i1", "s8_delta": "i1", "ln_0r8": "u1", "oct88r8": "u1",
}  # fmt: skip
"""Types of the numbers. `lebytes` has the lowest byte of all numbers first, `delta` differences to the Gaussian before;
`r8` are fractions of a range, `s8` of its upper end; `ln` are logarithms, of which `ln_0r8` keeps 0 for a size of 0."""
_HARMONICS = ("f32", "f16", "r8", "r8_delta", "s8", "s8_delta")
_PROPERTIES = {
    "center": (3, ("f32", "f16", "f32_lebytes", "f16_lebytes")),
    "alpha": (1, ("f32", "f16", "r8")),
    "rgb": (3, ("f32", "f16", "r8", "r8_delta")),
    "scales": (3, ("f32", "ln_f16", "ln_0r8")),
    "orientation": (3, ("f32", "f16", "oct88r8")),
    **{f"sh{band}{kind}": (6 * band + 3, _HARMONICS) for band in (1, 2, 3) for kind in ("", "_code")},
    "sh_label": (1, ("u16", "u32")),
    "child_count": (1, ("u16",)),
    "child_start": (1, ("u32",)),
}
"""How many numbers a Gaussian has, and their encodings."""
_LARGEST = float(np.finfo(np.float32).max)
_ROUNDING = 1 / 255
"""Half a step of bytes up to 2, of which the nearest to opaque is 128: an opacity of 1.004."""


def sniff(source: Source) -> bool:
    """Whether the content has the head of a file."""
    return source.head(4) == _FILE


def load(source: Source) -> GaussianScene:
    """Read a `.rad` file and the files of its chunks. A standard deviation of zero gives a log scale of -inf.

    Raises:
        InvalidInput: damaged, or a file is missing.
        Unsupported: another version, or a property, encoding or compression that is not known.
        LimitExceeded: more Gaussians than so few bytes unpack to.

    Warns:
        InputWarning: inner nodes of a tree are left out; others have opacities above 1.
    """
    data = memoryview(source.read())
    head, start = _head(source, data, _FILE)
    count, degree = source.natural(head, "count"), source.natural(head, "maxSh", 0)
    if head.get("type") != "gsplat" or degree > MAX_SH_DEGREE:
        raise _unknown(source, "type", f"{head.get('type')}, degree {degree}")
    places = [_place(source, data[start:], place) for place in source.array(head, "chunks")]
    sizes = {source.name: source.size} | {file.name: file.size for file, _, _ in places}
    source.check_count(count, sh_degree=degree, file_bytes=sum(sizes.values()))
    scenes, children, table, bright, done = [], [np.zeros(0, np.uint16)], None, 0, 0
    for file, first, length in places:
        part = data[start:] if file is source else memoryview(file.read())
        chunk = _Chunk(file, part[first : first + length])
        if chunk.base != done or chunk.count > count - done:
            raise file.corrupt(f"{chunk.count} Gaussians from {chunk.base} on, after {done} of {count}", field="base")
        if chunk.has("sh1_code"):
            rows = source.natural(head, "shCodeCount", chunk.count)
            source.check_count(rows, sh_degree=degree, file_bytes=length)
            table = chunk.harmonics("_code", degree, rows)
        is_tree = chunk.has("child_count") or head.get("lodTree") is True
        children.append(chunk.numbers("child_count")[:, 0] if is_tree else np.zeros(chunk.count, np.uint16))
        scene, alpha = chunk.scene(degree, table)
        scenes.append(scene)
        bright += int(np.count_nonzero((alpha > 1 + _ROUNDING) & (children[-1] == 0)))
        done += chunk.count
    if done != count:
        raise source.corrupt(f"{done} Gaussians in its chunks, but its head declares {count}", field="count")
    if bright:
        source.warn(f"{bright:,} Gaussians have opacities above 1, which Spark draws wider; they are read as opaque")
    everything, tree = concatenate(scenes), np.concatenate(children)
    return leaves(source, everything, tree) if tree.any() else everything


def _head(source: Source, data: memoryview, magic: bytes) -> tuple[dict[str, Any], int]:
    """The JSON that stands first, and where it and its padding end."""
    length = int.from_bytes(data[4:8], "little")
    if data[:4] != magic or len(data) < 8 + length:
        raise source.corrupt(f"no {magic.decode()} with {length} bytes of JSON", offset=0)
    head = source.json(data[8 : 8 + length], magic.decode())
    if head.get("version") != 1:
        raise _unknown(source, f"{magic.decode()} version", head.get("version"))
    return head, 8 + length + -length % 8


def _place(source: Source, body: memoryview, place: object) -> tuple[Source, int, int]:
    """The file that has a chunk, its first byte, after the head where it is the same file, and its length."""
    if not isinstance(place, dict):
        raise source.corrupt("expected a JSON object", field="chunks")
    name = place.get("filename")
    file = source if name is None else source.file_beside(name, "chunks.filename")
    first, length = source.natural(place, "offset"), source.natural(place, "bytes")
    there = len(body) if file is source else file.size
    if first + length > there:
        raise source.corrupt(f"a chunk of {length} bytes at {first} of {there} in {file.name}", field="chunks")
    return file, first, length


def _unknown(source: Source, what: str, value: object) -> Unsupported:
    message = f"{source.name}: {what} {str(value)[:40]!r} of a .rad is not known; give the file it was made from"
    return Unsupported("input-version", message)


class _Chunk:
    """The Gaussians of one chunk: `count` of them, the first of which is number `base` of the scene."""

    def __init__(self, source: Source, data: memoryview):
        self._source = source
        head, start = _head(source, data, _CHUNK)
        self.base, self.count = source.natural(head, "base"), source.natural(head, "count")
        size = int.from_bytes(data[start : start + 8], "little")
        self._streams = data[start + 8 : start + 8 + size]
        if len(self._streams) != size:
            raise source.corrupt(f"a chunk of {len(data)} bytes with {size} bytes of streams", offset=start)
        self._properties: dict[str, dict[str, Any]] = {}
        for entry in source.array(head, "properties"):
            name = entry.get("property") if isinstance(entry, dict) else None
            if not isinstance(name, str) or name not in _PROPERTIES:
                raise _unknown(source, "property", name)
            if self.has(name):
                raise source.corrupt("a chunk has this property twice", field=name)
            if entry.get("encoding") not in _PROPERTIES[name][1]:
                raise _unknown(source, f"encoding of {name}", entry.get("encoding"))
            self._properties[name] = entry

    def has(self, name: str) -> bool:
        """Whether it has a property."""
        return name in self._properties

    def scene(self, degree: int, table: F32 | None) -> tuple[GaussianScene, F64]:
        """Its Gaussians, and their opacities as stored.

        Args:
            degree: of the harmonics.
            table: (rows, R, 3) harmonics, which `sh_label` numbers; None where no chunk so far has any.
        """
        alpha = self.numbers("alpha")[:, 0].astype(np.float64)
        scales, colours = self.numbers("scales"), self.numbers("rgb")
        with np.errstate(divide="ignore", invalid="ignore"):
            log_scales = scales if self._encoding("scales").startswith("ln") else np.log(scales)
        rest = self._label(table) if self.has("sh_label") else self.harmonics("", degree, self.count)
        scene = GaussianScene(
            self.numbers("center").astype(np.float64),
            log_scales.astype(np.float32),
            self._rotations(),
            logit_of_opacity(alpha, _ENCODINGS[self._encoding("alpha")]),
            np.concatenate([dc_of_colour(colours.astype(np.float64)), rest], axis=1),
        )
        return scene, alpha

    def harmonics(self, kind: str, degree: int, rows: int) -> F32:
        """(rows, R, 3) coefficients above degree 0, of its Gaussians or, with kind `_code`, of a table."""
        bands = [self.numbers(f"sh{band}{kind}", rows) for band in range(1, degree + 1)]
        return np.concatenate([np.empty((rows, 0)), *bands], axis=1).astype(np.float32).reshape(rows, -1, 3)

    def _label(self, table: F32 | None) -> F32:
        labels = self.numbers("sh_label")[:, 0]
        if table is None or labels.max(initial=0) >= len(table):
            raise self._source.corrupt("a label beyond the table of harmonics", field="sh_label")
        rows: F32 = table[labels]
        return rows

    def _rotations(self) -> F32:
        stored = self.numbers("orientation").astype(np.float64)
        if self._encoding("orientation") == "oct88r8":
            quaternions = _octahedral(stored / 255)
        else:
            quaternions = complete_smallest_three(stored, np.full(self.count, 3))
        return quaternions[:, [3, 0, 1, 2]].astype(np.float32)

    def _encoding(self, name: str) -> str:
        if not self.has(name):
            raise self._source.corrupt("a chunk lacks this property", field=name)
        return str(self._properties[name]["encoding"])

    def numbers(self, name: str, rows: int | None = None) -> NDArray[Any]:
        """(rows, width) values of a property, `rows` being `count` where it is not given."""
        encoding = self._encoding(name)
        width, rows = _PROPERTIES[name][0], self.count if rows is None else rows
        kind = np.dtype(f"<{_ENCODINGS[encoding]}")
        stream = self._stream(name, rows * width * kind.itemsize)
        if encoding == "oct88r8":
            return stream.reshape(rows, width)
        if encoding.endswith("lebytes"):
            stream = np.ascontiguousarray(stream.reshape(kind.itemsize, -1).T).reshape(-1)
        planes = stream.view(kind).reshape(width, rows)
        if encoding.endswith("delta"):
            planes = np.cumsum(planes, axis=1, dtype=kind)
        return self._dequantise(name, planes.T) if kind.itemsize == 1 else planes.T

    def _dequantise(self, name: str, stored: NDArray[Any]) -> NDArray[Any]:
        bounds: list[Any] = [self._properties[name].get(end) for end in ("min", "max")]
        if not all(type(bound) in (int, float) and abs(bound) <= _LARGEST for bound in bounds):
            raise self._source.corrupt("its range is no two numbers", field=name)
        low, high = np.array(bounds, np.float64)
        if name == "scales":
            return np.where(stored == 0, -np.inf, low + (stored - 1.0) / 254.0 * (high - low))
        values: F64 = stored / 127.0 * high if stored.dtype == np.int8 else low + stored / 255.0 * (high - low)
        return values

    def _stream(self, name: str, size: int) -> NDArray[np.uint8]:
        """The bytes of a property, inflated no further than to the `size` expected."""
        entry = self._properties[name]
        first, length = self._source.natural(entry, "offset"), self._source.natural(entry, "bytes")
        stream: bytes | memoryview = self._streams[first : first + length]
        is_whole = len(stream) == length
        if entry.get("compression") == "gz":
            inflater = zlib.decompressobj(wbits=-15)
            try:
                stream = inflater.decompress(stream, size + 1)
            except zlib.error as error:
                raise self._source.corrupt(f"a damaged stream ({error})", field=name) from error
            is_whole = is_whole and inflater.eof
        elif entry.get("compression") is not None:
            raise _unknown(self._source, f"compression of {name}", entry["compression"])
        if not is_whole or len(stream) != size:
            raise self._source.corrupt(f"a stream of {len(stream)} bytes, expected {size}", field=name)
        return np.frombuffer(stream, np.uint8)


def _octahedral(fractions: F64) -> F64:
    """(N, 4) quaternions x, y, z, w of (N, 3): an axis on an octahedron, unfolded to a square, and an angle over pi."""
    x, y = fractions[:, :2].T * 2 - 1
    z = 1 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0)
    axis = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=1)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    half = fractions[:, 2:] * (np.pi / 2)
    return np.concatenate([axis * np.sin(half), np.cos(half)], axis=1)
