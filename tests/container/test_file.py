"""The container: round trips, every refusal, damage and truncation."""

from __future__ import annotations

import dataclasses
import math
import struct
import zlib
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.container.file import Block, Container, HeaderFields, Tile, write_container
from scarfmt.container.schema import (
    SIGNATURE,
    BlockFlag,
    BlockKind,
    ColourSpace,
    CoordinateFrame,
    Profile,
    Stream,
    header_length,
)
from scarfmt.container.source import BytesSource
from scarfmt.errors import InvalidInput, LimitExceeded, Malformed, ScarError, Truncated, Unsupported
from scarfmt.limits import FORMAT_LIMITS, FREE_ANCHORS, FREE_SLOTS, Limits
from tests.samples.container_samples import (
    COUNTS,
    FIELDS,
    PRIVATE_SAFE,
    TILES,
    containers,
    edit,
    get,
    locate,
    refit,
    sample_blocks,
    sample_file,
)
from tests.samples.front_samples import Front


def read_all(data: bytes, limits: Limits = FORMAT_LIMITS) -> list[bytes]:
    """Every block of a file, verified."""
    container = Container.open(BytesSource(data), limits=limits).load()
    return [block for _, block in container.read_blocks(container.entries)]


def refusal_of(data: bytes, error: type[ScarError], **options: Limits) -> ScarError:
    with pytest.raises(error) as caught:
        read_all(data, **options)
    assert type(caught.value) is error
    return caught.value


# ------------------------------------------------------------------------------------------------ round trips


@settings(deadline=None)
@given(containers(), st.integers(0, 3), st.randoms())
def test_what_is_written_is_read_back(arguments: tuple, page_bits: int, random: object) -> None:
    """Header, tiles, directory and payloads survive, whatever the pages and the order of the blocks given."""
    fields, tiles, blocks, counts = arguments
    data = write_container(fields, tiles, blocks, counts, page_bits)
    shuffled = list(blocks)
    random.shuffle(shuffled)
    assert write_container(fields, tiles, shuffled, counts, page_bits) == data
    assert Front.of(data).bytes() == data
    container = Container.open(BytesSource(data), limits=FORMAT_LIMITS, readable_kinds=range(256))
    assert container.header.fields == fields
    assert list(container.tiles) == tiles
    assert [(s.anchor_count, s.gaussian_count) for s in container.header.layers] == counts
    assert container.header.file_length == len(data)
    assert len(container.entries) == len(blocks)
    for block in blocks:
        entry = container.find(block.kind, block.layer, block.tile)
        assert entry is not None
        assert (entry.count, container.read_block(entry)) == (block.count, block.payload)


def test_blocks_lie_back_to_back_in_directory_order() -> None:
    """The progressive order of SPEC §5.5: by layer, then kind, then tile, no holes."""
    data = sample_file()
    container = Container.open(BytesSource(data))
    assert read_all(data) == [block.payload for block in sample_blocks()]
    ends = [container.header.data_offset, *(entry.end for entry in container.entries)]
    assert [entry.offset for entry in container.entries] == ends[:-1]
    assert ends[-1] == len(data)


def test_summaries_count_bytes_per_layer_and_stream() -> None:
    """The counts are those that `inspect` prints: stream bytes, the rest of a tile as framing, all else as models."""
    first, second, _ = Container.open(BytesSource(sample_file())).header.layers
    assert first.byte_count == sum(len(b.payload) for b in sample_blocks() if b.layer == 1)
    assert first.stream_bytes[Stream.POSITIONS] == 7
    assert first.stream_bytes[Stream.FRAMING] == len(b"tile zero" + b"tile two") - 9
    assert first.stream_bytes[Stream.MODELS] == len(b'first layercodewords{"title": "sample"}')
    assert second.end_offset == first.end_offset + second.byte_count


def test_find_answers_none_for_absent_blocks() -> None:
    """Absent is not an error: a tile need not have a block in every layer."""
    container = Container.open(BytesSource(sample_file()))
    assert container.find(BlockKind.TILE, 1, 1) is None
    assert container.find(BlockKind.TILE, 3, 2) is None
    assert container.find(BlockKind.TILE, 3, 3) is None
    assert container.find(BlockKind.LAYER, 3, 1) is None
    assert container.find(PRIVATE_SAFE, 3).count == 4


