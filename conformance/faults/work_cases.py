"""Small files that ask for much: within and beyond what every reader does for a file of their length (SPEC §13.2)."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from conformance.scenes.cases import Case
from conformance.scenes.made import Plan, build, channel
from conformance.surgery.files import blocks_of, numbers_of
from conformance.writer.file import write_file
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import Stream
from scarfmt.scene.model import LayerRow

_FREE_WORK, _WORK_PER_BYTE = 1 << 32, 1 << 17
_FREE_NUMBERS, _NUMBERS_PER_BYTE = 1 << 20, 2
_WIDTHS = (1, 1024, 1014, 3)
"""Nearly as many numbers as every reader takes, nearly all of them weights."""


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


def _wide_scene(count: int, codewords: int = 1) -> QuantisedScene:
    """Anchors that nothing distinguishes, a DECODER_MLP of zeros, and codewords of 0."""
    plan = Plan(
        "work", (channel(Stream.SCALE, 0.5, 3),), (LayerRow((1,), ((1,),)),), (Tile(0, 1, 0),),
        (count,), bits=1, dimension=_WIDTHS[0], codewords=(codewords, 1), constant=True,
    )  # fmt: skip
    layers = tuple(
        Linear(np.zeros((rows, columns), np.int16), np.zeros(rows, np.float32), np.zeros(rows, np.float32))
        for columns, rows in itertools.pairwise(_WIDTHS)
    )
    scene = build(plan)
    assert scene.codebooks is not None
    scene.codebooks.coarse[:] = 0
    return replace(scene, decoder=QuantisedMlp(layers))


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
