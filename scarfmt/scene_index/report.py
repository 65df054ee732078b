"""The report of `scarfmt inspect` about a scene index, from the index alone."""

from __future__ import annotations

from typing import Any

from scarfmt.scene_index.document import VERSION, Index
from scarfmt.tools.inspection import columns

_MOST_SHOWN = 20
"""Files that people are shown."""


def describe(index: Index) -> dict[str, Any]:
    """A JSON-able description: counts over all files, layers of the scene, and each file with its box placed."""
    last = index.layer(index.layer_count)
    boxes = [file.box for file in index.files]
    return {
        "format": "scar-scene",
        "version": VERSION,
        "file_count": len(index.files),
        "profiles": sorted({file.profile.name.lower() for file in index.files}),
        "sh_degree": max(file.sh_degree for file in index.files),
        "anchors": last.anchors,
        "gaussians": last.gaussians,
        "file_bytes": last.end,
        "first_layer_bytes": index.layer(1).end,
        "layer_count": index.layer_count,
        "coordinate_frame": index.coordinate_frame.name.lower(),
        "colour_space": index.colour_space.name.lower(),
        "box": [
            [min(low[axis] for low, _ in boxes) for axis in range(3)],
            [max(high[axis] for _, high in boxes) for axis in range(3)],
        ],
        "layers": [{"layer": number, **vars(index.layer(number))} for number in range(1, index.layer_count + 1)],
        "files": [
            {
                "uri": file.uri,
                "bytes": file.length,
                "first_layer_bytes": file.layers[0].end,
                "layers": len(file.layers),
                "anchors": file.layers[-1].anchors,
                "gaussians": file.layers[-1].gaussians,
                "placed": file.transform is not None,
                "box": [low.tolist(), high.tolist()],
            }
            for file, (low, high) in zip(index.files, boxes, strict=True)
        ],
    }


def format_text(report: dict[str, Any]) -> str:
    """The description as a table for people, ending in a line break."""
    low, high = report["box"]
    facts = {
        "format": f"scar-scene {report['version']}, {report['file_count']:,} files, {' and '.join(report['profiles'])}",
        "size": f"{report['file_bytes']:,} bytes, first layers within {report['first_layer_bytes']:,}",
        "Gaussians": f"{report['gaussians']:,} on {report['anchors']:,} anchors",
        "SH degree": str(report["sh_degree"]),
        "coordinate frame": report["coordinate_frame"],
        "colour space": report["colour_space"],
        "box": " to ".join(", ".join(f"{x:.6g}" for x in corner) for corner in (low, high)),
    }
    layers = [["layer", "anchors", "gaussians", "total bytes"]]
    for layer in report["layers"]:
        layers.append([f"{layer[key]:,}" for key in ("layer", "anchors", "gaussians", "end")])
    files = [["layers", "gaussians", "bytes", "layer 1 within", "file"]]
    for file in report["files"][:_MOST_SHOWN]:
        numbers = [f"{file[key]:,}" for key in ("layers", "gaussians", "bytes", "first_layer_bytes")]
        files.append([*numbers, shown(file["uri"]) + (" (placed)" if file["placed"] else "")])
    lines = [f"{name:<17} {value}" for name, value in facts.items()]
    lines += ["", *columns(layers), "", *columns(files)]
    if len(report["files"]) > _MOST_SHOWN:
        lines.append(f"and {len(report['files']) - _MOST_SHOWN:,} more files")
    return "\n".join(lines) + "\n"


def shown(uri: str) -> str:
    """A name without characters that a terminal acts on."""
    return "".join(character if character.isprintable() else "?" for character in uri)
