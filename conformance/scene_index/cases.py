"""Writes the indices in `valid` and `invalid`: ``python -m conformance.scene_index.cases``.

The name of an invalid one begins with its refusal id; two hyphens follow. The files that are listed do not exist.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
Document = dict[str, Any]

FILE: Document = {
    "uri": "part.scar",
    "length": 9000,
    "header_crc32": 3735928559,
    "profile": "EXPLICIT",
    "sh_degree": 3,
    "slots": 1,
    "box": [[-1.5, 0, 2], [4, 0.25, 1e3]],
    "layers": [
        {"end": 1000, "anchors": 10, "gaussians": 10},
        {"end": 9000, "anchors": 25, "gaussians": 25},
    ],
}
TURNED = [[0, -2, 0, 5], [2, 0, 0, -1e6], [0, 0, 2, 0.5], [0, 0, 0, 1]]


def index(*files: Document, **members: Any) -> Document:
    """An index of files."""
    head = {"format": "scar-scene", "version": 1, "coordinate_frame": "RDF", "colour_space": "SRGB"}
    return {**head, **members, "files": list(files or (FILE,))}


def _with(**members: Any) -> Document:
    return index({**FILE, **members})


def _without(name: str) -> Document:
    return index({key: value for key, value in FILE.items() if key != name})


def _changed(change: Callable[[Document], object]) -> Document:
    document = deepcopy(index())
    change(document)
    return document


def _layers(*rows: tuple[int, int, int]) -> Document:
    return _with(layers=[dict(zip(("end", "anchors", "gaussians"), row, strict=True)) for row in rows])


def _anchor(uri: str) -> Document:
    layer = {"end": 9000, "anchors": 10, "gaussians": 77}
    return {**FILE, "uri": uri, "profile": "ANCHOR", "sh_degree": 0, "slots": 10, "layers": [layer]}


def valid() -> dict[str, bytes]:
    """By name."""
    documents = {
        "one-file": index(),
        "placed": _with(transform=TURNED),
        "several": index(FILE, {**FILE, "uri": "north/east.scar"}, _anchor("anchors.scar")),
        "unknown-members": index({**FILE, "comment": {"by": "someone"}}, generator="anything"),
        "whole-numbers-with-fraction": _with(length=9000.0, sh_degree=0.0),
        "names-of-other-languages": _with(uri="Häuser/家 (1).scar"),
        "single-precision-rotation": _with(
            transform=[[0.8660254, -0.5, 0, 0], [0.5, 0.8660254, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        ),
    }
    found = {name: _text(document) for name, document in documents.items()}
    twice = found["one-file"].replace(b'"version": 1', b'"version": 2, "version": 1')
    return {**found, "white-space-first": b"\r\n\t " + found["one-file"], "the-last-of-a-name-counts": twice}


def _documents() -> dict[str, Document]:
    escapes = ("../part.scar", "/part.scar", "a//b.scar", "a/./b.scar", "https://example.org/a.scar", "a\\b.scar")
    names = (*escapes, "", "a/", "a.scar?x", "a%2e.scar", "a\n.scar", "a./b.scar", "c:a.scar", "x" * 1025, 7)
    mirrored = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    sheared = [[1, 0.1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    return {
        "bad-scene--format": index(format="scar"),
        "unsupported-scene--version": index(version=2),
        "bad-scene--frame": index(coordinate_frame="rdf"),
        "bad-scene--colour-space": index(colour_space=1),
        "bad-scene--no-files": _changed(lambda one: one["files"].clear()),
        "bad-scene--files-are-no-list": _changed(lambda one: one.update(files={})),
        "bad-scene--file-is-no-object": _changed(lambda one: one.update(files=["part.scar"])),
        "bad-scene--same-file-twice": index(FILE, FILE),
        **{f"bad-scene--missing-{name.replace('_', '-')}": _without(name) for name in FILE},
        **{f"bad-scene--uri-{number}": _with(uri=uri) for number, uri in enumerate(names)},
        "bad-scene--length-fraction": _with(length=9000.5),
        "bad-scene--length-text": _with(length="9000"),
        "bad-scene--crc-negative": _with(header_crc32=-1),
        "bad-scene--degree-boolean": _with(sh_degree=True),
        "bad-scene--degree": _with(sh_degree=4),
        "bad-scene--slots": _with(slots=0),
        "bad-scene--box-upside-down": _with(box=[[0, 0, 0], [1, -1, 1]]),
        "bad-scene--box-of-two-numbers": _with(box=[[0, 0], [1, 1]]),
        "bad-scene--no-layers": _with(layers=[]),
        "bad-scene--layers-17": _layers(*[(9000, 1, 1)] * 17),
        "bad-scene--layers-end-elsewhere": _layers((8999, 10, 10)),
        "bad-scene--anchors-fall": _layers((1000, 10, 10), (9000, 9, 10)),
        "bad-scene--more-gaussians-than-slots": _layers((9000, 10, 11)),
        "bad-scene--transform-mirrors": _with(transform=mirrored),
        "bad-scene--transform-shears": _with(transform=sheared),
        "bad-scene--transform-flat": _with(transform=[[0] * 4, [0] * 4, [0] * 4, [0, 0, 0, 1]]),
        "bad-scene--transform-last-row": _with(transform=[*TURNED[:3], [0, 0, 0, 2]]),
        "bad-scene--transform-huge": _with(transform=[[1, 0, 0, 2**60], *TURNED[1:]]),
        "bad-scene--transform-null": _with(transform=None),
        "bad-scene--transform-flat-list": _with(transform=[1.0] * 16),
    }


def invalid() -> dict[str, bytes]:
    """By name."""
    text = _text(index())
    raw = {
        "bad-scene--not-json": text[:-3],
        "bad-scene--no-object": b"[" + text + b"]",
        "bad-scene--byte-order-mark": b"\xef\xbb\xbf" + text,
        "bad-scene--not-a-number": text.replace(b"9000", b"NaN"),
        "bad-scene--beyond-binary64": text.replace(b"1000.0", b"1e999"),
        "bad-scene--half-a-pair": text.replace(b"part.scar", b"\\ud800.scar"),
        "limit-scene--nested": _text(index(more=json.loads("[" * 8 + "]" * 8))),
    }
    return {**{name: _text(document) for name, document in _documents().items()}, **raw}


def _text(document: Document) -> bytes:
    return json.dumps(document).encode()


def main() -> None:
    """Write all of them, and nothing else."""
    for folder, cases in (("valid", valid()), ("invalid", invalid())):
        place = HERE / folder
        place.mkdir(exist_ok=True)
        for old in place.iterdir():
            old.unlink()
        for name, data in cases.items():
            (place / f"{name}.json").write_bytes(data)


if __name__ == "__main__":
    main()
