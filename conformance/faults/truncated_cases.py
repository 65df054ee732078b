"""Files that an editor cuts to fewer layers (SPEC §14), and files whose end did not arrive (§5.1-§5.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from conformance.faults.limit_faults import long_last_block
from conformance.scenes.cases import Case
from conformance.scenes.container_scenes import paged_file
from conformance.scenes.valid_cases import vector_id
from conformance.spec.spec_text import size_of
from conformance.surgery.parts import Parts, change_rows, remake, take_apart
from scarfmt.coding.writer import QuantisedScene

# Among them files cut where the index network is there, but not the residual codebook that one of its heads is for.
_CUTS: tuple[tuple[str, tuple[int, ...]], ...] = (
    ("explicit-refined", (1, 2)),
    ("one-symbol", (1,)),
    ("fifteen-classes", (1,)),
    ("sixteen-layers", (1, 3, 15)),
    ("twenty-steps", (1,)),
    ("anchors", (1,)),
    ("anchors-32-slots", (1, 2)),
    ("annotations", (1, 2)),
    ("pages", (1, 2)),
    ("pages-neural", (1, 2)),
    ("streaming", (1,)),
    ("predictors", (1, 2)),
    ("predictors-deep", (2,)),
    ("index-plain", (1,)),
    ("index-deep", (1, 2)),
    ("index-attention", (1,)),
    ("index-grid", (1,)),
    ("index-edge", (1,)),
    ("index-modes", (1, 3)),
    ("anchors-neural", (1,)),
)
_KNOWN = frozenset({*range(1, 9), 16, 64})
_SAFE_TO_COPY = 2
_LAYER, _PRIVATE = 1, 200


def truncated_cases(files: Mapping[str, tuple[bytes, QuantisedScene]]) -> Iterator[Case]:
    """Editor's cuts of valid vectors, and cuts at every place of a file.

    Args:
        files: valid vectors by name, with their scenes.
    """
    for name, numbers in _CUTS:
        whole, scene = files[name]
        for layers in numbers:
            purpose = f"{name} truncated to layer {layers}: equals what an editor makes of it (SPEC §14)"
            yield Case(f"truncated/{name}-{layers}", purpose, cut_to_layers(whole, layers), ("R-14-1", "R-14-2"),
                       scene=scene, layers=layers, origin=vector_id(name))
    yield from _later_faults(*files["explicit-refined"])
    yield from _short_files(paged_file())


def _later_faults(data: bytes, scene: QuantisedScene) -> Iterator[Case]:
    """Files whose third layer cannot be decoded, and whose first two are as good as ever."""
    absent = remake(data, lambda p: p.remove(p.row(_LAYER, 3)))
    damaged = change_rows(data, lambda p: [entry.update(crc32=0) for entry in p.entries if entry["layer"] == 3])
    for name, purpose, rule, file in (
        ("absent", "no LAYER block in layer 3: a decoder to layer 2 needs none", "R-6.5-1", absent),
        ("damaged", "every block of layer 3 has a wrong CRC: a decoder to layer 2 has no need of them", "R-12.3-2",
         damaged),
    ):
        yield Case(f"edge/later-layer-{name}", purpose, file, (rule, "R-12.2-2"), scene=scene, layers=2)


def cut_to_layers(data: bytes, layers: int) -> bytes:
    """SPEC §14, steps 2 and 3."""
    parts = take_apart(data)
    kept = [
        number for number, entry in enumerate(parts.entries)
        if entry["layer"] <= layers
        and (layers == len(parts.layers) or entry["kind"] in _KNOWN or entry["flags"] & _SAFE_TO_COPY)
    ]
    cut = Parts(parts.header, parts.layers[:layers], parts.tiles, [parts.entries[n] for n in kept],
                [parts.blocks[n] for n in kept], parts.page_bits)
    cut.settle()
    return cut.seal()


def _short_files(data: bytes) -> Iterator[Case]:
    for name, length, purpose in _places(take_apart(data)):
        rule = "R-5.1-1" if length < 9 else "R-5.2-1" if length < 16 else "R-5.2-3"
        refusal = "truncated-header"
        if length >= take_apart(data).header["header_length"]:
            rule, refusal = "R-5.3-8", "truncated-file"
        yield _cut(name, f"the file ends {purpose}", data[:length], rule, refusal)
    yield _cut("in-other-version", "ten bytes of a file of another major version: without `minor`, nothing is compared",
               data[:9] + b"\5", "R-5.2-1", "truncated-header")
    large = long_last_block(data, 1 << 40, kind=_PRIVATE, layer=2)
    yield _cut("of-1-tib", "a file of 1 TiB of which little arrived", large.seal(), "R-5.3-8", "truncated-file")


def _cut(name: str, purpose: str, data: bytes, rule: str, refusal: str) -> Case:
    return Case(f"truncated/cut-{name}", purpose, data, (rule,), refusals=(refusal,), stage="container")


def _places(parts: Parts) -> Iterator[tuple[str, int, str]]:
    """Name, length and words for it."""
    header = parts.header["header_length"]
    root = header + parts.root_length
    first = parts.entries[0]["offset"]
    layer = parts.layers[0]["end_offset"]
    yield "empty", 0, "before it starts"
    yield "one-byte", 1, "after one byte"
    yield "in-signature", 5, "inside the signature"
    yield "after-signature", 9, "after the signature"
    yield "in-version", 10, "inside the version"
    yield "in-header-length", 15, "inside header_length"
    yield "after-header-length", 16, "after header_length"
    yield "in-header", size_of("FILE_HEADER") - 1, "one byte before the first layer summary"
    yield "in-summary", size_of("FILE_HEADER") + size_of("LAYER_SUMMARY") + 50, "inside a layer summary"
    yield "before-header-end", header - 1, "one byte before the end of the header"
    yield "header", header, "after the header"
    yield "in-root", header + 1, "inside ROOT"
    yield "root", root, "after ROOT"
    yield "in-tile-page", root + 7, "inside a tile page"
    yield "in-row-page", first - 3, "inside the last row page"
    yield "before-blocks", first - 1, "one byte before the first block"
    yield "pages", first, "after the last page"
    yield "in-block", first + 9, "inside the first block"
    yield "before-layer-1", layer - 1, "one byte before the end of layer 1"
    yield "layer-1", layer, "after layer 1: those of a decoder that was not told to take what there is are refused"
    yield "past-layer-1", layer + 1, "one byte after the end of layer 1"
    yield "before-end", parts.header["file_length"] - 1, "one byte early"
