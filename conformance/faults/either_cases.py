"""Files that a decoder may take or refuse: (V) rules broken, and what SPEC.md leaves to the reader.

One that takes such a file must get the values of the sound one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from conformance.scenes.cases import Case, take
from conformance.scenes.container_scenes import anchor_file, anchor_scene, paged_file, plain_file, plain_scene
from conformance.surgery.edit import Changes, more, plus, replace_bytes
from conformance.surgery.files import change_block
from conformance.surgery.parts import block_added, change_rows, entry_with, remake, take_apart
from scarfmt.coding.writer import QuantisedScene

_METADATA = 64
_KINDS = {
    "layer": 1, "tables": 2, "codebooks": 3, "decoder-mlp": 4, "scene-mlp": 5, "hash-grid": 6, "entropy-network": 7,
    "predictors": 8,
}


def either_cases(files: Mapping[str, tuple[bytes, QuantisedScene]]) -> Iterator[Case]:
    """Cases of (V) rules, of short files, and of blocks that nobody needs.

    Args:
        files: valid vectors by name, with their scenes.
    """
    yield from _sum_cases()
    neural, scene = files["anchors-neural"]
    for name, kind in _KINDS.items():
        data = change_rows(neural, entry_with(kind, count=more))
        yield take(f"count-{name}", f"the directory counts one element too many in {name.upper()}", data, scene,
                     "R-5.4-19", "entry-count")
    yield from _short_cases()
    yield from _idle_block_cases()


def _sum_cases() -> Iterator[Case]:
    rows: tuple[tuple[str, str, str, str, Changes], ...] = (
        ("gaussians-less", "one Gaussian less than slots turned on", "R-5.3-9", "layer-counts", _gaussians(-1)),
        ("gaussians-more", "one Gaussian more than slots turned on", "R-5.3-9", "layer-counts", _gaussians(1)),
        ("stream-bytes", "four bytes of SCALE are counted as POSITIONS", "R-5.3-10", "layer-stream-bytes", _move(1)),
        ("stream-bytes-framing", "four bytes of SCALE are counted as framing", "R-5.3-10", "layer-stream-bytes",
         _move(12)),
    )
    for name, purpose, rule, refusal, changes in rows:
        base, scene = (plain_file(), plain_scene()) if "stream" in name else (anchor_file(), anchor_scene())
        yield take(name, purpose, change_rows(base, changes), scene, rule, refusal)


def _gaussians(by: int) -> Changes:
    return {"layers.-1.gaussian_count": plus(by), "header.gaussian_count": plus(by)}


def _move(target: int) -> Changes:
    return {"layers.0.stream_bytes.5": plus(-4), f"layers.0.stream_bytes.{target}": plus(4)}


def _short_cases() -> Iterator[Case]:
    data = paged_file()
    parts = take_apart(data)
    root, first = parts.header["header_length"] + parts.root_length, parts.entries[0]["offset"]
    for name, length, rule, refusal, purpose in (
        ("cut-in-root", root - 4, "R-5.4-1", "truncated-directory", "the file ends inside ROOT"),
        ("cut-in-pages", root + 2, "R-5.4-1", "truncated-directory", "the file ends inside the first tile page"),
        ("cut-in-first-block", first + 4, "R-5.3-8", "truncated-block", "the file ends inside its first block"),
    ):
        yield Case(f"either/{name}", f"{purpose}; the second id is that of a reader of incomplete files", data[:length],
                   (rule,), refusals=("truncated-file", refusal), stage="container")


def _idle_block_cases() -> Iterator[Case]:
    """Faults in blocks that no decoder has need of (R-5.6-3): one that looks at them all the same may refuse."""
    plain, silent = plain_file(), replace(plain_scene(), metadata={})
    yield take("metadata-not-json", "METADATA that is not JSON, which a decoder does not look at",
                 change_block(plain, _METADATA, 1, replace_bytes(b"{title: container}")), silent,
                 "R-7.10-1", "bad-metadata")
    yield take("metadata-crc", "METADATA with a wrong CRC",
                 change_rows(plain, entry_with(_METADATA, crc32=plus(-1))), plain_scene(), "R-5.6-1",
                 "crc-mismatch")
    annotated = remake(plain, block_added(b"annotation", kind=70, layer=2))
    yield take("annotation-crc", "an unknown block with a wrong CRC",
                 change_rows(annotated, {"entries.-1.crc32": more}), plain_scene(), "R-5.6-1", "crc-mismatch")
