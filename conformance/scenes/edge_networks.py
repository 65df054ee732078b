"""Valid vectors at the edges of the neural entropy model (SPEC §10): widths, passes, depths, heads, grids, modes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from conformance.scenes.cases import Case, edge
from conformance.scenes.made import ANCHOR_CHANNELS, COLOURED, EVERY_CHANNEL, SCALE3, WHOLE, Plan, build, channel
from conformance.scenes.neural_models import GridPlan, NetworkPlan, PredictorPlan
from conformance.surgery.edit import edit, replace_bytes
from conformance.surgery.files import change_block, change_numbers, numbers_of
from conformance.writer.file import write_file
from conformance.writer.numbers import Number, numbers_block
from scarfmt.arrays import I32
from scarfmt.blocks.hash_grid import pack_grid
from scarfmt.blocks.predictors import pack_predictors
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import BlockKind, Profile, Stream
from scarfmt.entropy.rans import FrequencyTable, RansEncoder
from scarfmt.neural.arithmetic import MAX_SHIFT, Linear
from scarfmt.neural.grid import GridLevel
from scarfmt.neural.network import Attention, GruLayer, IndexNetwork
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.model import MAX_CLASSES, DecodedContext, LayerRow

_PASSES = "R-10.2-1", "R-10.2-3", "R-10.2-4", "R-10.2-5"


def _rows(*rows: tuple[bool, Sequence[int], int]) -> tuple[LayerRow, ...]:
    """Layers of (neural, stages of each class, steps of both channels of all)."""
    return tuple(LayerRow(tuple(stages), ((steps, steps),) * len(stages), neural) for neural, stages, steps in rows)


def _plan(seed: str, network: NetworkPlan | None, rows: tuple[LayerRow, ...], **fields: Any) -> Plan:
    """SCALE and COLOUR; degree 1, three latent dimensions."""
    plan = Plan(f"edge {seed}", COLOURED, rows, WHOLE, (20,), bits=6, degree=1, dimension=3, loudness=8,
                network=network)
    return replace(plan, **fields)


# ---------------------------------------------------------------------------------------------- predictors


def predictor_cases() -> Iterator[Case]:
    """Cases of predictors."""
    rules = "R-10.3-3", "R-10.3-4", "R-10.3-5"
    yield edge("predictors-every", "every component of every attribute channel, steps 1 and 2", _every(), rules)
    yield edge("predictors-anchor", "256 contexts as 256, 16 and 1 buckets, 0 to 64 hidden units; six scales", Plan(
        "edge anchor predictors", ANCHOR_CHANNELS, (LayerRow((1,), ((1, 1),)), LayerRow((1,), ((2, 1),))), WHOLE,
        (30,), bits=6, profile=Profile.ANCHOR, slots=2, dimension=3, codewords=(4, 4), context=DecodedContext(2, (9,)),
        predictors=tuple(
            PredictorPlan(Stream.SCALE, c, 1 + c % 2, units, buckets)
            for c, (units, buckets) in enumerate((
               (0, (256, 1)), (64, (1, 256)), (1, (16, 16)), (7, (1, 1)), (0, (85, 3)), (63, (2, 128))))
        )), rules)
    classes = tuple(LayerRow((0,) * n, ((1 + (n > 8),) * 2,) * n) for n in (8, 15))
    for name, columns in (("fifteen", 15), ("none", 0)):
        yield edge(f"predictors-classes-{name}", f"fifteen classes, predictors that look at {columns} of them", Plan(
            f"edge classes {name}", COLOURED, classes, WHOLE, (60,), bits=6, context=DecodedContext(1, (12, 3)),
            predictors=(PredictorPlan(Stream.SCALE, 0, 1, 3, classes=columns),
                        PredictorPlan(Stream.COLOUR, 2, 2, 0, classes=columns))), rules)
    late = (LayerRow((0,), ((1, 0),)), LayerRow((0, 0), ((2, 1), (1, 0))), LayerRow((0,) * 3, ((2, 3), (3, 1), (3, 3))))
    yield edge("predictors-late", "predictors of layer 1 in force for classes that appear in layers 2 and 3", Plan(
        "edge late predictors", COLOURED, late, (Tile(1, 0, 0), Tile(1, 0, 7)), (40, 9), bits=6,
        context=DecodedContext(1, (8,)), predictors=(
            PredictorPlan(Stream.SCALE, 0, 1, 2), PredictorPlan(Stream.SCALE, 1, 3, 0),
            PredictorPlan(Stream.COLOUR, 0, 1, 2), PredictorPlan(Stream.COLOUR, 0, 3, 2))), rules)
    for log2, targets in ((0, ()), (0, (65535,)), (1, (2, 1)), (3, (4, 3, 2, 1))):
        yield edge(f"predictors-passes-{log2}-depths-{len(targets)}", (
            f"passes_log2 {log2} and {len(targets)} depths; tiles of 0, 1, 3 and 17 anchors: passes may be empty"),
            _passes(log2, targets), _PASSES)
    yield edge("predictors-exact", "contexts that tell inputs near their ends apart, each input by itself", _exact(),
               (*rules, "R-10.1-1"))
    yield edge("predictors-largest", "weights of 32767 and -32767", _largest(), ("R-10.1-1", "R-10.3-2"))
    yield from _latent_cases((*rules, "R-10.3-1"))
    stored = build(_passes(1, (5,)))
    data = write_file(stored)
    for layer, group in stored.predictors.items():
        data = change_block(data, BlockKind.PREDICTORS, layer, replace_bytes(_with_all_columns(group)))
    yield Case("edge/predictors-stored", "class columns without weights; biases that share no shift, or zeros by 31",
               change_numbers(data, BlockKind.PREDICTORS, _unshift), ("R-8.5-2", "R-10.3-1"), scene=stored)


def _with_all_columns(predictors: tuple[Predictor, ...]) -> bytes:
    """A block that stores all class columns: the last has a weight that no other is when it is packed, and then 0."""
    mark = 1000
    marked = [edit(predictor, {f"output.weights.0.{MAX_CLASSES - 1}": mark}) for predictor in predictors]
    numbers = numbers_of(pack_predictors(marked), BlockKind.PREDICTORS)
    return numbers_block((field, 0 if (field[0], n) == ("weights", 2 * mark) else n) for field, n in numbers)


def _unshift(numbers: list[Number]) -> list[Number]:
    """The numbers, what was shifted shifted by 0, or by 31 where all of it is 0."""
    out: list[Number] = []
    for field, array in itertools.groupby(numbers, lambda one: one[0]):
        values = [n for _, n in array]
        if out and out[-1][0] == ("shift of", field[0]):
            shift, out[-1] = out[-1][1], (out[-1][0], 0 if any(values) else 31)
            # 2v stands for v, 2v + 1 for -v - 1.
            values = [(n + n % 2 << shift) - n % 2 for n in values]
        out += [(field, n) for n in values]
    return out


def _latent_cases(rules: Sequence[str]) -> Iterator[Case]:
    """LATENT as wide as it may be, and as many inputs as fit in a byte."""
    rows = (LayerRow((0,), ((2, 1),)), LayerRow((0,), ((2, 2),)))
    scales = channel(Stream.SCALE, 0.25, 6)
    wide = channel(Stream.LATENT, 1.5, 64)
    every = (PredictorPlan(Stream.LATENT, c, 1, c // 62, (2 + c % 7, 2)) for c in range(64))
    yield edge("predictors-latents-64", "predictors of 64 components of LATENT; of a second step, too", Plan(
        "edge 64 latents", (SCALE3, wide), rows, WHOLE, (40,), bits=6, dimension=64,
        context=DecodedContext(1, (12, 3)), predictors=(*every, PredictorPlan(Stream.LATENT, 63, 2, 2, (6, 3)))), rules)
    yield edge("predictors-inputs-255", "57 components and three depths in the anchor profile: 255 inputs", Plan(
        "edge 255 inputs", (scales, channel(Stream.LATENT, 1.5, 57), ANCHOR_CHANNELS[1]),
        tuple(LayerRow(row.stages, tuple((*steps, 1) for steps in row.steps)) for row in rows), WHOLE, (30,), bits=6,
        profile=Profile.ANCHOR, slots=1, dimension=57, context=DecodedContext(2, (20, 6, 2)), predictors=(
            PredictorPlan(Stream.LATENT, 0, 1, 64), PredictorPlan(Stream.LATENT, 56, 1, 0, (16, 8)),
            PredictorPlan(Stream.LATENT, 30, 2, 3), PredictorPlan(Stream.LATENT, 56, 2, 1, wide=True))), rules)


def _exact_predictor(stream: Stream, component: int, step: int, inputs: int, column: int, near: int) -> Predictor:
    """A predictor whose context distinguishes values of an input: near `near` and its negative, or, if that is 0,
    -128..127."""
    weights = np.zeros((2, inputs), np.int32)
    weights[:, column] = 1, -1
    if not near:
        return Predictor(stream, component, step, None, Linear(weights, np.array([128, 0]), 0), (256, 1))
    return Predictor(stream, component, step, None, Linear(weights, np.array([8 - near] * 2), 0), (16, 16))


def _exact() -> QuantisedScene:
    """Two depths. Inputs of SCALE: 15 class columns, 3 values, 6 means, 2 counts, 2 differences; COLOUR has 3 more."""
    scene = build(Plan(
        "edge exact", COLOURED, (LayerRow((0,), ((2, 2),)),), WHOLE, (60,), bits=5, spread=22,
        context=DecodedContext(2, (20, 3))))
    wanted = (
        (Stream.SCALE, 0, 1, 18, 0), (Stream.SCALE, 0, 2, 15, 511), (Stream.SCALE, 1, 1, 15, 511),
        (Stream.SCALE, 1, 2, 22, 0), (Stream.SCALE, 2, 1, 25, 96), (Stream.SCALE, 2, 2, 26, 511),
        (Stream.COLOUR, 0, 1, 17, 511), (Stream.COLOUR, 0, 2, 29, 511), (Stream.COLOUR, 1, 1, 18, 511),
        (Stream.COLOUR, 1, 2, 30, 0), (Stream.COLOUR, 2, 1, 0, 64), (Stream.COLOUR, 2, 2, 27, 160),
    )
    widths = {Stream.SCALE: 28, Stream.COLOUR: 31}
    predictors = tuple(_exact_predictor(s, c, step, widths[s], column, near) for s, c, step, column, near in wanted)
    return replace(scene, predictors={1: predictors})


def _largest() -> QuantisedScene:
    """Weights of 32767 and -32767, and accumulators that they bring near 2^24."""
    scene = build(replace(_passes(1, (5,)), seed="edge largest"))

    def largest(predictor: Predictor) -> Predictor:
        weights = np.zeros((2, predictor.inputs), np.int32)
        weights[0, -1], weights[1, 15] = 32767, -32767
        return replace(predictor, hidden=None, output=Linear(weights, np.array([9, 16894]), 15), buckets=(16, 16))

    return replace(scene, predictors={layer: tuple(map(largest, group)) for layer, group in scene.predictors.items()})


def _every() -> Plan:
    channels = EVERY_CHANNEL[1:5]
    plans = tuple(
        PredictorPlan(c.stream, j, step, (j + step) % 4, (2 + j, 2))
        for c in channels for j in range(c.components) for step in (1, 2)
    )
    rows = (LayerRow((0,), ((1,) * 4,)), LayerRow((0, 0), ((3, 2, 2, 3), (2, 1, 2, 2))))
    return Plan("edge every", channels, rows, WHOLE, (40,), bits=6, context=DecodedContext(1, (10,)), predictors=plans)


def _passes(log2: int, targets: tuple[int, ...]) -> Plan:
    tiles = tuple(Tile(1, 0, code) for code in range(4))
    rows = (LayerRow((0,), ((1, 1),)), LayerRow((0, 0), ((2, 2), (2, 1))))
    return Plan(f"edge passes {log2} {targets}", COLOURED, rows, tiles, (0, 1, 3, 17), bits=4,
                context=DecodedContext(log2, targets), predictors=(
                    PredictorPlan(Stream.SCALE, 0, 1, 2), PredictorPlan(Stream.SCALE, 2, 2, 0),
                    PredictorPlan(Stream.COLOUR, 1, 1, 0), PredictorPlan(Stream.COLOUR, 1, 2, 3)))


# ---------------------------------------------------------------------------------------------- index networks


def network_cases() -> Iterator[Case]:
    """Cases of index networks and hash grids."""
    yield from _width_cases()
    yield from _mixed_cases()
    yield from _head_cases()
    yield from _mode_cases()
    yield from _number_cases()
    yield from _grid_cases()


def _width_cases() -> Iterator[Case]:
    rules = "R-10.5-2", "R-10.5-8"
    least = NetworkPlan(bits=8, widths=(1, 1, 1), dims=1, classes=1, own=False)
    yield edge("index-least", "one input, widths of 1, one stage, one head, no tokens", _plan(
        "least", least, _rows((True, (1,), 1)), counts=(12,)), (*rules, "R-10.5-4"))
    wide = NetworkPlan(bits=8, widths=(256, 20, 256), dims=3, layers=1, latents=3, classes=15)
    yield edge("index-wide", "an embedding and a mixer of 256 units, four depths", _plan(
        "wide", wide, _rows((True, (2,), 1)), counts=(7,), context=DecodedContext(1, (6, 4, 2, 1))), rules)
    state = NetworkPlan(bits=12, widths=(2, 40, 2), dims=2, layers=4, attention=True)
    yield edge("index-state", "a state of 40 units in four recurrent layers, attention", _plan(
        "state", state, _rows((True, (3,), 1)), counts=(9,)), rules)
    yield edge("index-widest", "widths of 256, one weight in 64", _sparse(_plan(
        "widest", NetworkPlan(bits=9, widths=(256, 256, 256)), _rows((True, (2,), 1)), counts=(4,))), rules)
    many = NetworkPlan(widths=(4, 4, 4), dims=64, classes=15, latents=64, own=True)
    latent = _plan("many inputs", many, _rows((True, (2,), 1)), counts=(8,), dimension=64,
                   context=DecodedContext(0, (8, 5, 3, 1)))
    yield edge("index-codeword-dims", "64 codeword dimensions, and means of 64 latents at four depths", latent, rules)


def _sparse(plan: Plan) -> QuantisedScene:
    """The scene, of the weights of its network one in 64 left, as 3 or -3; shifts smaller to match."""
    scene = build(plan)
    network = scene.network
    assert network is not None

    def thinned(weights: I32) -> I32:
        rows, columns = np.indices(weights.shape)
        return np.asarray(3 * np.sign(weights) * ((13 * rows + columns) % 64 == 5), np.int32)

    def thin(layer: Linear) -> Linear:
        return Linear(thinned(layer.weights), layer.biases >> 10, max(layer.shift - 10, 0))

    (gru,) = network.gru
    first, second = network.embed
    gru = replace(gru, inputs=tuple(map(np.sign, gru.inputs)), recurrent=thinned(gru.recurrent),
                  biases=gru.biases >> 10, recurrent_biases=gru.recurrent_biases >> 10, shift=max(gru.shift - 10, 0))
    return replace(scene, network=replace(
        network, embed=(thin(first), thin(second)), gru=(gru,), mixer=thin(network.mixer)))


def _mixed_cases() -> Iterator[Case]:
    """Each number of passes, depths, recurrent layers and tokens with the choices there are."""
    for number, (passes, targets, layers, tokens, bits, own, attention, latents, classes) in enumerate((
        (0, (), 1, 1, 8, False, True, 0, 3),
        (1, (9,), 2, 2, 9, True, False, 1, 0),
        (2, (9, 3), 3, 3, 10, False, False, 3, 1),
        (3, (9, 6, 3), 4, 4, 11, True, True, 2, 15),
        (3, (9, 6, 3, 1), 1, 5, 12, False, True, 0, 2),
        (2, (4,), 2, 6, 8, True, True, 3, 4),
        (1, (30, 2), 1, 7, 12, True, False, 3, 2),
    )):
        network = NetworkPlan(bits=bits, widths=(5, 4, 6), layers=layers, latents=latents, own=own, attention=attention,
                              classes=classes)
        rows = _rows((True, (1, tokens + 1), 1), (True, (tokens + 1, tokens + 1, 2), 2))
        purpose = f"passes_log2 {passes}, {len(targets)} depths, {layers} recurrent layers, T {tokens}"
        yield edge(f"index-mix-{number}", purpose, _plan(
            f"mix {number}", network, rows, tiles=(Tile(1, 0, 1), Tile(1, 1, 3), Tile(2, 1, 40)), counts=(14, 6, 1),
            context=DecodedContext(passes, targets)), (*_PASSES, "R-10.5-8", "R-10.5-9"))


def _head_cases() -> Iterator[Case]:
    rules = "R-10.5-5", "R-10.5-9", "R-10.5-10"
    large = NetworkPlan(widths=(3, 3, 4), dims=2)
    yield edge("index-4096", "4096 codewords", _plan(
        "4096", large, _rows((True, (2,), 1)), counts=(6,), dimension=2, codewords=(4096, 4096)), rules)
    yield edge("index-one-codeword", "codebooks of one codeword: no index takes a bit", _plan(
        "one codeword", NetworkPlan(attention=True), _rows((True, (3,), 1)), codewords=(1, 1)), rules)
    yield edge("index-first-symbols", "every index is 0: INDICES has no bytes", _plan(
        "first", NetworkPlan(attention=True), _rows((True, (3,), 1)), constant=True), ("R-7.1-6", "R-8.2-3"))
    yield edge("index-spare-tokens", "biases of seven tokens, two stages", _plan(
        "spare", NetworkPlan(tokens=7, attention=True), _rows((True, (2,), 1))), ("R-10.5-6",))
    yield edge("index-class-beyond", "four classes, columns for one: the others have none", _plan(
        "beyond", NetworkPlan(classes=1), _rows((True, (1, 1), 1), (True, (2, 1, 1, 2), 1))), ("R-10.5-8",))


def _mode_cases() -> Iterator[Case]:
    rules = "R-10.4-1", "R-10.4-2", "R-8.4-2"
    yield edge("index-mode-1-0", "entropy mode 1, then 0: later stages by tables", _plan(
        "1 0", NetworkPlan(), _rows((True, (2,), 1), (False, (4, 1), 1))), rules)
    yield edge("index-mode-late", "entropy mode 1 in layer 3 only, for anchors with stages and without", _plan(
        "late mode", NetworkPlan(attention=True, latents=2), _rows(
            (False, (0,), 1), (False, (1, 0), 1), (True, (3, 2, 1), 2), (False, (3, 3, 1), 2)),
        context=DecodedContext(1, (8, 2)), counts=(40,)), rules)
    yield edge("index-mode-idle", "a layer of entropy mode 1 in which no class gets a stage", _plan(
        "idle mode", NetworkPlan(), _rows((True, (2,), 1), (True, (2,), 2))), rules)
    yield edge("index-no-anchor", "an index network in a file without anchors", _plan(
        "no anchor", NetworkPlan(), _rows((True, (2,), 1)), tiles=(), counts=()), rules)


def _plain(layer: Linear, shift: int) -> Linear:
    """The layer with a shift at an end; its weights and biases are signs only, few enough for that."""
    return Linear(np.sign(layer.weights).astype(np.int32), np.sign(layer.biases), shift)


def _plain_gru(layer: GruLayer, shift: int) -> GruLayer:
    return GruLayer(
        tuple(np.sign(matrix).astype(np.int32) for matrix in layer.inputs), np.sign(layer.recurrent).astype(np.int32),
        np.sign(layer.biases), np.sign(layer.recurrent_biases), layer.start, shift,
    )


def _with_shift(network: IndexNetwork, shift: int) -> IndexNetwork:
    """The network with all shifts at an end; 24 leaves no room in a recurrent layer, 23 does."""
    first, second = network.embed
    attention = network.attention
    assert attention is not None
    query, key, value = (_plain(layer, shift) for layer in (attention.query, attention.key, attention.value))
    return replace(
        network, embed=(_plain(first, shift), _plain(second, shift)), mixer=_plain(network.mixer, shift),
        gru=tuple(_plain_gru(layer, min(shift, MAX_SHIFT - 1)) for layer in network.gru),
        heads=tuple(replace(head, project=_plain(head.project, shift), shift=shift) for head in network.heads),
        attention=Attention(query, key, value, shift),
    )


def _exact_network() -> QuantisedScene:
    """An embedding that shows each of 17 inputs, and its negative, above 10."""
    scene = build(_plan("exact", NetworkPlan(bits=8, widths=(34, 34, 4), latents=2, latent_shift=0), _rows(
        (True, (2,), 1)), counts=(30,), context=DecodedContext(1, (7,)), spread=3, loudness=3))
    network = scene.network
    assert network is not None
    both = np.concatenate([np.eye(17, dtype=np.int32), -np.eye(17, dtype=np.int32)])
    first = Linear(both, np.full(34, -10), 0)
    second = Linear(np.eye(34, dtype=np.int32), np.zeros(34, np.int64), 0)
    return replace(scene, network=replace(network, embed=(first, second)))


def _largest_network() -> QuantisedScene:
    """Each row of the embedding has weights of 32767 and -32767 at two inputs."""
    scene = build(_plan("largest", NetworkPlan(bits=8), _rows((True, (2,), 1))))
    network = scene.network
    assert network is not None
    first, second = network.embed
    weights = np.zeros_like(first.weights)
    for row, values in enumerate(weights):
        values[[row % first.inputs, (row + 3) % first.inputs]] = 32767, -32767
    return replace(scene, network=replace(network, embed=(Linear(weights, 0 * first.biases, 14), second)))


def _opposed_network() -> QuantisedScene:
    """Candidates whose recurrent part is clamped to 2047 or -2047 before the input's part nearly cancels it."""
    scene = build(_plan("opposed", NetworkPlan(widths=(4, 8, 8)), _rows((True, (4,), 1))))
    network = scene.network
    assert network is not None
    (gru,) = network.gru
    width = len(gru.start)
    sign = np.where(np.arange(width) % 2, 1, -1)
    tokens = np.arange(len(gru.biases))[:, None]
    biases = np.concatenate([0 * tokens + 0 * sign, 0 * tokens + 0 * sign, -sign * (2040 + 3 * tokens)], axis=1)
    # z opens half, r all.
    recurrent = np.concatenate([0 * sign, 0 * sign + 4000, sign * (2048 + 500 * np.arange(width))])
    opposed = replace(gru, inputs=tuple(0 * matrix for matrix in gru.inputs), recurrent=0 * gru.recurrent,
                      biases=biases, recurrent_biases=recurrent, start=0 * gru.start, shift=0)
    return replace(scene, network=replace(network, gru=(opposed,)))


