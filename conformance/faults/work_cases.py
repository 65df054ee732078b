"""Small files that ask for much: within and beyond what every reader does for a file of their length (SPEC §13.2)."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from conformance.decoders.python.models import parse_tables
from conformance.scenes.cases import Case
from conformance.scenes.container_scenes import plain_scene
from conformance.scenes.made import Plan, build, channel
from conformance.surgery.files import blocks_of, vector_file
from conformance.writer.options import WriteOptions
from conformance.writer.tables import table_of
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.scene.model import LayerRow

_WIDTHS = (64, 1024, 853, 128, 3)
_FREE_WORK, _WORK_PER_BYTE = 1 << 32, 1 << 17
_FREE_SYMBOLS, _LARGEST = 1 << 16, 4096


def work_cases() -> Iterator[Case]:
    """Files within the limits of work and of symbols of tables, and beyond them."""
    rules: tuple[str, ...] = ("R-13.2-1",)
    within, beyond = (vector_file(_wide_scene(count)) for count in (1900, 2300))
    _check_sides(len(within), len(beyond))
    yield Case("edge/limit-work-met", "2^20 weights for 1900 anchors in a cell, near the most that a reader must do",
               within, (*rules, "R-7.9-1"), scene=_wide_scene(1900))  # fmt: skip
    yield Case("either/limit-work", "a wide network for 2300 anchors in a cell, more than a reader must do", beyond,
               rules, scene=_wide_scene(2300), refusals=("limit-work",), stage="models")  # fmt: skip
    scene, rules = plain_scene(), (*rules, "R-8.3-4")
    yield Case("edge/limit-tables-met", "as many symbols of tables, which code nothing, as every reader takes",
               _with_idle_tables(0), rules, scene=scene)  # fmt: skip
    yield Case("either/limit-expansion-tables", "a symbol of tables more than every reader takes",
               _with_idle_tables(1), rules, scene=scene, refusals=("limit-expansion",), stage="models")  # fmt: skip


def _wide_scene(count: int) -> QuantisedScene:
    """Anchors that nothing distinguishes, and a DECODER_MLP of 2^20 zeros, the most that it may have."""
    plan = Plan(
        "work", (channel(Stream.SCALE, 0.5, 3),), (LayerRow((1,), ((1,),)),), (Tile(0, 1, 0),),
        (count,), bits=1, dimension=_WIDTHS[0], codewords=(1, 1), constant=True,
    )  # fmt: skip
    layers = tuple(
        Linear(np.zeros((rows, columns), np.int16), np.zeros(rows, np.float32), np.zeros(rows, np.float32))
        for columns, rows in itertools.pairwise(_WIDTHS)
    )
    return replace(build(plan), decoder=QuantisedMlp(layers))


def _check_sides(within: int, beyond: int) -> None:
    """Two multiply-adds a weight and anchor are nearly all the work; that the rest is below 2^26 decides nothing."""
    weights = sum(rows * columns for columns, rows in itertools.pairwise(_WIDTHS))
    if not 2 * weights * 1900 + (1 << 26) < _FREE_WORK + _WORK_PER_BYTE * within:
        raise ValueError("edge/limit-work-met is beyond the limit")
    if not 2 * weights * 2300 > _FREE_WORK + _WORK_PER_BYTE * beyond:
        raise ValueError("either/limit-work is within the limit")


def _with_idle_tables(more: int) -> bytes:
    """A file that has so many symbols of tables more than every reader takes of one of its length."""
    last = 1
    while True:
        sizes = [*[_LARGEST] * (_FREE_SYMBOLS // _LARGEST), last]
        idle = {TableKey(Stream.SCALE, 0, 20, i): table_of(range(size), (1,) * size) for i, size in enumerate(sizes)}
        data = vector_file(plain_scene(), options=WriteOptions(tables={1: idle}))
        tables = [parse_tables(block.payload) for block in blocks_of(data) if block.kind == BlockKind.TABLES]
        found = sum(len(values) for sent in tables for values, _ in sent.values())
        if found == _FREE_SYMBOLS + len(data) + more:
            return data
        last += _FREE_SYMBOLS + len(data) + more - found
