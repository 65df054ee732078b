"""Small files that ask for much: within and beyond what every reader does for a file of their length (SPEC §13.2)."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from conformance.decoders.python.decoder import Decoder
from conformance.decoders.python.work import Declared, Work
from conformance.scenes.cases import Case
from conformance.scenes.made import ANCHOR_CHANNELS, EVERY_CHANNEL, REFINED_ROWS, SPREAD_TILES, Plan, build, channel
from conformance.scenes.neural_models import GridPlan, NetworkPlan, PredictorPlan
from conformance.surgery.files import blocks_of, numbers_of
from conformance.surgery.parts import TILE_KIND, Parts, take_apart
from conformance.writer.file import write_file
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import Profile, Stream
from scarfmt.neural.grid import GridLevel
from scarfmt.scene.model import DecodedContext, LayerRow

_FREE_WORK, _WORK_PER_BYTE = 1 << 32, 1 << 17
_FREE_NUMBERS, _NUMBERS_PER_BYTE = 1 << 20, 2
_WIDTHS = (1, 1024, 1014, 3)
"""Nearly as many numbers as every reader takes, nearly all of them weights."""
_PRIVATE = 200
_MOST_ANCHORS, _ENOUGH = 1 << 16, 100
_ROOM = 100
"""Bytes by which ROOT and pages may grow with the counts in them."""


def work_cases() -> Iterator[Case]:
    """Files within the limits of work and of adaptive numbers, and beyond them."""
    rules: tuple[str, ...] = ("R-13.2-1",)
    within, beyond = _wide_scene(1900), _wide_scene(2300)
    _check_sides(len(write_file(within)), len(write_file(beyond)))
    yield Case("edge/limit-work-met", "a wide network for 1900 anchors in a cell, near the most that a reader must do",
               write_file(within), (*rules, "R-7.9-1"), scene=within)
    yield Case("either/limit-work", "a wide network for 2300 anchors in a cell, more than a reader must do",
               write_file(beyond), rules, scene=beyond, refusals=("limit-work",), stage="models")
    met, more = _scene_of_numbers(0), _scene_of_numbers(1)
    yield Case("edge/limit-numbers-met", "as many adaptive numbers as every reader takes", write_file(met), rules,
               scene=met)
    yield Case("either/limit-expansion-numbers", "an adaptive number more than every reader takes", write_file(more),
               rules, scene=more, refusals=("limit-expansion",), stage="models")
    yield from _pairs()


def _wide_scene(count: int, codewords: int = 1) -> QuantisedScene:
    """Anchors that nothing distinguishes, a DECODER_MLP of zeros, and codewords of 0."""
    plan = Plan(
        "work", (channel(Stream.SCALE, 0.5, 3),), (LayerRow((1,), ((1,),)),), (Tile(0, 1, 0),),
        (count,), bits=1, dimension=_WIDTHS[0], codewords=(codewords, 1), constant=True,
    )  # fmt: skip
    scene = build(plan)
    assert scene.codebooks is not None
    scene.codebooks.coarse[:] = 0
    return replace(scene, decoder=_zeros(*_WIDTHS))


def _zeros(*widths: int) -> QuantisedMlp:
    return QuantisedMlp(tuple(
        Linear(np.zeros((rows, columns), np.int16), np.zeros(rows, np.float32), np.zeros(rows, np.float32))
        for columns, rows in itertools.pairwise(widths)
    ))


def _check_sides(within: int, beyond: int) -> None:
    """Two multiply-adds a weight and anchor are nearly all the work; that the rest is below 2^26 decides nothing."""
    weights = sum(rows * columns for columns, rows in itertools.pairwise(_WIDTHS))
    if not 2 * weights * 1900 + (1 << 26) < _FREE_WORK + _WORK_PER_BYTE * within:
        raise ValueError("edge/limit-work-met is beyond the limit")
    if not 2 * weights * 2300 > _FREE_WORK + _WORK_PER_BYTE * beyond:
        raise ValueError("either/limit-work is within the limit")


def _scene_of_numbers(more: int) -> QuantisedScene:
    """A scene whose file has so many numbers more than every reader takes of one of its length."""
    size = 1
    while True:
        scene = _wide_scene(3, size)
        data = write_file(scene)
        found = sum(len(numbers_of(block.payload, block.kind)) for block in blocks_of(data))
        missing = _FREE_NUMBERS + _NUMBERS_PER_BYTE * len(data) + more - found
        if missing == 0:
            return scene
        size += missing


def _pairs() -> Iterator[Case]:
    """Pairs of files a byte apart, on either side of the limit of work: who counts too much refuses both.

    Nothing is decoded of them: every TILE block has a wrong CRC, which comes after the limit (R-12.2-1, 7 and 8). So a
    directory may declare anchors that no stream tells of. An unknown block fills a file up to the length at which its
    work is just within the limit; a byte less, and it is beyond. Together the scenes have every term of the formula.
    """
    for name, plan, width in _PLANS:
        data = write_file(_costly(build(plan), width))
        within, beyond = _pair(data)
        yield Case(f"invalid/work-{name}-within", f"work of {name} just within the limit: a CRC of a tile is the fault",
                   within, ("R-5.6-1", "R-12.2-1", "R-13.2-1"), refusals=("crc-mismatch",))
        yield Case(f"either/work-{name}-beyond", "the same file a byte shorter: its work is beyond the limit", beyond,
                   ("R-13.2-1",), refusals=("limit-work", "crc-mismatch"), stage="models")


def _costly(scene: QuantisedScene, width: int) -> QuantisedScene:
    """The scene with networks of zeros, `width` hidden units wide: few bytes, much work."""
    mlps = tuple(_zeros(net.inputs, width, net.outputs) for net in scene.scene_mlps)
    decoder = scene.decoder
    return replace(scene, decoder=decoder and _zeros(decoder.inputs, width, decoder.outputs), scene_mlps=mlps)


def _pair(data: bytes) -> tuple[bytes, bytes]:
    """The file with as many anchors as reach the limit, and filled up to it; and that a byte shorter."""
    work = Work(Decoder(data))
    # Beyond 17 anchors of a tile, one more costs what the next does.
    start = [work.total(_declare(_with_anchors(data, count))) for count in (_ENOUGH, _ENOUGH + 1)]
    shortest = len(_fill(data, 0, 1))
    missing = _FREE_WORK + _WORK_PER_BYTE * (shortest + _ROOM) - start[0]
    more = _ENOUGH + -(-missing // (start[1] - start[0]))
    total = work.total(_declare(_with_anchors(data, more)))
    size = _least_size(data, more, total)
    within, beyond = _fill(data, more, size), _fill(data, more, size - 1)
    if not _FREE_WORK + _WORK_PER_BYTE * len(beyond) < total <= _FREE_WORK + _WORK_PER_BYTE * len(within):
        raise ValueError("the pair is not on both sides of the limit of work")
    return within, beyond


def _least_size(data: bytes, more: int, total: int) -> int:
    """Bytes of the block that fills a file up to where its work is allowed; ROOT grows a little with them."""
    least = -(-(total - _FREE_WORK) // _WORK_PER_BYTE)
    size = 1
    while (short := least - len(_fill(data, more, size))) > 0:
        size += short
    while len(_fill(data, more, size - 1)) >= least:
        size -= 1
    return size


def _declare(parts: Parts) -> Declared:
    return [(e["layer"], e["tile"], e["count"]) for e in parts.entries if e["kind"] == TILE_KIND]


def _with_anchors(data: bytes, more: int) -> Parts:
    """The parts of the file with more anchors in the first layer of its tiles, as the directory says."""
    parts = take_apart(data)
    left = more
    for entry in parts.entries:
        if entry["kind"] == TILE_KIND and entry["layer"] == 1:
            added = min(left, _MOST_ANCHORS - entry["count"])
            entry["count"] += added
            left -= added
    if left:
        raise ValueError(f"no room for {left} anchors")
    for layer in parts.layers:
        layer["anchor_count"] += more
        layer["gaussian_count"] += 0 if parts.header["profile"] else more
    return parts


def _fill(data: bytes, more: int, size: int) -> bytes:
    parts = _with_anchors(data, more)
    parts.add(bytes(size), kind=_PRIVATE, layer=len(parts.layers))
    parts.settle()
    for entry in parts.entries:
        if entry["kind"] == TILE_KIND:
            entry["crc32"] ^= 1
    return parts.seal()


_BIG_GRID = GridPlan((0, 0, 0), 16, (GridLevel(0, 40, 12, 2), GridLevel(1, 5, 6, 1)))
_SCALE_COLOUR = (channel(Stream.SCALE, 0.5, 3), channel(Stream.COLOUR, 0.1, 3))
_DEEP = (
    LayerRow((1, 2), ((1, 1), (1, 1)), True), LayerRow((2, 2, 0), ((2, 2), (2, 2), (1, 1)), True),
    LayerRow((4, 3, 8), ((2, 2), (3, 3), (2, 2)), True),
)
_MODES = (
    LayerRow((1,), ((1, 1),)), LayerRow((2,), ((2, 2),), True), LayerRow((3,), ((2, 2),)),
    LayerRow((5, 1), ((3, 3), (1, 1)), True),
)
_PLANS = (
    ("channels", Plan("work channels", EVERY_CHANNEL, REFINED_ROWS, SPREAD_TILES, (9, 5, 0, 20), degree=2,
                      dimension=5), 256),
    ("predictors", Plan(
        "work predictors", EVERY_CHANNEL, REFINED_ROWS, SPREAD_TILES, (12, 9, 0, 17), degree=2, dimension=5,
        context=DecodedContext(2, (40, 5)), predictors=(
            PredictorPlan(Stream.SCALE, 0, 1, 4), PredictorPlan(Stream.SCALE, 2, 1, 0),
            PredictorPlan(Stream.SCALE, 1, 2, 3), PredictorPlan(Stream.ROTATION, 2, 3, 5),
            PredictorPlan(Stream.OPACITY, 0, 1, 64, (16, 16), 15),
        )), 128),
    ("deep", Plan(
        "work deep", _SCALE_COLOUR, _DEEP, SPREAD_TILES, (14, 9, 0, 6), degree=1, dimension=5,
        codewords=(300, 200), context=DecodedContext(2, (30, 4)), network=NetworkPlan(
            bits=12, widths=(7, 16, 9), dims=5, layers=2, latents=3, classes=3, attention=True),
        grid=_BIG_GRID), 128),
    ("modes", Plan(
        "work modes", _SCALE_COLOUR, _MODES, SPREAD_TILES[:1], (12,), degree=1, dimension=4, codewords=(120, 80),
        context=DecodedContext(1, (20, 3)), predictors=(PredictorPlan(Stream.SCALE, 1, 2, 3),),
        network=NetworkPlan(widths=(5, 16, 6), latents=4, layers=2)), 768),
    ("anchors", Plan(
        "work anchors", ANCHOR_CHANNELS, (
            LayerRow((1,), ((1, 1),), True), LayerRow((3, 1), ((2, 1), (1, 1)), True)), SPREAD_TILES[:2], (15, 11),
        profile=Profile.ANCHOR, slots=5, dimension=4, context=DecodedContext(1, (16, 4)),
        predictors=(PredictorPlan(Stream.SCALE, 0, 1, 3), PredictorPlan(Stream.SCALE, 5, 2, 3)),
        network=NetworkPlan(latents=2)), 512),
)