def _number_cases() -> Iterator[Case]:
    yield edge("index-opposed", "the two parts of a candidate state nearly cancel, one of them clamped",
               _opposed_network(), ("R-10.5-8",))
    yield edge("index-exact", "an embedding that shows every input as it is, near its ends", _exact_network(),
               ("R-10.2-5", "R-10.5-8"))
    yield edge("index-largest", "weights of 32767 and -32767", _largest_network(), ("R-10.1-1", "R-10.5-1"))
    attended = _plan("shifts", NetworkPlan(attention=True), _rows((True, (3,), 1)))
    for shift in (0, MAX_SHIFT):
        scene = build(replace(attended, seed=f"edge shift {shift}"))
        assert scene.network is not None
        yield edge(f"index-shift-{shift}", f"shifts of {shift}, but at most 23 in recurrent layers", replace(
            scene, network=_with_shift(scene.network, shift)), ("R-10.1-1", "R-10.5-3", "R-10.5-7"))
    for shift, loudness in ((0, 512), (MAX_SHIFT, 1)):
        scene = build(_plan(f"codeword shift {shift}", NetworkPlan(latents=3, latent_shift=MAX_SHIFT - shift), _rows(
            (True, (2,), 1)), loudness=loudness, context=DecodedContext(1, (5,))))
        assert scene.network is not None
        silent = replace(scene.network, codeword_shift=shift, heads=tuple(
            replace(head, biases=np.arange(len(head.biases)) % 5) for head in scene.network.heads))
        yield edge(f"index-codeword-shift-{shift}", f"a codeword shift of {shift}: activations at their end or all 0",
                   replace(scene, network=silent), ("R-10.5-7", "R-10.5-8"))
    scene = build(_plan("shifts of arrays", NetworkPlan(), _rows((True, (2,), 1))))
    yield Case("edge/index-shifts", "no zero bits left out of biases, zeros shifted by 31",
               change_numbers(write_file(scene), BlockKind.ENTROPY_NETWORK, _unshift), ("R-8.5-2",), scene=scene)