def test_opening_reads_the_header_and_the_directory_reads_itself() -> None:
    """The container is lazy: two reads bring everything but blocks; neighbours share a request."""
    source = BytesSource(sample_file())
    container = Container.open(source)
    assert source.reads == 1
    _ = container.tiles, container.entries
    assert source.reads == 2
    first_layer = [entry for entry in container.entries if entry.layer == 1]
    assert len(dict(container.read_blocks(first_layer))) == 5
    assert source.reads == 3
    scattered = [container.entries[0], container.entries[2], container.entries[3]]
    assert [e for e, _ in container.read_blocks(scattered)] == scattered
    assert source.reads == 5


def test_block_ranges_are_checked() -> None:
    """A sub-stream offset from an untrusted block cannot reach outside it."""
    container = Container.open(BytesSource(sample_file()))
    entry = container.entries[0]
    assert container.read_range(entry, 6, 5) == b"layer"
    for start, length in ((0, 12), (-1, 2), (5, -1), (12, 0)):
        with pytest.raises(Malformed) as caught:
            container.read_range(entry, start, length)
        assert caught.value.refusal == "block-range"


# --------------------------------------------------------------------------------------------------- refusals

BASE = sample_file(page_bits=1)
H, L = "FILE_HEADER", "LAYER_SUMMARY"
CUBE = 8**20
"""Morton codes in a cube of depth 1."""

FIELD_CASES = [
    (H, 0, "version_reserved", 1, "bad-reserved"),
    (H, 0, "file_length", 1 << 53, "bad-file-length"),
    (H, 0, "file_length", len(BASE) - 1, "bad-file-length"),
    (H, 0, "profile", 2, "bad-profile"),
    (H, 0, "sh_degree", 4, "bad-sh-degree"),
    (H, 0, "layer_count", 2, "bad-layer-count"),
    (H, 0, "slots", 0, "bad-slots"),
    (H, 0, "slots", 2, "bad-slots"),
    (H, 0, "lattice_bits", 0, "bad-lattice-bits"),
    (H, 0, "lattice_bits", 33, "bad-lattice-bits"),
    (H, 0, "coordinate_frame", 3, "bad-coordinate-frame"),
    (H, 0, "colour_space", 3, "bad-colour-space"),
    (H, 0, "page_bits", 17, "bad-page-bits"),
    (H, 0, "origin", math.nan, "bad-origin"),
    (H, 0, "origin", math.inf, "bad-origin"),
    (H, 0, "voxel", 0.0, "bad-voxel"),
    (H, 0, "voxel", -1.0, "bad-voxel"),
    (H, 0, "voxel", math.inf, "bad-voxel"),
    (H, 0, "voxel", math.nan, "bad-voxel"),
    (H, 0, "voxel", 2.0**999, "bad-voxel"),
    (H, 0, "source_count", 1 << 53, "bad-source-count"),
    (H, 0, "anchor_count", 99, "layer-counts"),
    (H, 0, "gaussian_count", 99, "layer-counts"),
    (L, 1, "anchor_count", 9, "layer-counts"),
    (L, 1, "gaussian_count", 9, "layer-counts"),
    (L, 1, "gaussian_count", 24, "layer-counts"),
    (L, 1, "gaussian_count", 26, "layer-counts"),
    (L, 1, "byte_count", 7, "layer-bytes"),
    (L, 1, "stream_bytes", 7, "layer-bytes"),
    (L, 1, "end_offset", 7, "layer-offset"),
    (H, 0, "root_length", len(BASE), "layer-offset"),
    (H, 0, "root_crc32", 1, "directory-crc-mismatch"),
]

@pytest.mark.parametrize(("table", "row", "name", "value", "refusal"), FIELD_CASES)
def test_one_broken_rule_gives_its_refusal(table: str, row: int, name: str, value: float, refusal: str) -> None:
    """With checksums made right, each rule of the header is caught by itself, at the field that breaks it."""
    broken = bytearray(edit(BASE, table, row, name, value))
    if name == "root_crc32":
        broken[96:100] = b"\1\0\0\0"
        broken = reheaded(broken)
    error = refusal_of(bytes(broken), Malformed)
    assert error.refusal == refusal
    assert error.offset is not None
    assert error.field is not None


def reheaded(data: bytearray) -> bytearray:
    """`data` with the checksum of its header made right, and no other."""
    end = int.from_bytes(data[12:16], "little") - 4
    data[end : end + 4] = zlib.crc32(data[:end]).to_bytes(4, "little")
    return data


