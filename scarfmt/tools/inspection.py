"""The report about a file from its header alone (SPEC §5.2, §5.3): counts, layers, and bytes of each kind of data.

One read of at most 2280 bytes answers, whatever the file's size; only METADATA needs ROOT.
"""

from __future__ import annotations

import json
from typing import Any

from scarfmt.blocks.metadata import read_metadata
from scarfmt.container.file import Container, Header
from scarfmt.container.schema import VERSION, BlockKind, Profile, Stream
from scarfmt.container.source import ByteSource
from scarfmt.errors import Malformed, plural, printable
from scarfmt.limits import DEFAULT_LIMITS, MAX_THUMBNAIL, Limits

_UNITS = {Profile.EXPLICIT: "Gaussian", Profile.ANCHOR: "anchor"}


def inspect(source: ByteSource, *, metadata: bool = False, limits: Limits = DEFAULT_LIMITS) -> dict[str, Any]:
    """A JSON-able description of a file, whole or cut short.

    Args:
        metadata: also read the METADATA block, as key ``metadata``; None where there is none or it is cut off. And say
            how large the THUMBNAIL block is, as key ``thumbnail_bytes``.

    Returns:
        Counts and byte sizes as ints; ``layers`` lists the layers in order, ``bytes`` their own size,
        ``end_offset`` the size of the file up to and including them, ``streams`` their bytes per stream kind.

    Raises:
        Malformed, Truncated, Unsupported, LimitExceeded: when the header, or what `metadata` needs, is refused.
    """
    container = Container(source, limits=limits, allow_truncated=True)
    header = container.header
    report: dict[str, Any] = {
        "format": "scar",
        "version": ".".join(map(str, VERSION)),
        "profile": header.fields.profile.name.lower(),
        "sh_degree": header.fields.sh_degree,
        "slots": header.fields.slots,
        "anchors": header.anchor_count,
        "gaussians": header.gaussian_count,
        "source_count": header.fields.source_count,
        "file_bytes": header.file_length,
        "bytes_present": source.size,
        "complete": source.size == header.file_length,
        "layer_count": header.layer_count,
        "layers_available": container.available_layers,
        "front_bytes": header.data_offset,
        "root_bytes": header.root_length,
        "tiles": header.tile_count,
        "pages": header.page_count,
        "page_bits": header.page_bits,
        "bytes_per_anchor": _ratio(header.file_length, header.anchor_count),
        "lattice_bits": header.fields.lattice_bits,
        "origin": list(header.fields.origin),
        "voxel": header.fields.voxel,
        "coordinate_frame": header.fields.coordinate_frame.name.lower(),
        "colour_space": header.fields.colour_space.name.lower(),
        "render_model": header.fields.render_model.name.lower(),
        "layers": _layers(header),
    }
    if metadata:
        report["metadata"] = read_metadata(container)
        thumbnail = container.find(BlockKind.THUMBNAIL, 1)
        report["thumbnail_bytes"] = thumbnail.length if thumbnail else 0
    return report


def _ratio(size: int, count: int) -> float | None:
    return size / count if count else None


def _layers(header: Header) -> list[dict[str, Any]]:
    rows, anchors, gaussians = [], 0, 0
    for number, layer in enumerate(header.layers, start=1):
        rows.append(
            {
                "layer": number,
                "anchors": layer.anchor_count,
                "gaussians": layer.gaussian_count,
                "new_anchors": layer.anchor_count - anchors,
                "new_gaussians": layer.gaussian_count - gaussians,
                "bytes": layer.byte_count,
                "end_offset": layer.end_offset,
                "bytes_per_anchor": _ratio(layer.end_offset, layer.anchor_count),
                "streams": {kind.name.lower(): layer.stream_bytes[kind] for kind in Stream},
            }
        )
        anchors, gaussians = layer.anchor_count, layer.gaussian_count
    return rows


def read_thumbnail(container: Container) -> bytes | None:
    """The small picture of a scene: a WebP, PNG or JPEG file. None where there is none, or a cut source ends before it.

    Raises:
        Malformed: ``entry-length``: it is larger than R-7.15-1 allows; ``block-crc``: it is damaged.
    """
    entry = container.find(BlockKind.THUMBNAIL, 1)
    if entry is None or not container.is_available(entry):
        return None
    if entry.length > MAX_THUMBNAIL:
        message = f"{entry.length} bytes: a thumbnail has at most {MAX_THUMBNAIL} (SPEC §7.15)"
        raise Malformed("entry-length", message, offset=entry.offset, field="THUMBNAIL")
    return container.read_block(entry)


def format_text(report: dict[str, Any]) -> str:
    """The description made by :func:`inspect` as a table for people, ending in a line break."""
    lines = [f"{name:<17} {value}" for name, value in _facts(report)]
    lines += ["", *columns(_layer_table(report))]
    if report.get("metadata") is not None:
        text = json.dumps(report["metadata"], indent=2, ensure_ascii=False)
        lines += ["", "metadata", *(printable(line, len(line)) for line in text.split("\n"))]
    return "\n".join(lines) + "\n"


def _facts(report: dict[str, Any]) -> list[tuple[str, str]]:
    unit = _UNITS[Profile[report["profile"].upper()]]
    size = f"{report['file_bytes']:,} bytes"
    if report["anchors"]:
        size += f", {report['bytes_per_anchor']:.2f} per {unit}"
    counts = f"{report['gaussians']:,} from an input of {report['source_count']:,} {unit}s"
    if report["profile"] == "anchor":
        counts = f"up to {report['gaussians']:,} on {report['anchors']:,} anchors of {report['slots']} slots"
    facts = [
        ("format", f"scar {report['version']}, {report['profile']} profile"),
        ("size", size),
        ("Gaussians", counts),
        ("SH degree", str(report["sh_degree"])),
        ("lattice", f"{report['lattice_bits']} bits per axis, step {report['voxel']:.6g}"),
        ("coordinate frame", report["coordinate_frame"]),
        ("colour space", report["colour_space"]),
        ("render model", report["render_model"]),
        (
            "structure",
            f"{plural(report['tiles'], 'tile')} in {plural(report['pages'], 'page')},"
            f" {report['front_bytes']:,} bytes in front, {report['root_bytes']:,} of them ROOT",
        ),
    ]
    if report.get("thumbnail_bytes"):
        facts.append(("thumbnail", f"{report['thumbnail_bytes']:,} bytes"))
    if not report["complete"]:
        missing = f"{report['bytes_present']:,} bytes arrived, {plural(report['layers_available'], 'whole layer')}"
        facts.append(("cut short", missing))
    return facts


def _layer_table(report: dict[str, Any]) -> list[list[str]]:
    layers = report["layers"]
    used = [name for name in layers[0]["streams"] if any(layer["streams"][name] for layer in layers)]
    rows = [["layer", "anchors", "gaussians", "bytes", "total bytes", *(name.replace("_", " ") for name in used)]]
    for layer in layers:
        numbers = [layer[key] for key in ("layer", "anchors", "gaussians", "bytes", "end_offset")]
        rows.append([f"{number:,}" for number in numbers + [layer["streams"][name] for name in used]])
    return rows


def columns(rows: list[list[str]]) -> list[str]:
    """The lines of a table, cells to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
