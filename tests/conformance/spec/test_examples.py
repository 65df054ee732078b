"""The numbers of the examples in both texts are those that the package computes; the examples are written by hand."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scarfmt_conformance.archive import read

from conformance.decoders.python.decoder import Decoder
from conformance.decoders.python.work import Work
from conformance.spec.spec_text import text
from reference_decoder.reconstruct import positions
from scarfmt.arrays import F64, Ints
from scarfmt.codecs.channels import channel_values, trit_contexts
from scarfmt.codecs.masks import put_masks
from scarfmt.codecs.positions import put_positions
from scarfmt.container.file import Container, Tile
from scarfmt.container.morton import interleave
from scarfmt.container.schema import Stream
from scarfmt.container.source import BytesSource
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.numbers import NumberWriter
from scarfmt.entropy.rans import FrequencyTable, RansDecoder, RansEncoder
from scarfmt.errors import ScarError
from scarfmt.limits import FREE_ANCHORS, FREE_NUMBERS, FREE_WORK, Limits
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.context import Cells, CellSums, count_features, depth_shifts, fine, passes
from scarfmt.neural.grid import GridLevel, HashGrid
from scarfmt.neural.predictors import PassInputs, Predictor
from scarfmt.scene.activation import opacity_logits, spherical_harmonics_from_colour
from scarfmt.scene.model import Lattice
from scarfmt.scene.rotation import quaternion_from
from scarfmt.tools.truncate import truncate

WORKED = read("worked")
_NUMBER = re.compile(r"0x[0-9A-F]+|(?<![\w.])-?\d+(?:\.\d+)?")


def printed(name: str) -> str:
    """The example after ``<!-- example:NAME -->``, or the first of the section NAME, on one line."""
    start = re.search(rf"^(?:<!-- example:{name} -->|#+ {re.escape(name)}\.? .*)$", text(), re.MULTILINE)
    assert start is not None, name
    found = re.search(r"^> \*\*Example\.\*\* (.*(?:\n>.*)*)", text()[start.end() :], re.MULTILINE)
    assert found is not None, name
    return found[1].replace("\n>", " ")


def shows(name: str, *numbers: object) -> None:
    """Check that an example prints these numbers, in this order; others may stand between them."""
    shown = iter(_NUMBER.findall(printed(name)))
    for number in numbers:
        wanted = str(number).removesuffix(".0")
        assert any(wanted == one.removesuffix(".0") for one in shown), f"{name} does not print {number} in its place"


class Groups(Emitter):
    """Keeps groups: uniform or not, context of the table or size, values."""

    def __init__(self) -> None:
        self.groups: list[tuple[bool, int, list[int]]] = []

    def emit(self, key: TableKey, values: Ints) -> None:
        if len(values):
            self.groups.append((False, key.context, values.tolist()))

    def emit_uniform(self, size: int, values: Ints) -> None:
        if len(values):
            self.groups.append((True, size, values.tolist()))

    def emit_rows(self, weights: F64, values: Ints) -> None:
        raise AssertionError("no rows here")


def split(codes: list[int], bits: int) -> list[tuple[bool, int, list[int]]]:
    """The groups in which anchors of these local codes are coded."""
    out = Groups()
    put_positions(out, np.array(codes, np.uint64), bits)
    return out.groups


def test_container() -> None:
    """SPEC §5.1, §5.2, §5.4, §5.5, §6.2."""
    for data, refusal in ((b"\x89S", "truncated-header"), (b"xSCAR", "damaged-signature"), (b"SCA", "bad-signature")):
        with pytest.raises(ScarError, match=refusal):
            Container(BytesSource(data))
    shows("5.2", len(WORKED), FREE_ANCHORS + len(WORKED))
    (tile,) = Container(BytesSource(WORKED)).tiles
    base, past = tile.prefix << 60, (tile.prefix + 1) << 60
    shows("5.4", tile.depth, tile.prefix, base >> 60, 1, tile.prefix + 2, ((tile.prefix + 2) << 60) - base >> 60)
    shows("5.5", tile.depth, tile.prefix, past >> 60, 2, -(-past >> 57), (-(-past >> 57)) + 3)
    shows("6.2", *[x << 3 for x in (1, 0, 1)], 3, Decoder(WORKED, 1).tile(0).code[0], 3, 1, 1)


def test_entropy() -> None:
    """SPEC §8."""
    table = FrequencyTable.from_weights(np.array([1, 2, 1]))
    shows("frequencies", *table.cumulative.tolist(), *table.frequencies.tolist())
    encoder = RansEncoder()
    encoder.encode(np.array([1, 0, 2]), table)
    (word,) = np.frombuffer(data := encoder.finish(), "<u4").tolist()
    assert RansDecoder(data).decode(table, 3).tolist() == [1, 0, 2]
    shows("rans", 1, 0, 2, f"0x{word:08X}", f"0x{word:X}", "0x0")
    writer = NumberWriter()
    for number in (5, 0, 5):
        writer.number("a", number)
    shows("numbers", 5, 0, 5, f"0x{int.from_bytes(writer.finish(), 'little'):08X}")
    p, numbers = 32768, list[int]()
    for n, bit in enumerate((1, 0, 1)):
        p = p - p // (n + 2) if bit else p + (65536 - p) // (n + 2)
        numbers.append(p)
    shows("numbers", *numbers)
    shows("key", f"0x{TableKey(5, 1, 2, 35).number:08X}")
    refined = np.array([-7, -2, -1, 0, 5])
    shows("contexts", *refined, *trit_contexts(refined).tolist())


def test_tiles() -> None:
    """SPEC §7.2 and §7.4."""
    whole, halves, rest = split([15, 234], 3)
    assert rest[:2] == (True, 128)
    shows("positions", 15, 234, whole[1], whole[2][0], halves[2][0], rest[1], *rest[2], 128 + rest[2][1])
    bin_, small = split([0] * 23 + [4] * 17, 1)[:2]
    wide, high, low = split([0] * 4096 + [4] * 61440, 1)[:3]
    shows("splits", 40, bin_[2][0], small[1], *small[2], wide[2][0], high[1], high[2][0], low[1], low[2][0])
    out, before = Groups(), np.array([[False, True, False], [False] * 3])
    put_masks(out, before, before | [[True, False, False], [False, False, True]])
    contexts_of = {(context, *values) for _, context, values in out.groups}
    assert contexts_of == {(1, 1), (0, 0), (0, 0), (2, 0), (0, 1)}
    shows("masks", 1, 0, 1, 0, 0, 0, 2, 0, 0, 1)


def test_reconstruction() -> None:
    """SPEC §9."""
    value = channel_values(np.array([[7]], np.int32), [5.5], np.array([3]))[0, 0]
    shows("widths", 5.5, 5.5 / 9, 7 * (5.5 / 9), value, 5.5 / 3 / 3)
    r = -4 * (float(np.float32(1 / 3)) / 3)
    lattice, tile = Lattice((-1.0, 0.0, 0.0), 0.25, 6), Tile(prefix=1, depth=2, shift=2)
    placed = positions(lattice, tile, interleave(np.array([[3, 0, 0]], np.uint64)), np.array([[r, 0, 0]]))
    shows("position", f"{r:.6g}", f"{(placed[0, 0] + 1) * 4:.8g}", f"{placed[0, 0]:.8g}")
    shows("rotation", *[f"{q:.6f}" for q in quaternion_from(np.array([[0.5, -0.25]]), np.array([1.0]))[0]])
    logits = opacity_logits(np.array([-0.7, 0.0]))
    colour = spherical_harmonics_from_colour(np.array([[1.0, 0.25, -0.5]]))[0].tolist()
    shows("opacity", *[f"{x:.6f}" for y in logits for x in (y, 1 / (1 + np.exp(-y)))], *colour)


def test_limits_and_truncation() -> None:
    """SPEC §13.2 and §14."""
    numbers = FREE_NUMBERS + Limits().numbers_per_byte * len(WORKED)
    decoder = Decoder(WORKED, 2)
    found = numbers - decoder.budget.left
    work = FREE_WORK + Limits().work_per_byte * len(WORKED)
    shows("13.2", len(WORKED), numbers, work, found, Work(decoder).total())
    whole, cut = (Container(BytesSource(data)).header for data in (WORKED, truncate(BytesSource(WORKED), 1)))
    parts = (whole.header_length - cut.header_length, whole.root_length - cut.root_length, whole.layers[1].byte_count)
    lost = whole.file_length - cut.file_length
    shows("14", whole.file_length, cut.file_length, *parts[:2], lost - sum(parts), parts[2])


def test_context_of_networks() -> None:
    """SPEC §10.2."""
    pairs = ((5, 1), (1, 2), (-1, 2), (1, 3), (20000, 1), (9, 0))
    shows("fine", *[int(fine(np.array([[v]]), np.array([n]))[0, 0]) for v, n in pairs])
    shows("passes", 10, 2, *[rank for part in passes(10, 2) for rank in part.tolist()])
    codes = np.array([0, 1, 9, 10, 12, 63], np.uint64)
    sums = CellSums(Cells(codes, depth_shifts(codes, 2, (5, 2))), 1)
    sums.add(np.array([0, 2]), np.array([[-7], [2]]))
    means, counts = sums.around(np.array([3, 5]))
    near, far = ([*means[a, :, 0].tolist(), *count_features(counts[a]).tolist()] for a in (0, 1))
    shows("around", *depth_shifts(codes, 2, (5, 2)), 10, *near, 63, *far)


def test_predictor() -> None:
    """SPEC §10.3."""

    def rows(*stored_rows: list[int]) -> np.ndarray[tuple[int, int], np.dtype[np.int32]]:
        return np.array([row[:2] + [0] * 13 + row[2:] for row in stored_rows], np.int32)

    hidden = Linear(rows([0, 2, 1, 0, 0, 3, -1, 0, 1, 0, 4, 2]), np.array([40]), 5)
    output = rows([0, 3, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 9], [4, -1, 0, 2, 0, 0, 0, 0, 1, 0, 3, 0, -2])
    predictor = Predictor(Stream.OPACITY, 0, 2, hidden, Linear(output, np.array([-20, 30]), 6), (8, 4))
    around = np.array([[[3500.0], [3300.0]]]), np.array([[9.0, 2.0]])
    scale = np.array([[-1536, -2900, -4700]])
    x = PassInputs(2, np.array([1]), scale, np.array([[3]]), around).of(0)
    shows("predictor", *hidden.weights[0, [0, 1]], *output[0, [0, 1]], *x[0].tolist()[:15], *x[0].tolist()[15:18])
    shows("predictor", *x[0].tolist()[18:], *predictor.contexts(x).tolist())


def test_hash_grid() -> None:
    """SPEC §10.6: the feature of a point, and the entry of a vertex, which an anchor at the vertex sees alone."""
    level, bits = GridLevel(plane=1, resolution=3, table_log2=5, features=1), np.zeros((16, 1), np.uint8)
    bits[[1, 6]] = 1
    feature = HashGrid((10, 20, 30), 4, (level,), (bits,)).features(np.array([[17, 23, 31]]))[0, 0]
    shows("grid", 17, 23, 31, feature, 3, 5, 7, 101)
    hashed, one = GridLevel(plane=0, resolution=64, table_log2=8, features=1), np.zeros((256, 1), np.uint8)
    one[101] = 1
    assert HashGrid((0, 0, 0), 6, (hashed,), (one,)).features(np.array([[3, 5, 7]]))[0].tolist() == [127]