Changes = list[tuple[tuple[str | int, ...], object]]

ROOT_CASES: list[tuple[Changes, str]] = [
    ([(("after_root",), b"\0")], "payload-long"),
    ([(("models", 2, 1, "kind"), 0)], "entry-kind"),
    ([(("models", 2, 1, "kind"), 16)], "entry-kind"),
    ([(("models", 0, 0, "flags"), 0)], "entry-flags"),
    ([(("models", 0, 2, "flags"), 0)], "entry-flags"),
    ([(("models", 0, 2, "flags"), 1)], "entry-flags"),
    ([(("models", 2, 1, "flags"), 3)], "entry-flags"),
    ([(("models", 2, 1, "flags"), 4)], "entry-flags"),
    ([(("models", 2, 1, "kind"), 64)], "entry-layer"),
    ([(("models", 0, 1, "kind"), 1)], "entry-order"),
    ([(("models", 0, 1, "length"), 0)], "entry-length"),
    ([(("models", 0, 1, "length"), 1 << 50)], "entry-length"),
    ([(("models", 0, 2, "count"), 1)], "entry-count"),
    ([(("pages", 1, "base_gap"), 0)], "tile-order"),
    ([(("pages", 0, "base_gap"), 2**63 - 1)], "tile-order"),
    ([(("pages", 0, "tile_bytes"), 5)], "page-length"),
    ([(("pages", 0, "tile_bytes"), 23)], "page-length"),
    ([(("pages", 1, "tile_bytes"), 12)], "page-length"),
    ([(("pages", 0, "rows", 0, "row_bytes"), 6)], "page-length"),
    ([(("pages", 0, "rows", 0, "row_bytes"), 35)], "page-length"),
    ([(("pages", 1, "rows", 0, "row_bytes"), 18)], "page-length"),
    ([(("pages", 0, "rows", 0, "block_bytes"), 0)], "page-sums"),
    ([(("pages", 0, "rows", 0, "block_bytes"), 8)], "layer-directory-bytes"),
    ([(("pages", 0, "rows", 0, "block_bytes"), 2**53 - 1)], "layer-directory-bytes"),
    ([(("models", 2, 1, "length"), 8)], "layer-directory-bytes"),
    ([(("pages", 0, "rows", 0, "anchors"), 8)], "layer-directory-anchors"),
    ([(("pages", 0, "rows", 1, "anchors"), 2**53 - 1)], "layer-directory-anchors"),
    ([(("pages", 0, "tile_bytes"), 7)], "directory-length"),
    ([(("pages", 0, "rows", 0, "row_bytes"), 8)], "directory-length"),
    ([(("before_blocks",), b"x")], "directory-length"),
]

PAGE_CASES: list[tuple[Changes, str]] = [
    ([(("pages", 0, "tile_crc32"), 1)], "page-crc-mismatch"),
    ([(("pages", 1, "rows", 0, "row_crc32"), 1)], "page-crc-mismatch"),
    ([(("after_page",), b"\0")], "payload-long"),
    ([(("pages", 0, "raw"), b"\1\2\2\3\x80\x80")], "payload-short"),
    ([(("pages", 0, "depth", 1), 22)], "tile-depth"),
    ([(("pages", 0, "shift", 1), 32)], "tile-shift"),
    ([(("pages", 0, "shift", 1), 0)], "tile-local-bits"),
    ([(("pages", 0, "shift", 1), 23)], "tile-local-bits"),
    ([(("pages", 0, "gap", 1), 56)], "tile-prefix"),
    ([(("pages", 0, "gap", 1), 2**63 - 1)], "tile-prefix"),
    ([(("pages", 0, "gap", 0), 1)], "tile-order"),
    ([(("pages", 0, "gap", 1), 32)], "tile-order"),
    ([(("pages", 1, "base_gap"), 5 * CUBE + 1)], "tile-order"),
    ([(("after_rows",), b"\0")], "payload-long"),
    ([(("pages", 0, "rows", 0, "lengths"), [9, 1]), (("pages", 0, "rows", 0, "block_bytes"), 9)], "payload-short"),
    ([(("pages", 0, "rows", 0, "lengths"), [8, 0]), (("pages", 0, "rows", 0, "block_bytes"), 9)], "page-sums"),
    ([(("pages", 0, "rows", 0, "counts"), [8]), (("pages", 0, "rows", 0, "anchors"), 7)], "page-sums"),
]


