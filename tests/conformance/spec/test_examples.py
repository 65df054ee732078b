"""The worked examples of SPEC.md by the package, which had no part in the numbers printed (but terms of a grid sum)."""

from __future__ import annotations

from itertools import groupby

import numpy as np
import pytest

from conformance.decoders.python.hash_grid import Grid, Level
from conformance.spec import example_networks as networks
from conformance.spec import example_symbols as symbols
from conformance.spec import example_values as values
from conformance.spec.examples import example_parts
from conformance.spec.spec_tables import layouts
from conformance.spec.spec_text import rules
from reference_decoder.dequantise import positions
from scarfmt.arrays import F64, Ints
from scarfmt.blocks.streaming import Streaming, pack_streaming
from scarfmt.codecs.channels import channel_values, contexts, trit_contexts
from scarfmt.codecs.masks import put_masks
from scarfmt.codecs.positions import put_positions
from scarfmt.container.file import Tile
from scarfmt.container.morton import interleave
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.rans import FrequencyTable, RansDecoder, RansEncoder
from scarfmt.neural.context import CellMeans, CellSums, count_features, depth_shifts, passes
from scarfmt.neural.context_operations import fine
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.predictors import PassInputs
from scarfmt.scene.activation import opacity_logits, spherical_harmonics_from_colour
from scarfmt.scene.model import ContextRule, Lattice
from scarfmt.scene.rotation import quaternion_from
from scarfmt.streaming.boxes import octaves, tight_boxes

Group = tuple[bool, int, list[int]]


class Kept(Emitter):
    """Keeps groups: uniform or not, context of the table or size, values."""

    def __init__(self) -> None:
        self.groups: list[Group] = []

    def emit(self, key: TableKey, values: Ints) -> None:
        if len(values):
            self.groups.append((False, key.context, values.tolist()))

    def emit_uniform(self, size: int, values: Ints) -> None:
        if len(values):
            self.groups.append((True, size, values.tolist()))

    def emit_rows(self, weights: F64, values: Ints) -> None:
        raise AssertionError("no rows here")


def test_the_positions_are_coded_in_the_groups_printed() -> None:
    kept = Kept()
    put_positions(kept, np.array(symbols.CODES, np.uint64), symbols.LOCAL_BITS)
    assert kept.groups == symbols.tree(symbols.CODES, symbols.LOCAL_BITS)


@pytest.mark.parametrize(("anchors", "lower"), [symbols.SPLIT, symbols.WIDE_SPLIT])
def test_a_split_is_coded_in_the_groups_printed(anchors: int, lower: int) -> None:
    kept = Kept()
    put_positions(kept, np.array([0] * lower + [4] * (anchors - lower), np.uint64), 1)
    wanted = symbols.split(anchors, lower)
    assert kept.groups[: len(wanted)] == wanted


def test_masks_have_the_contexts_printed() -> None:
    """Groups of the package are by ascending context; those printed are in the order of anchors."""
    kept = Kept()
    before, on = np.array(symbols.ON_BEFORE), np.array(symbols.TURNED_ON)
    put_masks(kept, before, before | on)
    wanted: list[Group] = []
    for asked, bits in symbols.masks():
        pairs = sorted(zip(asked, bits, strict=True), key=lambda pair: pair[0])
        wanted += [(False, context, [bit for _, bit in run]) for context, run in groupby(pairs, lambda pair: pair[0])]
    assert kept.groups == wanted


def test_contexts_are_those_printed() -> None:
    rule = symbols.RULE
    here = ContextRule(bool(rule.by_class), rule.source_channel, rule.source_component, rule.low, rule.shift)
    classes = np.array([symbols.CLASS])
    assert contexts(here, classes, [np.array([[symbols.SOURCE]], np.int32)]).tolist() == [symbols.first_context()]
    refined = np.array(symbols.REFINED)
    assert trit_contexts(here, np.repeat(classes, len(refined)), refined).tolist() == symbols.trit_contexts()


def test_the_key_is_the_number_printed() -> None:
    assert f"{TableKey(*symbols.KEY).number:#010x}"[2:].upper() in example_parts()["example-key"]()


def test_the_stream_of_three_symbols_is_the_word_printed() -> None:
    words, states = symbols.states()
    table = FrequencyTable.from_weights(np.array(symbols.WEIGHTS))
    encoder = RansEncoder()
    encoder.encode(np.array(symbols.SYMBOLS), table)
    data = encoder.finish()
    assert np.frombuffer(data, "<u4").tolist() == words
    assert RansDecoder(data).decode(table, len(symbols.SYMBOLS)).tolist() == symbols.SYMBOLS
    assert states[-1] == 0
    shares = " ".join(map(str, table.frequencies.tolist()))
    assert f"the frequencies {shares}" in " ".join(example_parts()["example-frequencies"]().replace("> ", "").split())


