"""The header: signature, fixed fields, layer summaries and their checksum (SPEC §5.1 to §5.3).

Its rules are applied in the order of :func:`read_header`, so that two readers refuse one file for the same reason.
"""

from __future__ import annotations

import math
import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scarfmt.container.schema import (
    CHECKSUM_SIZE,
    FILE_HEADER,
    FILE_HEADER_SIZE,
    HEADER_CHECKSUM,
    LAYER_SUMMARY,
    LAYER_SUMMARY_SIZE,
    SIGNATURE,
    VERSION,
    ColourSpace,
    CoordinateFrame,
    Profile,
    RenderModel,
    field_table,
)
from scarfmt.container.source import ByteSource
from scarfmt.errors import LimitExceeded, Malformed, Truncated, Unsupported
from scarfmt.limits import (
    DEFAULT_LIMITS,
    FREE_ANCHORS,
    FREE_SLOTS,
    MAX_FILE_LENGTH,
    MAX_LATTICE_BITS,
    MAX_LAYERS,
    MAX_PAGE_BITS,
    MAX_SH_DEGREE,
    MAX_SLOTS,
    Limits,
)


@dataclass(frozen=True)
class HeaderFields:
    """The statements of an encoder about the whole scene. Truncation does not change them.

    Attributes:
        profile: explicit or anchor.
        sh_degree: degree of the decoded spherical harmonics, 0..3; 0 in the anchor profile.
        slots: K, Gaussian slots per anchor, 1..32; 1 in the explicit profile.
        lattice_bits: bits per axis of the position lattice, 1..32.
        origin: world position of lattice point (0, 0, 0); finite.
        voxel: world length of one lattice step; finite, above 0.
        source_count: Gaussians or anchors in the encoder's input; informative.
        coordinate_frame: which way the axes point.
        colour_space: what colours measure.
        render_model: how the Gaussians are to be drawn.
    """

    profile: Profile
    sh_degree: int
    slots: int
    lattice_bits: int
    origin: tuple[float, float, float]
    voxel: float
    source_count: int = 0
    coordinate_frame: CoordinateFrame = CoordinateFrame.UNSPECIFIED
    colour_space: ColourSpace = ColourSpace.UNSPECIFIED
    render_model: RenderModel = RenderModel.CLASSIC


@dataclass(frozen=True)
class LayerSummary:
    """The totals of one layer. `anchor_count` and `gaussian_count` are cumulative, `byte_count` is not."""

    anchor_count: int
    gaussian_count: int
    byte_count: int
    end_offset: int
    stream_bytes: tuple[int, ...]


@dataclass(frozen=True)
class Header:
    """The checked header of a file, layer summaries included."""

    fields: HeaderFields
    header_length: int
    file_length: int
    page_bits: int
    tile_count: int
    root_length: int
    anchor_count: int
    gaussian_count: int
    root_crc32: int
    layers: tuple[LayerSummary, ...]

    @property
    def layer_count(self) -> int:
        """Layers the file declares."""
        return len(self.layers)

    @property
    def page_count(self) -> int:
        """P, pages of tiles."""
        return -(-self.tile_count >> self.page_bits)

    def page_range(self, page: int) -> range:
        """The tiles of a page."""
        first = page << self.page_bits
        return range(first, min(first + (1 << self.page_bits), self.tile_count))

    @property
    def data_offset(self) -> int:
        """D, absolute offset of the first block; ROOT starts at `header_length`."""
        return self.layers[0].end_offset - self.layers[0].byte_count


def header_length(layer_count: int) -> int:
    """Bytes of header, layer summaries and header checksum of a file of `layer_count` layers."""
    return FILE_HEADER_SIZE + layer_count * LAYER_SUMMARY_SIZE + CHECKSUM_SIZE


def make_header(fields: HeaderFields, summaries: list[LayerSummary], page_bits: int, tiles: int, root: bytes) -> Header:
    """The header of a file of these summaries, at least one, with `root` as its ROOT."""
    last = summaries[-1]
    return Header(
        fields,
        header_length(len(summaries)),
        last.end_offset,
        page_bits,
        tiles,
        len(root),
        last.anchor_count,
        last.gaussian_count,
        zlib.crc32(root),
        tuple(summaries),
    )


def encode_header(header: Header) -> bytes:
    """The header's bytes, from the signature through header_crc32."""
    values = {
        **vars(header.fields),
        **vars(header),
        "signature": SIGNATURE,
        "major": VERSION[0],
        "minor": VERSION[1],
        "layer_count": header.layer_count,
    }
    body = FILE_HEADER.build(values) + b"".join(LAYER_SUMMARY.build(vars(layer)) for layer in header.layers)
    return bytes(body + HEADER_CHECKSUM.build({"header_crc32": zlib.crc32(body)}))


_OTHER_FORMATS = {
    b"ply": "a PLY file; encode it first",
    b"PK\x03\x04": "a zip archive, perhaps a .sog; encode it first",
    b"\x1f\x8b": "gzip data, perhaps an .spz; encode it first",
    b"NGSP": "an SPZ file; encode it first",
    b"glTF": "a binary glTF file; encode it first",
}


