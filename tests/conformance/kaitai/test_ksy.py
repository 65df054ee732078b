"""The Kaitai description of the container agrees with the reference reader on every vector."""

import hashlib
import json
from pathlib import Path

import pytest
from kaitaistruct import KaitaiStructError

import conformance
from conformance.kaitai.kaitai_scar import Scar
from scarfmt.blocks.layer import unpack_layer
from scarfmt.blocks.streaming import unpack_streaming
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import BytesSource
from scarfmt.container.substreams import unpack_table
from scarfmt.errors import ScarError
from scarfmt.limits import FORMAT_LIMITS
from scarfmt.scene.model import DecodedContext

SUITE = Path(conformance.__file__).parent
VECTORS = sorted(path.parent for path in (SUITE / "vectors").glob("**/expect.json"))
EXPRESSED = {
    "bad-signature", "damaged-signature", "unsupported-version", "bad-header-length", "bad-file-length", "bad-profile",
    "bad-sh-degree", "bad-layer-count", "bad-slots", "bad-lattice-bits", "bad-coordinate-frame", "bad-colour-space",
    "bad-page-bits", "bad-source-count", "tile-depth", "tile-shift", "entry-kind", "truncated-header",
    "truncated-directory", "limit-tiles",
}  # fmt: skip
"""Refusals whose rules the description holds, all of them or nearly."""
PARTLY = {"bad-file-length", "bad-signature", "damaged-signature"}
"""Refusals of `EXPRESSED` that are also given for relations between fields, which the description lacks."""


def _names(folder):
    return str(folder.relative_to(SUITE / "vectors"))


def _file(folder):
    expect = json.loads((folder / "expect.json").read_text())
    return (folder / "input.scar").read_bytes(), expect


def test_the_compiled_parser_is_that_of_the_description():
    digest = hashlib.sha256((SUITE / "kaitai" / "scar.ksy").read_bytes()).hexdigest()
    compiled = (SUITE / "kaitai" / "kaitai_scar.py").read_text()
    assert digest in compiled.splitlines()[0], "conformance/kaitai/scar.ksy was changed: run `make ksy`"


def _value(number):
    return getattr(number, "value", number)


def _check_front(parsed, container):
    fields, header = container.header.fields, parsed.header
    assert header.header_length == container.header.header_length
    assert header.file_length == container.header.file_length
    assert (_value(header.profile), header.sh_degree, header.slots) == (fields.profile, fields.sh_degree, fields.slots)
    assert (header.lattice_bits, tuple(header.origin), header.voxel) == (
        fields.lattice_bits, fields.origin, fields.voxel,
    )  # fmt: skip
    assert header.source_count == fields.source_count
    assert [
        (row.anchor_count, row.gaussian_count, row.byte_count, row.end_offset, tuple(row.stream_bytes))
        for row in parsed.layers
    ] == [
        (row.anchor_count, row.gaussian_count, row.byte_count, row.end_offset, tuple(row.stream_bytes))
        for row in container.header.layers
    ]
    assert [(t.depth, t.shift, t.prefix) for page in parsed.tile_pages for t in page.tiles] == [
        (t.depth, t.shift, t.prefix) for t in container.tiles
    ]
    models = [(k, row) for k, layer in enumerate(parsed.root.layers, start=1) for row in layer.entries]
    assert [(_value(e.kind), e.flags, layer, e.length.value, e.count.value, e.crc32) for layer, e in models] == [
        (e.kind, e.flags, e.layer, e.length, e.count, e.crc32)
        for e in container.entries if e.kind != BlockKind.TILE
    ]


def _lengths(parsed):
    """Layer, tile and length of every TILE block that the row pages list."""
    for layer, pages in enumerate(parsed.row_pages, start=1):
        for number, page in enumerate(pages.pages):
            for place, length in enumerate(page.rows.lengths if hasattr(page, "rows") else []):
                if length.value:
                    yield layer, number * parsed.page_size + place, length.value


def _bodies(layer):
    """The blocks of a layer in file order."""
    yield from (placed.body for placed in layer.models if hasattr(placed, "body"))
    yield from (placed.body for page in layer.tiles for placed in page.blocks if placed.length)
    yield from (placed.body for placed in layer.annotations if hasattr(placed, "body"))


def _check_bodies(parsed, container, layers):
    """The blocks of the first `layers` layers; later ones may be damaged on purpose."""
    opening = ((), DecodedContext())
    kept = [entry for entry in container.entries if entry.layer <= layers]
    bodies = [body for layer in parsed.layers[:layers] for body in _bodies(layer.blocks)]
    for theirs, entry in zip(bodies, kept, strict=True):
        block = container.read_block(entry)
        if entry.kind == BlockKind.TILE:
            ours = {int(kind): (part.length, part.crc32) for kind, part in unpack_table(block, len(block)).items()}
            assert {_value(r.stream): (r.length, r.crc32) for r in theirs.records} == ours
            assert sum(4 * len(stream.words) for stream in theirs.substreams) == sum(n for n, _ in ours.values())
        elif entry.kind == BlockKind.LAYER:
            row, opening = unpack_layer(block, layer=entry.layer, opening=opening)
            body = theirs
            assert [(c.stages, tuple(c.steps)) for c in body.classes] == list(zip(row.stages, row.steps, strict=True))
            if entry.layer == 1:
                lows = [[rule.low.signed_value for rule in channel.rules] for channel in body.channels]
                assert lows == [[rule.low for rule in channel.rules] for channel in opening[0]]
        elif entry.kind == BlockKind.STREAMING:
            told, body = unpack_streaming(block), theirs
            assert (body.layer_count, body.tile_count.value) == (told.layers, told.tiles)
            assert body.viewpoints == told.viewpoints.ravel().tolist()
            assert (body.view[-1] if body.view else None) == (told.view.fov if told.view else None)
            assert [body.low, body.high, body.reach, body.gains] == [
                part.tobytes() for part in (told.low, told.high, told.reach, told.gains)
            ]
        elif entry.kind == BlockKind.HASH_GRID:
            assert len(theirs.levels) == len(theirs.streams) == entry.count
        else:
            assert theirs.bytes == block


@pytest.mark.parametrize("folder", VECTORS, ids=_names)
def test_kaitai_and_the_reference_reader_agree(folder):
    data, expect = _file(folder)
    try:
        container = Container.open(BytesSource(data), limits=FORMAT_LIMITS).load()
    except ScarError as error:
        container = None
        opened = error.refusal
    if container is None:
        if opened in EXPRESSED - PARTLY:
            with pytest.raises((KaitaiStructError, EOFError)):
                Scar.from_bytes(data)
        return
    parsed = Scar.from_bytes(data)
    _check_front(parsed, container)
    tiles = [(e.layer, e.tile, e.length) for e in container.entries if e.kind == BlockKind.TILE]
    assert list(_lengths(parsed)) == tiles
    if expect["result"] == "decoded":
        _check_bodies(parsed, container, expect["layers"][-1]["layer"])
