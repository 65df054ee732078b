"""The scenes of the valid vectors: made by hand, or at random from :class:`conformance.scenes.prng.Prng`."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

import numpy as np

from conformance.scenes.neural_models import (
    GridPlan,
    NetworkPlan,
    PredictorPlan,
    random_grid,
    random_network,
    random_predictors,
)
from conformance.scenes.prng import Prng
from scarfmt.arrays import I64
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import HeaderFields, Tile
from scarfmt.container.schema import ColourSpace, CoordinateFrame, Profile, Stream
from scarfmt.scene.model import Channel, Codebooks, DecodedContext, LayerRow, SceneModel

FEATURES = 4


@dataclass(frozen=True)
class Plan:
    """A random scene: what is fixed, the rest follows from the seed.

    Attributes:
        rows: layer table.
        counts: anchors of each tile.
        codewords: of the coarse and the residual codebook.
        loudness: factor of their components.
        codes: local codes are drawn from so many values, 0 for all there are.
        skew: codes are the largest of so many draws: few anchors in the lower halves.
        spread: of first-step values.
        constant: every value, class choice and index takes the first possible value.
        context, predictors, network, grid: the neural entropy model.
    """

    seed: str
    channels: tuple[Channel, ...]
    rows: tuple[LayerRow, ...]
    tiles: tuple[Tile, ...]
    counts: tuple[int, ...]
    bits: int = 16
    profile: Profile = Profile.EXPLICIT
    slots: int = 1
    degree: int = 0
    dimension: int = 0
    codewords: tuple[int, int] = (12, 12)
    loudness: int = 1
    codes: int = 0
    skew: int = 1
    spread: int = 4
    constant: bool = False
    origin: tuple[float, float, float] = (-1.5, 0.25, 3.0)
    voxel: float = 0.0078125
    metadata: dict[str, object] = field(default_factory=dict)
    context: DecodedContext = field(default_factory=DecodedContext)
    predictors: tuple[PredictorPlan, ...] = ()
    network: NetworkPlan | None = None
    grid: GridPlan | None = None


def channel(stream: Stream, step: float, components: int) -> Channel:
    """A channel whose components have each its own step."""
    return Channel(stream, tuple(step * (1 + c / 8) for c in range(components)))


def steady(layers: int, stages: int, steps: tuple[int, ...]) -> tuple[LayerRow, ...]:
    """Layer rows of a single class in every layer, nothing refined."""
    return (LayerRow((stages,), (steps,)),) * layers


def mlp(prng: Prng, *widths: int) -> QuantisedMlp:
    """Random layers of these widths, weights of one byte, scales and biases exact in few bits."""
    layers = []
    for columns, rows in itertools.pairwise(widths):
        weights = prng.integers(-127, 128, (rows, columns)).astype(np.int16)
        scales = (prng.integers(1, 9, rows) / 1024).astype(np.float32)
        layers.append(Linear(weights, scales, (prng.integers(-8, 9, rows) / 16).astype(np.float32)))
    return QuantisedMlp(tuple(layers))


def build(plan: Plan) -> QuantisedScene:
    """The scene of a plan."""
    prng = Prng(plan.seed)
    model = SceneModel(plan.profile, plan.slots, plan.channels, plan.rows, plan.context)
    fields = HeaderFields(
        plan.profile,
        plan.degree,
        plan.slots,
        plan.bits,
        plan.origin,
        plan.voxel,
        sum(plan.counts),
        CoordinateFrame.RDF,
        ColourSpace.SRGB,
    )
    contents = tuple(
        _content(prng, plan, model, plan.bits - tile.depth - tile.shift, count)
        for tile, count in zip(plan.tiles, plan.counts, strict=True)
    )
    books, decoder, mlps = _books(prng, plan, model), _decoder(prng, plan), _scene_mlps(prng, plan)
    grid = random_grid(prng, plan.grid) if plan.grid is not None else None
    network = None
    if plan.network is not None and books is not None:
        network = random_network(prng, plan.network, model, books, grid)
    return QuantisedScene(
        fields,
        model,
        plan.tiles,
        contents,
        books,
        decoder,
        mlps,
        plan.metadata,
        random_predictors(prng, plan.predictors, model),
        network,
        grid,
    )


def _content(prng: Prng, plan: Plan, model: SceneModel, bits: int, count: int) -> TileContent:
    content = TileContent.empty(model, count)
    ends = [row.class_count for row in model.layers]
    possible = min(plan.codes or 1 << 63, 1 << (3 * bits))
    draws = prng.words(count * plan.skew).reshape(plan.skew, count) % np.uint64(possible)
    codes = draws.max(axis=0, initial=0) * np.uint64((1 << (3 * bits)) // possible)
    classes = np.zeros(count, np.int64) if plan.constant else prng.integers(0, ends[-1], count)
    appears = np.searchsorted(ends, classes, side="right") + 1
    order = np.lexsort((codes, appears))
    content.codes, content.classes, appears = codes[order], classes[order], appears[order]
    if content.slot_layers.size:
        slots = prng.integers(0, len(ends) + 1, content.slot_layers.shape)
        content.slot_layers = np.where(slots > 0, np.maximum(slots, appears[:, None]), 0)
    _fill(prng, plan, model, content)
    return content


def _fill(prng: Prng, plan: Plan, model: SceneModel, content: TileContent) -> None:
    last = len(model.layers)
    for index, channel_ in enumerate(model.channels):
        shape = content.values[index].shape
        if channel_.stream == Stream.OFFSETS:
            values = prng.draw_peaked(plan.spread, shape) * (content.slot_layers > 0)[:, :, None]
        else:
            steps = model.steps(last, index, content.classes)
            values = _values(prng, plan, shape, steps, channel_.stream)
        content.values[index] = values.astype(np.int32)
    received = model.stages(last, content.classes)
    drawn = prng.integers(0, 1 if plan.constant else plan.codewords[0], (len(content), model.max_stages))
    drawn[:, 1:] %= plan.codewords[1]
    kept = np.arange(model.max_stages) < received[:, None]
    content.indices = np.where(kept, drawn, 0).astype(np.int16)


def _values(prng: Prng, plan: Plan, shape: tuple[int, ...], steps: I64, stream: Stream) -> I64:
    """v at `steps`: a first value, then trits; a residual stays within the cell of its anchor."""
    if plan.constant:
        return -5 * 3 ** np.maximum(steps - 1, 0)[:, None] * (steps > 0)[:, None] * np.ones(shape, np.int64)
    spread = 0 if stream == Stream.POSITION_RESIDUAL else plan.spread
    values = prng.draw_peaked(spread, shape) * (steps > 0)[:, None]
    for step in range(2, int(steps.max(initial=0)) + 1):
        values = np.where((steps >= step)[:, None], 3 * values + prng.integers(-1, 2, shape), values)
    return values


def _books(prng: Prng, plan: Plan, model: SceneModel) -> Codebooks | None:
    if not model.max_stages:
        return None
    # Trailing dimensions have short ranges, the last none: widths of 7, 6, ... and 0 bits.
    spread = np.array([max(64 >> d, 0) for d in range(plan.dimension)])
    coarse = prng.integers(-64, 65, (plan.codewords[0], plan.dimension)) * spread // 64
    residual = prng.integers(-64, 65, (plan.codewords[1], plan.dimension)) * spread // 256
    coarse, residual = coarse * plan.loudness, residual * plan.loudness
    return Codebooks(coarse, residual if model.max_stages > 1 else residual[:0])


def _decoder(prng: Prng, plan: Plan) -> QuantisedMlp | None:
    if not plan.dimension:
        return None
    if plan.profile == Profile.ANCHOR:
        return mlp(prng, plan.dimension, 5, FEATURES)
    coloured = any(channel_.stream == Stream.COLOUR for channel_ in plan.channels)
    return mlp(prng, plan.dimension, 3 * ((plan.degree + 1) ** 2 - coloured))


def _scene_mlps(prng: Prng, plan: Plan) -> tuple[QuantisedMlp, ...]:
    if plan.profile == Profile.EXPLICIT:
        return ()
    return tuple(mlp(prng, FEATURES + 4, 6, width * plan.slots) for width in (1, 7, 3))


def worked_scene() -> QuantisedScene:
    """The scene of SPEC §4.2: three anchors, two layers."""
    channels = (Channel(Stream.SCALE, (0.5, 0.5, 0.75)), Channel(Stream.OPACITY, (0.25,)))
    rows = (LayerRow((0,), ((1, 1),)), LayerRow((0, 0), ((2, 1), (1, 1))))
    model = SceneModel(Profile.EXPLICIT, 1, channels, rows)
    fields = HeaderFields(Profile.EXPLICIT, 0, 1, 4, (-1.0, 0.5, 2.0), 0.25, 3, CoordinateFrame.RDF, ColourSpace.SRGB)
    content = TileContent.empty(model, 3)
    content.codes = np.array([0o017, 0o352, 0o126], np.uint64)
    content.classes = np.array([0, 0, 1])
    content.values = [
        np.array([[-10, -11, -17], [-5, -12, -18], [-3, -4, -6]], np.int32),
        np.array([[-1], [-1], [-4]], np.int32),
    ]
    return QuantisedScene(fields, model, (Tile(1, 0, 5),), (content,))


WHOLE = (Tile(0, 0, 0),)
"""The whole lattice as one tile."""
SCALE3 = channel(Stream.SCALE, 0.5, 3)
COLOURED = (SCALE3, channel(Stream.COLOUR, 0.1, 3))
EVERY_CHANNEL = (
    channel(Stream.POSITION_RESIDUAL, 1 / 3, 3),
    channel(Stream.SCALE, 0.3, 3),
    channel(Stream.ROTATION, 0.2, 3),
    channel(Stream.OPACITY, 0.4, 1),
    channel(Stream.COLOUR, 0.1, 3),
    channel(Stream.LATENT, 9.0, 5),
)
REFINED_ROWS = (
    LayerRow((1,), ((0, 1, 1, 1, 1, 0),)),
    LayerRow((2, 0), ((1, 2, 1, 2, 2, 1), (0, 1, 0, 1, 0, 0))),
    LayerRow((3, 2, 1, 0), ((3, 4, 3, 2, 2, 2), (1, 3, 1, 1, 1, 0), (0, 1, 1, 1, 1, 0), (2, 2, 2, 2, 2, 2))),
)
SPREAD_TILES = (Tile(1, 3, 0), Tile(1, 0, 3), Tile(2, 5, 41), Tile(3, 9, 500))
ANCHOR_CHANNELS = (channel(Stream.SCALE, 0.25, 6), channel(Stream.OFFSETS, 0.125, 3))
_ANCHOR_RICH = (
    channel(Stream.POSITION_RESIDUAL, 1 / 3, 3),
    channel(Stream.SCALE, 0.25, 6),
    channel(Stream.LATENT, 3.0, 3),
    channel(Stream.OFFSETS, 0.125, 3),
)


def static_plans() -> dict[str, tuple[str, Plan]]:
    """Scenes without neural entropy model: name -> (what it tests, plan)."""
    return {
        "one-anchor": ("one anchor: its 63 bits travel as uniform bits, 12 at a time", Plan(
            "one", (SCALE3,), steady(1, 0, (1,)), WHOLE, (1,), bits=21)),
        "no-anchors": ("no anchors and no tiles: header and one LAYER block", Plan(
            "none", (SCALE3,), steady(1, 0, (1,)), (), ())),
        "explicit-refined": ("all channels, three layers, four classes, tiles of other depth and shift, stages", Plan(
            "refined", EVERY_CHANNEL, REFINED_ROWS, SPREAD_TILES, (30, 20, 0, 40), degree=2, dimension=5)),
        "explicit-core": ("all channels, three layers, four classes, tiles of other depth and shift, no stages", Plan(
            "core", EVERY_CHANNEL, tuple(replace(row, stages=(0,) * len(row.stages)) for row in REFINED_ROWS),
            SPREAD_TILES, (30, 20, 0, 40), degree=2, dimension=5)),
        "sh-from-network": ("no COLOUR: the network gives all coefficients; one stage only", Plan(
            "network", (SCALE3,), steady(1, 1, (1,)), WHOLE, (70,), degree=1, dimension=2)),
        "duplicates": ("400 anchors at 7 lattice points: leaves of many anchors, nodes of more than 16", Plan(
            "duplicates", (SCALE3,), steady(1, 0, (1,)), WHOLE, (400,), codes=7, bits=7)),
        "one-symbol": ("every table has one symbol: no sub-stream but positions has bytes, layer 2 has no TILE", Plan(
            "constant", (SCALE3,), (LayerRow((1,), ((1,),)), LayerRow((2,), ((3,),))), WHOLE, (50,),
            dimension=2, codewords=(1, 1), constant=True, bits=6)),
        "full-block": ("65536 anchors in one block: the largest split codes its rest in two parts", Plan(
            "full", (SCALE3,), steady(1, 0, (1,)), WHOLE, (65536,), bits=2, skew=5, constant=True)),
        "fifteen-classes": ("classes up to 14, context numbers of indices up to 225", Plan(
            "classes", (channel(Stream.SCALE, 0.5, 3),),
            (LayerRow((1,) * 9, ((1,),) * 9), LayerRow(tuple(range(1, 9)) + (8,) * 7, ((2,),) * 15)),
            WHOLE, (400,), dimension=3, spread=6)),
        "sixteen-layers": ("as many layers as there can be, the third without change", Plan(
            "sixteen", (SCALE3,), tuple(
                LayerRow((0,) * min(1 + k // 4, 4), ((max(k, 1) if k != 2 else 1,),) * min(1 + k // 4, 4))
                for k in range(16)), WHOLE, (40,), bits=8)),
        "twenty-steps": ("refined to 3^-19 of the step; results beyond both ends of the normal binary32 range", Plan(
            "steps", (Channel(Stream.SCALE, (2.0**-120, 1e-42, 2.0**96)),),
            (LayerRow((0,), ((1,),)), LayerRow((0,), ((20,),))), WHOLE, (30,), spread=0, bits=5)),
        "wide-values": ("first values up to 2^31 - 2, alphabets with wide gaps", Plan(
            "wide", (SCALE3,), steady(1, 0, (1,)), WHOLE, (30,), spread=715827882, bits=5)),
        "lattice-32": ("32 bits an axis; depth and shift at their bounds", Plan(
            "lattice", (channel(Stream.POSITION_RESIDUAL, 1 / 3, 3), SCALE3), (
                LayerRow((0,), ((3, 1),)),), (Tile(21, 11, 5), Tile(21, 0, 6), Tile(1, 31, 1), Tile(2, 9, 63)),
            (20, 30, 20, 40), bits=32, origin=(1e6, -1e-3, 0.1), voxel=1e-7)),
        "anchors": ("anchor profile: masks, offsets, two layers, three networks", Plan(
            "anchors", ANCHOR_CHANNELS, (LayerRow((1,), ((1, 1),)), LayerRow((2, 1), ((2, 1), (1, 1)))),
            SPREAD_TILES[:2], (60, 50), profile=Profile.ANCHOR, slots=10, dimension=4)),
        "anchors-32-slots": ("anchor profile: 32 slots, three layers, the latent by LATENT alone at first", Plan(
            "slots", _ANCHOR_RICH, (
                LayerRow((0,), ((0, 1, 1, 1),)), LayerRow((0, 1), ((1, 1, 2, 1), (1, 1, 0, 1))),
                LayerRow((1, 2), ((2, 2, 2, 1), (1, 2, 1, 1)))), WHOLE, (45,), profile=Profile.ANCHOR, slots=32,
            dimension=3, bits=9)),
        "annotations": ("METADATA, a thumbnail and unknown blocks; two-dimensional Gaussians", Plan(
            "annotations", (SCALE3,), steady(2, 0, (1,)), WHOLE, (12,), metadata={
                "title": "annotations", "n": [1, 2],
                "coordinate_reference": {"crs": "EPSG:25832", "origin": [565000.0, 5934000.5, -12]}},
        )),
    }