def changed(changes: Changes) -> bytes:
    """The base with some parts of its front replaced, lengths and checksums right."""
    front = Front.of(BASE)
    for path, value in changes:
        target: object = front
        for step in path[:-1]:
            target = target[step] if isinstance(step, int) else getattr(target, step)
        if isinstance(path[-1], int):
            target[path[-1]] = value
        else:
            setattr(target, path[-1], value)
    return front.bytes()


@pytest.mark.parametrize(("changes", "refusal"), ROOT_CASES + PAGE_CASES)
def test_one_broken_rule_of_the_directory_gives_its_refusal(changes: Changes, refusal: str) -> None:
    """With checksums made right, each rule of ROOT and pages is caught by itself."""
    error = refusal_of(changed(changes), Malformed)
    assert error.refusal == refusal
    assert error.offset is not None
    assert error.field is not None


@pytest.mark.parametrize(("table", "row", "name", "value"), [(H, 0, "origin", math.nan), (L, 1, "end_offset", 1)])
def test_errors_point_at_the_broken_field(table: str, row: int, name: str, value: float) -> None:
    """The reported offset is where a hex editor finds the fault."""
    error = refusal_of(edit(BASE, table, row, name, value), Malformed)
    assert error.offset == locate(table, row, name)[0]
    assert name in str(error.field)


@pytest.mark.parametrize(("changes", "refusal"), ROOT_CASES + PAGE_CASES)
def test_faults_of_the_directory_are_placed_in_the_structure_at_fault(changes: Changes, refusal: str) -> None:
    """In ROOT, in a page, or in the layer summary that disagrees (R-12.1-2)."""
    data = changed(changes)
    error = refusal_of(data, Malformed)
    header, root = get(data, H, 0, "header_length"), get(data, H, 0, "root_length")
    offset = error.offset if error.offset is not None else -1
    if refusal.startswith("layer-directory"):
        assert 100 <= offset < header
    elif (changes, refusal) in ROOT_CASES:
        assert header <= offset < header + root
    else:
        assert header + root <= offset < Container.open(BytesSource(data)).header.data_offset


@pytest.mark.parametrize(("layer", "number", "column", "value"), [(0, 0, "kind", 0), (2, 1, "flags", 3)])
def test_an_entry_at_fault_is_pointed_at(layer: int, number: int, column: str, value: int) -> None:
    """The offset is that of the entry: in a large scene the offset of ROOT is no help."""
    data = changed([(("models", layer, number, column), value)])
    error = refusal_of(data, Malformed)
    assert error.offset is not None
    # Kind, flags, and a byte each of length and count come before the checksum.
    crc32 = Front.of(BASE).models[layer][number].crc32
    assert int.from_bytes(data[error.offset + 4 : error.offset + 8], "little") == crc32
    assert error.field is not None
    assert error.field.endswith(column)


@pytest.mark.parametrize(
    ("table", "row", "name", "value", "limits", "refusal"),
    [
        (H, 0, "tile_count", (1 << 20) + 1, Limits(), "limit-tiles"),
        (H, 0, "root_length", (1 << 24) + 1, Limits(), "limit-root"),
        (H, 0, "anchor_count", (1 << 31) + 1, Limits(), "limit-anchors"),
        (H, 0, "gaussian_count", (1 << 36) + 1, Limits(), "limit-gaussians"),
        (H, 0, "anchor_count", FREE_ANCHORS + len(BASE) + 1, Limits(), "limit-expansion"),
        (H, 0, "anchor_count", FREE_ANCHORS + 1, Limits(anchors_per_byte=0), "limit-expansion"),
        (H, 0, "version_reserved", 0, Limits(block_bytes=18), "limit-block-bytes"),
        (H, 0, "version_reserved", 0, Limits(tile_anchors=74), "limit-tile-anchors"),
        (H, 0, "version_reserved", 0, Limits(anchors=99), "limit-anchors"),
        (H, 0, "version_reserved", 0, Limits(root_bytes=20), "limit-root"),
    ],
)
def test_limits_refuse_declared_numbers(
    table: str, row: int, name: str, value: int, limits: Limits, refusal: str
) -> None:
    """Declared numbers are compared with the reader's limits before anything is allocated from them."""
    assert refusal_of(edit(BASE, table, row, name, value), LimitExceeded, limits=limits).refusal == refusal