def is_scar(origin: str | os.PathLike[str] | bytes) -> bool:
    """Whether a scene is a .scar file. The signature decides; a URL is assumed to name one."""
    if isinstance(origin, bytes):
        return origin.startswith(SIGNATURE)
    if "://" in str(origin):
        return True
    path = Path(origin)
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(SIGNATURE)) == SIGNATURE


def _refuse_signature(head: bytes) -> None:
    if b"SCAR" in head[:8]:
        raise Malformed(
            "damaged-signature",
            "the signature is damaged as by a transfer in text mode (line ends or the high bit changed): "
            "transfer the file again in binary mode",
            offset=0,
            field="signature",
        )
    guess = next((name for magic, name in _OTHER_FORMATS.items() if head.startswith(magic)), None)
    what = f"it looks like {guess}" if guess else f"it starts with {head[:9].hex(' ') or 'nothing'}"
    raise Malformed("bad-signature", f"not a .scar file: {what}", offset=0, field="signature")


def _truncated_header(size: int, needed: int) -> Truncated:
    what = f"the file ends inside its header of {needed} bytes" if size else "the file is empty"
    return Truncated("truncated-header", what, offset=size)


def _check_signature(head: bytes) -> None:
    if not head.startswith(SIGNATURE):
        if SIGNATURE.startswith(head):
            raise _truncated_header(len(head), header_length(1))
        _refuse_signature(head)
    version = tuple(head[len(SIGNATURE) : len(SIGNATURE) + 2])
    if len(version) < 2:
        raise _truncated_header(len(head), header_length(1))
    if version != VERSION:
        advice = "encode the scene again" if version < VERSION else "use a newer reader"
        raise Unsupported(
            "unsupported-version",
            f"version {version[0]}.{version[1]}; this reader knows {VERSION[0]}.{VERSION[1]}: {advice}",
            offset=len(SIGNATURE),
            field="major",
        )


def _check_header_bytes(head: bytes) -> bytes:
    """The header's own bytes, cut to header_length and verified by their CRC-32."""
    if len(head) < 16:
        raise _truncated_header(len(head), header_length(1))
    length = int.from_bytes(head[12:16], "little")
    if not header_length(1) <= length <= header_length(MAX_LAYERS) or (length - header_length(0)) % LAYER_SUMMARY_SIZE:
        raise Malformed(
            "bad-header-length",
            f"{length} is not 104 + 136 * layers for 1..{MAX_LAYERS} layers",
            offset=12,
            field="header_length",
        )
    if len(head) < length:
        raise _truncated_header(len(head), length)
    end = length - CHECKSUM_SIZE
    if zlib.crc32(head[:end]) != HEADER_CHECKSUM.parse(head[end:length]).header_crc32:
        raise Malformed(
            "header-crc-mismatch", "the header is damaged: get another copy", offset=end, field="header_crc32"
        )
    return head[:length]


_HEADER_FIELDS = {row.name: row for row in field_table(FILE_HEADER)}

_HEADER_RULES: tuple[tuple[str, str, Callable[[Any], bool]], ...] = (
    ("render_model", "bad-reserved", lambda h: h.render_model in set(RenderModel)),
    ("file_length", "bad-file-length", lambda h: h.file_length <= MAX_FILE_LENGTH),
    ("profile", "bad-profile", lambda h: h.profile in set(Profile)),
    ("sh_degree", "bad-sh-degree", lambda h: h.sh_degree <= (0 if h.profile else MAX_SH_DEGREE)),
    ("layer_count", "bad-layer-count", lambda h: header_length(h.layer_count) == h.header_length),
    ("slots", "bad-slots", lambda h: 1 <= h.slots <= (MAX_SLOTS if h.profile else 1)),
    ("lattice_bits", "bad-lattice-bits", lambda h: 1 <= h.lattice_bits <= MAX_LATTICE_BITS),
    ("coordinate_frame", "bad-coordinate-frame", lambda h: h.coordinate_frame in set(CoordinateFrame)),
    ("colour_space", "bad-colour-space", lambda h: h.colour_space in set(ColourSpace)),
    ("page_bits", "bad-page-bits", lambda h: h.page_bits <= MAX_PAGE_BITS),
    ("origin", "bad-origin", lambda h: all(map(math.isfinite, h.origin))),
    ("voxel", "bad-voxel", lambda h: math.isfinite(h.voxel) and h.voxel > 0),
    ("voxel", "bad-voxel", lambda h: math.isfinite(max(map(abs, h.origin)) + h.voxel * 2.0 ** (h.lattice_bits + 1))),
    ("source_count", "bad-source-count", lambda h: h.source_count <= MAX_FILE_LENGTH),
)


def _check_fields(raw: Any) -> None:
    for name, refusal, holds in _HEADER_RULES:
        if not holds(raw):
            rule = _HEADER_FIELDS[name]
            value = list(raw[name]) if name == "origin" else raw[name]
            raise Malformed(refusal, f"{value} breaks the rule '{rule.description}'", offset=rule.offset, field=name)