def _with_ones(case: Case, ones: int) -> bytes:
    """The file, `ones` of every level of its hash grid another than the share of bits that are 1."""
    assert case.scene is not None
    assert case.scene.grid is not None
    tables = [pack_grid(replace(case.scene.grid, bits=()))]
    for bits in case.scene.grid.bits:
        encoder = RansEncoder()
        encoder.encode(bits.ravel(), FrequencyTable.from_weights(np.array([256 - ones, ones])))
        stream = encoder.finish()
        tables.append(bytes([ones]) + len(stream).to_bytes(4, "little") + stream)
    return change_block(case.data, BlockKind.HASH_GRID, 1, replace_bytes(b"".join(tables)))


def _grid_cases() -> Iterator[Case]:
    rules = "R-10.6-1", "R-10.6-2", "R-10.6-3"
    planes = tuple(GridLevel(plane, 3, table, 1) for plane in range(7) for table in (2, 6))
    sixteen = (*planes, GridLevel(0, 65535, 8, 2), GridLevel(6, 1, 1, 8))
    own = NetworkPlan(classes=0, own=False, loudness=16)
    for name, what, plan, ones in (
        ("extent-0", "a box of one lattice step: all anchors have the features of a corner",
         GridPlan((17, 60, 3), 0, planes[:6]), None),
        ("extent-32", "a box of 2^32 lattice steps, its origin at the far end of two axes",
         GridPlan((0, (1 << 32) - 1, (1 << 32) - 1), 32, planes[6:]), 1),
        ("levels-16", "sixteen levels: every plane dense and hashed, resolutions 1 and 65535",
         GridPlan((0, 0, 0), 6, sixteen), 255),
    ):
        bits = 32 if name == "extent-32" else 6
        tiles = (Tile(0, 11, 0),) if name == "extent-32" else WHOLE
        case = edge(f"grid-{name}", what, _plan(
            f"grid {name}", own, _rows((True, (2,), 1)), grid=plan, bits=bits, tiles=tiles), rules)
        yield case if ones is None else replace(case, data=_with_ones(case, ones))
    table = GridPlan((0, 0, 0), 6, (GridLevel(0, 65535, 15, 2),))
    scene = build(_plan("grid zeros", own, _rows((True, (1,), 1)), grid=table, counts=(8,)))
    assert scene.grid is not None
    empty = replace(scene, grid=replace(scene.grid, bits=tuple(0 * bits for bits in scene.grid.bits)))
    yield edge("grid-empty-stream", "a level of 65536 zeros: its stream has no bytes", empty, (*rules, "R-8.2-3"))