def test_slots_multiply_what_a_file_may_ask_for() -> None:
    """32 slots an anchor: a file of few bytes may have a thirty-second of the anchors."""
    fields = dataclasses.replace(FIELDS, profile=Profile.ANCHOR, sh_degree=0, slots=32)
    for anchors, refused in ((FREE_SLOTS // 32, False), (FREE_SLOTS // 32 + 1, True)):
        blocks = [Block(BlockKind.TILE, 1, b"tile", 0, anchors)]
        data = write_container(fields, TILES, blocks, [(anchors, 0)])
        limits = Limits(slots_per_byte=0)
        if refused:
            error = refusal_of(data, LimitExceeded, limits=limits)
            assert (error.refusal, error.field) == ("limit-expansion", "slots")
        else:
            assert len(read_all(data, limits)) == 1


def test_the_sample_passes_limits_it_just_meets() -> None:
    """Limits are inclusive."""
    root = get(BASE, H, 0, "root_length")
    limits = Limits(tiles=3, root_bytes=root, anchors=100, gaussians=100, tile_anchors=75, block_bytes=19)
    assert len(read_all(BASE, limits)) == 11


def test_blocks_of_tiles_keep_the_limit_of_blocks() -> None:
    """ROOT gives the sizes of models alone."""
    data = write_container(FIELDS, TILES, [Block(BlockKind.TILE, 1, bytes(40), 1, 5)], [(5, 5)])
    assert len(read_all(data, Limits(block_bytes=40))) == 1
    error = refusal_of(data, LimitExceeded, limits=Limits(block_bytes=39))
    page = Container.open(BytesSource(data)).root.rows[0]
    assert (error.refusal, error.offset) == ("limit-block-bytes", page["offset"])


def test_summary_and_directory_must_agree_on_model_bytes() -> None:
    """A byte moved between stream kinds keeps the sum but not the meaning."""
    models = get(BASE, L, 0, "stream_bytes", Stream.MODELS)
    broken = edit(BASE, L, 0, "stream_bytes", models - 1, Stream.MODELS)
    broken = edit(broken, L, 0, "stream_bytes", get(BASE, L, 0, "stream_bytes", Stream.FRAMING) + 1, Stream.FRAMING)
    assert refusal_of(broken, Malformed).refusal == "layer-directory-bytes"


def test_overlapping_cubes_of_different_depth_are_refused() -> None:
    """A cube inside another would hold the same places twice."""
    with pytest.raises(InvalidInput, match="tile-order"):
        write_container(FIELDS, [Tile(1, 2, 0), Tile(2, 3, 7)], [], [(0, 0)])


def test_the_deepest_last_cube_is_valid() -> None:
    """One past the last code of depth 21 is 2^63: no overflow in the order check."""
    tiles = [Tile(21, 0, 8**21 - 2), Tile(21, 0, 8**21 - 1)]
    data = write_container(FIELDS, tiles, [], [(0, 0)])
    assert list(Container.open(BytesSource(data)).tiles) == tiles


@pytest.mark.parametrize("kind", [9, 15, 17, 100, PRIVATE_SAFE])
def test_unknown_critical_blocks_refuse_the_file(kind: int) -> None:
    """A reader must not show a scene that it only partly understands."""
    block = Block(kind, 1, b"new", flags=BlockFlag.CRITICAL)
    data = write_container(FIELDS, TILES, [block], [(0, 0)])
    assert refusal_of(data, Unsupported).refusal == "unknown-critical-block"
    assert Container.open(BytesSource(data), readable_kinds={kind}).find(kind, 1) is not None


@pytest.mark.parametrize("kind", [17, 65, 128, 255])
def test_unknown_ancillary_blocks_are_no_obstacle(kind: int) -> None:
    """Annotations of newer writers are skipped."""
    data = write_container(FIELDS, TILES, [Block(kind, 1, b"note", flags=0)], [(0, 0)])
    assert read_all(data) == [b"note"]


@pytest.mark.parametrize(
    ("data", "refusal", "words"),
    [
        (b"ply\nformat binary_little_endian 1.0\n" + bytes(400), "bad-signature", "PLY"),
        (b"PK\x03\x04" + bytes(400), "bad-signature", "zip"),
        (bytes(500), "bad-signature", "00 00"),
        (BASE.replace(b"\r\n", b"\n"), "damaged-signature", "text mode"),
        (BASE.replace(b"\n", b"\r\n"), "damaged-signature", "binary mode"),
        (bytes(byte & 0x7F for byte in BASE), "damaged-signature", "high bit"),
        (BASE.decode("latin-1").encode("utf-8"), "damaged-signature", "text mode"),
    ],
)
def test_wrong_and_damaged_signatures_say_what_happened(data: bytes, refusal: str, words: str) -> None:
    """The first message a user sees names the likely cause."""
    error = refusal_of(data, Malformed)
    assert error.refusal == refusal
    assert words in error.message


@pytest.mark.parametrize("version", [(1, 0), (0, 1), (0, 3), (255, 255)])
def test_other_versions_are_unsupported_not_malformed(version: tuple[int, int]) -> None:
    """The fix is another reader; this comes before any look at the rest of the file."""
    data = SIGNATURE + bytes(version) + bytes(range(200))
    assert refusal_of(data, Unsupported).refusal == "unsupported-version"


@pytest.mark.parametrize("length", [0, 104, header_length(1) - 1, header_length(1) + 1, header_length(17), 0xFFFFFFFF])
def test_header_lengths_of_no_layer_count_are_refused(length: int) -> None:
    """The length is checked before it is used to find the header's checksum."""
    data = BASE[:12] + length.to_bytes(4, "little") + BASE[16:]
    assert refusal_of(data, Malformed).refusal == "bad-header-length"


def test_trailing_bytes_are_refused_even_when_truncation_is_allowed() -> None:
    """A file longer than it says is never right."""
    assert refusal_of(BASE + b"\0", Malformed).refusal == "trailing-bytes"
    with pytest.raises(Malformed) as caught:
        Container.open(BytesSource(BASE + b"\0"), allow_truncated=True)
    assert caught.value.refusal == "trailing-bytes"


def test_damage_is_named_by_the_checksum_that_covers_it() -> None:
    """Header, ROOT, pages and blocks have their own CRC-32, hence their own refusal."""
    container = Container.open(BytesSource(BASE))
    places = {
        "header-crc-mismatch": 40,
        "directory-crc-mismatch": container.header.header_length + 2,
        "page-crc-mismatch": container.header.data_offset - 1,
        "crc-mismatch": container.entries[5].offset,
    }
    for refusal, offset in places.items():
        damaged = bytearray(BASE)
        damaged[offset] ^= 0x10
        assert refusal_of(bytes(damaged), Malformed).refusal == refusal
    error = refusal_of(bytes(damaged), Malformed)
    assert (error.offset, error.field) == (container.entries[5].offset, "layer 2 LAYER")


def test_an_unverified_read_returns_damaged_bytes() -> None:
    """verify=False is for callers with their own check, such as a range read."""
    damaged = BASE[:-1] + bytes([BASE[-1] ^ 1])
    container = Container.open(BytesSource(damaged))
    assert container.read_block(container.entries[-1], verify=False) == damaged[-7:]


def test_every_single_bit_flip_is_detected() -> None:
    """No bit of a file can change unnoticed by a reader of the whole file."""
    data = sample_file(1)
    changed = bytearray(data)
    for bit in range(8 * len(data)):
        changed[bit // 8] ^= 1 << bit % 8
        with pytest.raises(ScarError):
            read_all(bytes(changed))
        changed[bit // 8] ^= 1 << bit % 8
    assert read_all(bytes(changed))


@settings(deadline=None, max_examples=300)
@given(st.data())
def test_any_bytes_with_right_checksums_give_a_result_or_a_refusal(data: st.DataObject) -> None:
    """Checksums do not protect against a hostile writer: no other exception, no large allocation."""
    end = Container.open(BytesSource(BASE)).header.data_offset
    changed = bytearray(BASE)
    for _ in range(data.draw(st.integers(1, 4))):
        offset = data.draw(st.integers(12, end - 1))
        piece = data.draw(st.sampled_from([b"\0", b"\xff", b"\xff" * 4, b"\0" * 8, b"\xff" * 8, b"\x7f", b"\x01"]))
        changed[offset : offset + len(piece)] = piece
    length, root = get(BASE, H, 0, "header_length"), get(BASE, H, 0, "root_length")
    try:
        blocks = read_all(refit(bytes(changed[: len(BASE)]), length, root))
    except ScarError:
        return
    assert blocks == [block.payload for block in sample_blocks()]


@settings(deadline=None, max_examples=300)
@given(st.data())
def test_any_page_with_a_right_checksum_gives_a_result_or_a_refusal(data: st.DataObject) -> None:
    """Faults behind the checksums of pages give a result or a refusal."""
    front = Front.of(BASE)
    for page in front.pages:
        for part in (page, *page.rows):
            if part is not None and data.draw(st.booleans()):
                piece = bytearray(part.data())
                at = data.draw(st.integers(0, len(piece) - 1))
                piece[at : at + 1] = data.draw(st.sampled_from([b"\0", b"\xff", b"\x80", b"\x01", b"\x7f", b""]))
                part.raw = bytes(piece)
    try:
        blocks = read_all(front.bytes())
    except ScarError:
        return
    assert blocks == [block.payload for block in sample_blocks()]


# ------------------------------------------------------------------------------------------------- truncation


def test_every_prefix_is_truncated_or_readable() -> None:
    """A cut file yields exactly its whole blocks; without permission it is refused as truncated."""
    full = Container.open(BytesSource(BASE)).load()
    for size in range(len(BASE)):
        source = BytesSource(BASE[:size])
        with pytest.raises(Truncated):
            Container.open(source)
        try:
            part = Container.open(source, allow_truncated=True).load()
        except Truncated:
            assert size < full.header.data_offset
            continue
        whole = [entry for entry in part.entries if part.is_available(entry)]
        assert [e for e in full.entries if e.end <= size] == whole
        assert [b for _, b in part.read_blocks(whole)] == [full.read_block(e) for e in whole]
        assert part.available_layers == sum(layer.end_offset <= size for layer in full.header.layers)
        with pytest.raises(Truncated) as caught:
            list(part.read_blocks(part.entries))
        assert caught.value.refusal == "truncated-block"


@pytest.mark.parametrize(
    ("size", "refusal"),
    [
        (0, "header"),
        (5, "header"),
        (10, "header"),
        (14, "header"),
        (header_length(3) - 1, "header"),
        (header_length(3), "file"),
    ],
)
def test_truncation_refusals_name_the_part(size: int, refusal: str) -> None:
    """A program can see whether waiting for more bytes would help."""
    assert refusal_of(BASE[:size], Truncated).refusal == f"truncated-{refusal}"


def test_a_cut_directory_is_refused_when_truncation_is_allowed() -> None:
    """The checksum of a truncated directory cannot be verified, so nothing after it can be trusted."""
    size = Container.open(BytesSource(BASE)).header.data_offset - 1
    with pytest.raises(Truncated) as caught:
        Container.open(BytesSource(BASE[:size]), allow_truncated=True).load()
    assert caught.value.refusal == "truncated-directory"


def test_declared_sizes_allocate_nothing() -> None:
    """A header of 2^20 tiles and 2^24 bytes of ROOT in 500 bytes is refused from the numbers alone."""
    header = edit(sample_file(1), H, 0, "tile_count", 1 << 20)
    header = bytearray(header[: header_length(1)])
    front = header_length(1) + (1 << 24) + 3 * (1 << 20)
    size = get(bytes(header), L, 0, "byte_count")
    header[16:24] = header[124:132] = (front + size).to_bytes(8, "little")
    header[36:40] = (1 << 24).to_bytes(4, "little")
    container = Container.open(BytesSource(bytes(reheaded(header))), allow_truncated=True)
    with pytest.raises(Truncated) as caught:
        container.load()
    assert caught.value.refusal == "truncated-directory"


# ---------------------------------------------------------------------------------------------------- writing


def test_pages_of_1024_tiles_are_written() -> None:
    """The default of the writer is what SPEC asks of encoders (R-5.4-18)."""
    assert Container.open(BytesSource(sample_file())).header.page_bits == 10


def _with(index: int, **changes: object) -> list[Block]:
    blocks = sample_blocks()
    blocks[index] = dataclasses.replace(blocks[index], **changes)
    return blocks


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda: write_container(FIELDS, TILES[::-1], sample_blocks(), COUNTS), "tile-order"),
        (lambda: write_container(FIELDS, TILES, sample_blocks() + sample_blocks()[:1], COUNTS), "entries ascend"),
        (lambda: write_container(FIELDS, TILES, sample_blocks() + sample_blocks()[2:3], COUNTS), "entries ascend"),
        (lambda: write_container(FIELDS, TILES, sample_blocks(), COUNTS, 17), "page"),
        (lambda: write_container(FIELDS, [Tile(22, 0, 0)], [], [(0, 0)]), "tile-depth"),
        (lambda: write_container(FIELDS, [Tile(1, 2, 8)], [], [(0, 0)]), "tile-prefix"),
        (lambda: write_container(FIELDS, TILES, _with(2, tile=None), COUNTS), "belong to a tile"),
        (lambda: write_container(FIELDS, TILES, _with(4, tile=0), COUNTS), "belong to a tile"),
        (lambda: write_container(FIELDS, TILES, _with(3, tile=3), COUNTS), "3 tiles"),
        (lambda: write_container(FIELDS, TILES, sample_blocks(), COUNTS[:2]), "block of layer 3 of 2"),
        (lambda: write_container(FIELDS, TILES, sample_blocks(), [(10, 10), (25, 25), (99, 99)]), "anchors"),
        (lambda: write_container(FIELDS, TILES, [], []), "a file has a layer"),
        (lambda: write_container(FIELDS, TILES, [], [(0, 0)] * 17), "bad-header-length"),
        (lambda: write_container(FIELDS, TILES, _with(0, payload=b""), COUNTS), "a byte or more"),
        (lambda: write_container(FIELDS, TILES, _with(0, kind=256), COUNTS), "does not fit"),
        (lambda: write_container(FIELDS, TILES, _with(2, count=1 << 32), COUNTS), "does not fit"),
        (lambda: write_container(FIELDS, TILES, _with(2, stream_bytes={1: 10}), COUNTS), "stream_bytes"),
        (lambda: write_container(FIELDS, TILES, _with(2, stream_bytes={0: 1}), COUNTS), "stream_bytes"),
        (lambda: write_container(FIELDS, TILES, _with(2, stream_bytes={len(Stream): 1}), COUNTS), "does not fit"),
        (lambda: write_container(dataclasses.replace(FIELDS, slots=300), TILES, [], [(0, 0)]), "does not fit"),
        (lambda: write_container(dataclasses.replace(FIELDS, voxel=0.0), TILES, [], [(0, 0)]), "bad-voxel"),
    ],
)
def test_the_writer_refuses_what_no_reader_would_accept(write: Callable[[], bytes], words: str) -> None:
    """A bug of an encoder shows up when the file is written, and names the rule."""
    with pytest.raises(InvalidInput, match=words) as caught:
        write()
    assert caught.value.refusal == "input-container"


def test_the_bytes_are_those_of_the_specification() -> None:
    """A file packed by hand from SPEC §5: the layout cannot change by accident."""
    layer, tile = b"description", b"coded anchors"
    # Cubes 8 and 11 of depth 2: the first begins the page, two lie between them.
    tiles = struct.pack("<2B2B2B", 2, 2, 3, 3, 0, 2)
    rows = struct.pack("<2B", 0, len(tile)) + struct.pack("<BI", 5, zlib.crc32(tile))
    root = struct.pack("<BBBBBI", 1, 1, 1, len(layer), 0, zlib.crc32(layer))
    # 8 * 2^57 in groups of seven bits: eight of zeros, then 2^60 >> 56.
    root += b"\x80" * 8 + b"\x10" + struct.pack("<BI", len(tiles), zlib.crc32(tiles))
    root += struct.pack("<BIBB", len(rows), zlib.crc32(rows), len(tile), 5)
    size = 240 + len(root + tiles + rows + layer + tile)
    header = struct.pack("<9s3BIQ", b"\x89SCAR\r\n\x1a\n", 0, 2, 0, 240, size)
    header += struct.pack("<8B", 1, 0, 1, 10, 24, 1, 1, 10)
    header += struct.pack("<IIQQ4dQI", 2, len(root), 5, 42, 0.5, -1.0, 3.0, 0.25, 77, zlib.crc32(root))
    header += struct.pack("<4Q13Q", 5, 42, 24, size, 11, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4)
    header += struct.pack("<I", zlib.crc32(header))
    fields = HeaderFields(Profile.ANCHOR, 0, 10, 24, (0.5, -1.0, 3.0), 0.25, 77, CoordinateFrame.RDF, ColourSpace.SRGB)
    blocks = [Block(BlockKind.LAYER, 1, layer), Block(BlockKind.TILE, 1, tile, 1, 5, {Stream.POSITIONS: 9})]
    expected = header + root + tiles + rows + layer + tile
    assert write_container(fields, [Tile(2, 3, 8), Tile(2, 3, 11)], blocks, [(5, 42)]) == expected