def _check_limits(raw: Any, limits: Limits) -> None:
    anchors, size = raw.anchor_count, raw.file_length
    for name, refusal, value, limit in (
        ("tile_count", "limit-tiles", raw.tile_count, limits.tiles),
        ("anchor_count", "limit-anchors", anchors, limits.anchors),
        ("gaussian_count", "limit-gaussians", raw.gaussian_count, limits.gaussians),
        ("root_length", "limit-root", raw.root_length, limits.root_bytes),
        ("anchor_count", "limit-expansion", anchors, FREE_ANCHORS + limits.anchors_per_byte * size),
        ("slots", "limit-expansion", anchors * raw.slots, FREE_SLOTS + limits.slots_per_byte * size),
    ):
        if value > limit:
            raise LimitExceeded(
                refusal,
                f"{value} exceeds this reader's limit of {limit}: raise it if you trust the file",
                offset=_HEADER_FIELDS[name].offset,
                field=name,
            )


def _check_layers(header: Header) -> None:
    """The summaries agree with each other and with the header."""
    slots, explicit = header.fields.slots, header.fields.profile == Profile.EXPLICIT
    anchors = gaussians = 0
    end = header.data_offset
    least = header.header_length + header.root_length
    for index, layer in enumerate(header.layers):
        base = FILE_HEADER_SIZE + index * LAYER_SUMMARY_SIZE
        name = f"layers[{index}]"
        low = layer.anchor_count if explicit else 0
        if layer.anchor_count < anchors or layer.gaussian_count < gaussians:
            raise Malformed("layer-counts", "cumulative counts fall", offset=base, field=name)
        if not low <= layer.gaussian_count <= layer.anchor_count * slots:
            message = f"{layer.gaussian_count} Gaussians from {layer.anchor_count} anchors of {slots} slots"
            raise Malformed("layer-counts", message, offset=base + 8, field=f"{name}.gaussian_count")
        if sum(layer.stream_bytes) != layer.byte_count:
            message = f"stream_bytes sum to {sum(layer.stream_bytes)}, byte_count is {layer.byte_count}"
            raise Malformed("layer-bytes", message, offset=base + 16, field=f"{name}.byte_count")
        end += layer.byte_count
        if layer.end_offset != end or end - layer.byte_count < least:
            message = f"a layer of {layer.byte_count} bytes cannot end at byte {layer.end_offset}"
            raise Malformed("layer-offset", message, offset=base + 24, field=f"{name}.end_offset")
        anchors, gaussians = layer.anchor_count, layer.gaussian_count
    if (header.anchor_count, header.gaussian_count) != (anchors, gaussians):
        message = f"{header.anchor_count}, {header.gaussian_count} are not the last layer's {anchors}, {gaussians}"
        raise Malformed("layer-counts", message, offset=_HEADER_FIELDS["anchor_count"].offset, field="anchor_count")
    if header.file_length != end:
        message = f"{header.file_length}, but the last layer ends at byte {end}"
        raise Malformed("bad-file-length", message, offset=16, field="file_length")


def _header_from(raw: Any, data: bytes) -> Header:
    fields = HeaderFields(
        Profile(raw.profile),
        raw.sh_degree,
        raw.slots,
        raw.lattice_bits,
        (raw.origin[0], raw.origin[1], raw.origin[2]),
        raw.voxel,
        raw.source_count,
        CoordinateFrame(raw.coordinate_frame),
        ColourSpace(raw.colour_space),
        RenderModel(raw.render_model),
    )
    starts = range(FILE_HEADER_SIZE, raw.header_length - CHECKSUM_SIZE, LAYER_SUMMARY_SIZE)
    found = (LAYER_SUMMARY.parse(data[start:]) for start in starts)
    layers = (
        LayerSummary(row.anchor_count, row.gaussian_count, row.byte_count, row.end_offset, tuple(row.stream_bytes))
        for row in found
    )
    return Header(
        fields,
        raw.header_length,
        raw.file_length,
        raw.page_bits,
        raw.tile_count,
        raw.root_length,
        raw.anchor_count,
        raw.gaussian_count,
        raw.root_crc32,
        tuple(layers),
    )


def read_header(source: ByteSource, *, limits: Limits = DEFAULT_LIMITS, allow_truncated: bool = False) -> Header:
    """The checked header of a file: one read of at most 2280 bytes, whatever the file's size.

    Args:
        allow_truncated: accept a source that ends before file_length (but not inside the header).

    Raises:
        Malformed, Truncated, Unsupported, LimitExceeded: as SPEC §12 lists for the header.
    """
    head = source.read(0, min(source.size, header_length(MAX_LAYERS)))
    _check_signature(head)
    data = _check_header_bytes(head)
    raw = FILE_HEADER.parse(data)
    _check_fields(raw)
    _check_limits(raw, limits)
    header = _header_from(raw, data)
    _check_layers(header)
    if source.size > header.file_length:
        message = f"{source.size - header.file_length} bytes follow the file"
        raise Malformed("trailing-bytes", message, offset=header.file_length)
    if source.size < header.file_length and not allow_truncated:
        message = f"the file is incomplete: {source.size:,} of {header.file_length:,} bytes"
        raise Truncated("truncated-file", message, offset=source.size)
    return header
