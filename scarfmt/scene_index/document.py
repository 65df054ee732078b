"""The scene index: parsing it with every rule of SPEC §17, and writing it."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any, NoReturn, TypeVar

import numpy as np

from scarfmt.arrays import F64
from scarfmt.blocks.metadata import nesting, parse_json
from scarfmt.container.header import Header
from scarfmt.container.schema import ColourSpace, CoordinateFrame, Profile
from scarfmt.errors import LimitExceeded, Malformed, Unsupported
from scarfmt.limits import MAX_ANCHORS, MAX_FILE_LENGTH, MAX_LAYERS, MAX_SH_DEGREE, MAX_SLOTS
from scarfmt.scene.placement import Placement

FORMAT, VERSION = "scar-scene", 1
MOST_BYTES = 1 << 26
"""An entry takes 0.5 to 1.5 kB: so many are enough for as many files as there may be."""
MOST_FILES = 1 << 16
"""A file of 10^8 anchors is sensible: more than 10^12 in all."""
MOST_NESTING = 8
MOST_URI_BYTES = 1024

_SEGMENT = re.compile(r"""[^\x00-\x1f\x7f\\:?#%*<>|"/]*[^\x00-\x1f\x7f\\:?#%*<>|"/. ]""")
_SPACE = b" \t\r\n"
HEAD_BYTES = 64
"""Number of bytes at the start of a document that tell an index from a .scar file."""

Named = TypeVar("Named", bound=IntEnum)


@dataclass(frozen=True)
class ListedLayer:
    """The totals of a file after a layer.

    Attributes:
        end: bytes from the start of the file to the end of the layer.
        anchors, gaussians: in it and all before.
    """

    end: int
    anchors: int
    gaussians: int


@dataclass(frozen=True)
class ListedFile:
    """The entry of one file in an index.

    Attributes:
        uri: where it is, relative to the index.
        length: bytes.
        header_crc32: of its header.
        profile, sh_degree, slots: of its header.
        low, high: corners of a box that all its anchors are in, in its own coordinates.
        layers: what it holds after each.
        transform: 4 x 4, by rows; None for none.
    """

    uri: str
    length: int
    header_crc32: int
    profile: Profile
    sh_degree: int
    slots: int
    low: tuple[float, ...]
    high: tuple[float, ...]
    layers: tuple[ListedLayer, ...]
    transform: tuple[tuple[float, ...], ...] | None = None

    @cached_property
    def placement(self) -> Placement | None:
        """The placement of the file; None if its coordinates are those of the scene."""
        return None if self.transform is None else Placement.of(self.transform)

    @property
    def box(self) -> tuple[F64, F64]:
        """Corners (3,) of a box along the axes of the scene that all its anchors are in."""
        low, high = np.array(self.low), np.array(self.high)
        return (low, high) if self.placement is None else self.placement.box(low, high)

    def layer(self, number: int) -> ListedLayer:
        """After `number` layers of the scene, from 1: all where the file has fewer (R-17-10)."""
        return self.layers[min(number, len(self.layers)) - 1]

    def difference(self, header: Header, crc32: int) -> str | None:
        """The name of a number that differs between this entry and the header of its file; None if all agree (R-17-8).

        Args:
            header: of the file.
            crc32: of that header.
        """
        fields = header.fields
        layers = tuple(
            ListedLayer(layer.end_offset, layer.anchor_count, layer.gaussian_count) for layer in header.layers
        )
        pairs = {
            "length": (self.length, header.file_length),
            "header_crc32": (self.header_crc32, crc32),
            "profile": (self.profile, fields.profile),
            "sh_degree": (self.sh_degree, fields.sh_degree),
            "slots": (self.slots, fields.slots),
            "layers": (self.layers, layers),
        }
        return next((name for name, (here, there) in pairs.items() if here != there), None)

    def as_json(self) -> dict[str, Any]:
        """The member of `files`."""
        out: dict[str, Any] = {
            "uri": self.uri,
            "length": self.length,
            "header_crc32": self.header_crc32,
            "profile": self.profile.name,
            "sh_degree": self.sh_degree,
            "slots": self.slots,
            "box": [list(self.low), list(self.high)],
            "layers": [vars(layer) for layer in self.layers],
        }
        if self.transform is not None:
            out["transform"] = [list(row) for row in self.transform]
        return out


@dataclass(frozen=True)
class Index:
    """The content of an index.

    Attributes:
        files: one at least.
        coordinate_frame, colour_space: of all of them.
    """

    files: tuple[ListedFile, ...]
    coordinate_frame: CoordinateFrame = CoordinateFrame.UNSPECIFIED
    colour_space: ColourSpace = ColourSpace.UNSPECIFIED

    @property
    def layer_count(self) -> int:
        """Layers of the scene: of the file that has most."""
        return max(len(file.layers) for file in self.files)

    def layer(self, number: int) -> ListedLayer:
        """The totals of all files after `number` layers, from 1."""
        found = [file.layer(number) for file in self.files]
        return ListedLayer(*(sum(getattr(one, name) for one in found) for name in ("end", "anchors", "gaussians")))

    def text(self) -> bytes:
        """The JSON document, a file a line."""
        head = {
            "format": FORMAT,
            "version": VERSION,
            "coordinate_frame": self.coordinate_frame.name,
            "colour_space": self.colour_space.name,
        }
        lines = ",\n".join(json.dumps(file.as_json(), ensure_ascii=False) for file in self.files)
        return (json.dumps(head)[:-1] + f', "files": [\n{lines}\n]}}\n').encode()


def is_index(head: bytes) -> bool:
    """Whether a document that begins like this is a scene index, and no .scar file."""
    return head.lstrip(_SPACE)[:1] == b"{"


def parse_index(data: bytes, *, files: int = MOST_FILES) -> Index:
    """Parse an index.

    Args:
        data: all of it.
        files: how many this reader accepts.

    Raises:
        Malformed: ``bad-scene``.
        Unsupported: ``unsupported-scene``.
        LimitExceeded: ``limit-scene``.
    """
    check_size(len(data))
    if nesting(data) > MOST_NESTING:
        raise LimitExceeded("limit-scene", f"nested {nesting(data)} deep; {MOST_NESTING} is the most")
    try:
        value = parse_json(data)
    except ValueError as error:
        raise Malformed("bad-scene", f"not JSON: {error}") from error
    if not isinstance(value, dict) or value.get("format") != FORMAT:
        _bad("format", f"a scene index is an object whose format is {FORMAT!r}")
    version = _whole(_member(value, "version", ""), "version", 0, MAX_FILE_LENGTH)
    if version != VERSION:
        raise Unsupported("unsupported-scene", f"version {version} of a scene index; this reader knows {VERSION}")
    frame = _named(value, "coordinate_frame", "", CoordinateFrame)
    space = _named(value, "colour_space", "", ColourSpace)
    listed = _member(value, "files", "")
    if not isinstance(listed, list) or not listed:
        _bad("files", "no list of files")
    if len(listed) > files:
        raise LimitExceeded("limit-scene", f"{len(listed)} files; {files} is the most", field="files")
    found = tuple(_file(one, f"files[{number}]") for number, one in enumerate(listed))
    _check_unique(found)
    return Index(found, frame, space)


def check_size(size: int) -> None:
    """Refuse an index of `size` bytes that is too long, before it is read.

    Raises:
        LimitExceeded: ``limit-scene``.
    """
    if size > MOST_BYTES:
        raise LimitExceeded("limit-scene", f"an index of {size} bytes; {MOST_BYTES} is the most")


def check_uri(uri: object, where: str = "uri") -> str:
    """`uri`, where a file of a scene may be (R-17-5).

    Raises:
        Malformed: ``bad-scene``.
    """
    if not isinstance(uri, str) or any("\ud800" <= character <= "\udfff" for character in uri):
        _bad(where, "no text")
    if not 1 <= len(uri.encode()) <= MOST_URI_BYTES:
        _bad(where, f"{len(uri.encode())} bytes; 1 to {MOST_URI_BYTES} are possible")
    if not all(_SEGMENT.fullmatch(segment) for segment in uri.split("/")):
        _bad(where, f"{uri!r} is no path below the folder of the index that every system knows")
    return uri


def _file(value: Any, where: str) -> ListedFile:
    length = _whole(_member(value, "length", where), f"{where}.length", 1, MAX_FILE_LENGTH)
    slots = _whole(_member(value, "slots", where), f"{where}.slots", 1, MAX_SLOTS)
    low, high = _box(_member(value, "box", where), f"{where}.box")
    return ListedFile(
        check_uri(_member(value, "uri", where), f"{where}.uri"),
        length,
        _whole(_member(value, "header_crc32", where), f"{where}.header_crc32", 0, (1 << 32) - 1),
        _named(value, "profile", where, Profile),
        _whole(_member(value, "sh_degree", where), f"{where}.sh_degree", 0, MAX_SH_DEGREE),
        slots,
        low,
        high,
        _layers(_member(value, "layers", where), f"{where}.layers", length, slots),
        _transform(value.get("transform"), f"{where}.transform") if "transform" in value else None,
    )


def _layers(value: Any, where: str, length: int, slots: int) -> tuple[ListedLayer, ...]:
    if not isinstance(value, list) or not 1 <= len(value) <= MAX_LAYERS:
        _bad(where, f"no list of 1 to {MAX_LAYERS} layers")
    out: list[ListedLayer] = []
    before = ListedLayer(0, 0, 0)
    most = {"end": MAX_FILE_LENGTH, "anchors": MAX_ANCHORS, "gaussians": MAX_FILE_LENGTH}
    for number, one in enumerate(value):
        at = f"{where}[{number}]"
        numbers = {name: _whole(_member(one, name, at), f"{at}.{name}", name == "end", most[name]) for name in most}
        layer = ListedLayer(**numbers)
        if any(getattr(layer, name) < getattr(before, name) for name in most):
            _bad(at, "less than after the layer before")
        if layer.gaussians > layer.anchors * slots:
            _bad(at, f"{layer.gaussians} Gaussians of {layer.anchors} anchors with {slots} slots")
        out.append(layer)
        before = layer
    if before.end != length:
        _bad(where, f"they end at {before.end}, the file at {length}")
    return tuple(out)


def _box(value: Any, where: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if not isinstance(value, list) or len(value) != 2:
        _bad(where, "not two corners")
    low, high = (_numbers(corner, where, 3) for corner in value)
    if any(a > b for a, b in zip(low, high, strict=True)):
        _bad(where, "it ends before it begins")
    return low, high


def _transform(value: Any, where: str) -> tuple[tuple[float, ...], ...]:
    if not isinstance(value, list) or len(value) != 4:
        _bad(where, "not four rows")
    rows = tuple(_numbers(row, where, 4) for row in value)
    try:
        Placement.of(rows)
    except ValueError as error:
        _bad(where, str(error))
    return rows


def _check_unique(files: tuple[ListedFile, ...]) -> None:
    seen: set[str] = set()
    for number, file in enumerate(files):
        if file.uri in seen:
            _bad(f"files[{number}].uri", f"{file.uri!r} comes twice")
        seen.add(file.uri)


def _member(value: Any, name: str, where: str) -> Any:
    if not isinstance(value, dict) or name not in value:
        _bad(f"{where}.{name}".lstrip("."), "it is missing")
    return value[name]


def _named(value: Any, name: str, where: str, kind: type[Named]) -> Named:
    found, at = _member(value, name, where), f"{where}.{name}".lstrip(".")
    if not isinstance(found, str) or found not in kind.__members__:
        _bad(at, f"none of {', '.join(kind.__members__)}")
    return kind[found]


def _whole(value: Any, where: str, low: int, high: int) -> int:
    number = _number(value, where)
    if number != int(number) or not low <= number <= high:
        _bad(where, f"{value!r} is no whole number from {low} to {high}")
    return int(number)


def _numbers(value: Any, where: str, count: int) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != count:
        _bad(where, f"not {count} numbers")
    return tuple(float(_number(one, where)) for one in value)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        _bad(where, "no number")
    return value


def _bad(where: str, message: str) -> NoReturn:
    raise Malformed("bad-scene", f"{message} (SPEC §17)", field=where)
