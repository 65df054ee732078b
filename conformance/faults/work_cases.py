"""Small files that ask for much: within and beyond what every reader does for a file of their length (SPEC §13.2)."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from conformance.scenes.cases import Case
from conformance.scenes.made import Plan, build, channel
from conformance.surgery.files import vector_file
from conformance.writer.frames import BlockForm, FrameStyle
from conformance.writer.options import WriteOptions
from conformance.writer.tables import table_of
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.scene.model import LayerRow

_RUNS = WriteOptions(frames=dict.fromkeys((BlockKind.TABLES, BlockKind.DECODER_MLP), FrameStyle(BlockForm.RUNS)))
_WIDTHS = (64, 1024, 1024, 3)
_FREE_WORK, _WORK_PER_BYTE = 1 << 32, 1 << 17
_IDLE_TABLES = 160


def work_cases() -> Iterator[Case]:
    """One file within the limit of work, one beyond it, one beyond the limit of content."""
    rules = ("R-13.2-1",)
    within, beyond = (vector_file(_wide_scene(count), options=_RUNS) for count in (1900, 2300))
    _check_sides(len(within), len(beyond))
    yield Case("edge/limit-work-met", "a wide network for 1900 anchors in a cell, near the most that a reader must do",
               within, rules, scene=_wide_scene(1900))  # fmt: skip
    yield Case("either/limit-work", "a wide network for 2300 anchors in a cell, more than a reader must do", beyond,
               rules, scene=_wide_scene(2300), refusals=("limit-work",), stage="models")  # fmt: skip
    yield Case("either/limit-expansion-tables", "1.3 MB of tables that code nothing, in a small frame",
               vector_file(_wide_scene(3), options=_with_idle_tables()), (*rules, "R-8.3-4"), scene=_wide_scene(3),
               refusals=("limit-expansion",), stage="models")  # fmt: skip


def _wide_scene(count: int) -> QuantisedScene:
    """Anchors that nothing distinguishes, and a DECODER_MLP of zeros, 1.1 million of them."""
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


def _with_idle_tables() -> WriteOptions:
    table = table_of(tuple(range(4096)), (1,) * 4096)
    keys = (TableKey(Stream.SCALE, 0, 2, context) for context in range(_IDLE_TABLES))
    return replace(_RUNS, tables={1: dict.fromkeys(keys, table)})