def test_the_value_and_the_position_are_those_printed() -> None:
    found = channel_values(np.array([[values.VALUE]], np.int32), [values.FIRST_WIDTH], np.array([values.STEPS]))
    assert float(found[0, 0]) == values.value().value
    r, _, coordinate = values.position()
    # The second cube of side 16 along x.
    bits, depth = 6, 2
    assert 1 << (bits - depth) == values.CORNER
    codes = interleave(np.array([[values.LOCAL, 0, 0]], np.uint64))
    lattice = Lattice((values.ORIGIN, 0.0, 0.0), values.VOXEL, bits)
    placed = positions(lattice, Tile(prefix=1, depth=depth, shift=values.SHIFT), codes, np.array([[r, 0.0, 0.0]]))
    assert float(placed[0, 0]) == coordinate


def test_rotation_opacity_and_colour_are_those_printed() -> None:
    g, h, twist = values.ROTATION
    assert quaternion_from(np.array([[g, h]]), np.array([twist]))[0].tolist() == pytest.approx(values.rotation())
    logits = opacity_logits(np.array(values.LOG_OPACITIES))
    assert logits.tolist() == pytest.approx([logit for logit, _ in values.opacities()])
    assert spherical_harmonics_from_colour(np.array([values.COLOUR]))[0].tolist() == values.colour()


def test_the_gain_is_where_it_is_printed_and_means_that() -> None:
    viewpoint, layer, tile = values.GAIN_AT
    gains = np.zeros((values.VIEWPOINTS, values.LAYERS, values.TILES), np.uint8)
    gains[viewpoint, layer - 1, tile] = values.GAIN
    corners, reach = np.zeros((values.TILES, 3), np.uint8), np.zeros(values.TILES, np.uint8)
    block = pack_streaming(Streaming(corners, corners, reach, np.zeros((values.VIEWPOINTS, 3), np.float32), gains))
    assert block[-gains.size :].index(values.GAIN) == values.gain_byte()
    assert octaves(-256, 257)[1:][values.GAIN] == values.gain_share()
    low, high, told = (np.full((1, 3), n, np.uint8) for n in (values.LOW, values.HIGH, 0))
    one = Streaming(low, high, told[:, 0], np.zeros((0, 3), np.float32), gains[:0, :, :1])
    box = tight_boxes(np.array([[0.0] * 3 + [values.SIDE] * 3]), one)
    assert (box.low[0, 0], box.high[0, 0]) == values.tight_box()
    assert values.SIDE * octaves(-128, 256)[values.REACH] == values.reach()


def test_fine_values_and_passes_are_those_printed() -> None:
    found = [int(fine(np.array([[v]]), np.array([n]))[0, 0]) for v, n in networks.FINE]
    assert found == networks.fine_values()
    assert [part.tolist() for part in passes(networks.COHORT, 2)] == networks.passes()


def test_cell_means_are_those_printed() -> None:
    codes = np.array(networks.CODES, np.uint64)
    depths = depth_shifts(codes, networks.LOCAL_BITS, networks.TARGETS)
    assert depths == networks.context().depths
    sums = CellSums(CellMeans(codes, depths), 1)
    sums.add(np.array(list(networks.KNOWN)), np.array(list(networks.KNOWN.values()))[:, None])
    means, counts = sums.around(np.array(networks.LOOKED_FROM))
    for anchor, seen in enumerate(networks.around()):
        assert means[anchor, :, 0].tolist() == seen.means
        assert count_features(counts[anchor]).tolist() == seen.counts


def test_the_predictor_gives_the_context_printed() -> None:
    found = networks.evaluated()
    own, counts = fine(np.array([[networks.VALUE]]), np.array([networks.STEP - 1])), np.array([[9.0, 2.0]])
    means = np.array(networks.MEANS, np.float64)[None]
    x = PassInputs(networks.STEP, np.array([networks.CLASS]), np.array([networks.BEFORE]), own, means, counts).of(0)
    assert x[0].tolist() == found.inputs
    assert networks.worked_predictor().contexts(x).tolist() == [found.context]


def test_the_grid_gives_the_feature_and_the_entry_printed() -> None:
    found, level = networks.summed(), networks.PLANE
    bits = np.zeros((level.entries, 1), np.uint8)
    bits[list(networks.ONES)] = 1
    grid = HashGrid(networks.BOX.origin, networks.BOX.extent_bits, (level,), (bits,))
    assert grid.features(np.array([networks.POINT])).tolist() == [[found.feature]]
    hashed = networks.HASHED
    one = np.zeros(hashed.entries, np.uint8)
    one[networks.hashed_entry()] = 1
    plain = Level(hashed.axes, hashed.resolution, hashed.table_log2, 1)
    # An anchor at the vertex itself sees that vertex alone: a box of 64 steps has cells of one.
    features = Grid([0, 0, 0], 6, [(plain, one.tolist())]).features(list(networks.VERTEX))
    whole = HashGrid((0, 0, 0), 6, (hashed,), (one[:, None],))
    assert whole.features(np.array([networks.VERTEX]))[0].tolist() == features == [127]


def test_every_check_in_a_layout_names_an_id_of_its_rule() -> None:
    """A layout and its rule name the same check."""
    lines = [line for make in layouts().values() for line in make().splitlines() if line.strip().startswith("check ")]
    assert len(lines) > 25
    for line in lines:
        check, _, otherwise = line.partition("# else ")
        number = check.split()[1].rstrip(":")
        assert set(otherwise.split(", ")) <= set(rules()[number].refusals), line
