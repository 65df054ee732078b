"""The steps of one range as tasks: each reads what it needs from the work directory and leaves there what it makes.

Arguments and results are small. What a process reads for one task it keeps for the next, as long as it is the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from reference_encoder.importance.view_sampling import ViewSet
from reference_encoder.options import EncodeOptions
from reference_encoder.out_of_core import bins, code, judge, measure, opening, overview
from reference_encoder.out_of_core.fit import Fit, apply
from reference_encoder.out_of_core.overview import Overview
from reference_encoder.out_of_core.source import Chunk
from reference_encoder.out_of_core.types import Bounds, Histograms, Models, Range, Rows
from reference_encoder.out_of_core.work_dir import WorkDir, file_name, file_version
from scarfmt.arrays import F64, I64, U8
from scarfmt.container.file import Block
from scarfmt.scene.gaussians import GaussianScene, concatenate

SCENE, OVERVIEW, FIT, MODELS = "scene", "overview", "fit", "models"
"""Names of files of which there is one."""
_CACHED = 4


@dataclass(frozen=True)
class Scene:
    """A scene as tasks know it, once it is divided into ranges.

    Attributes:
        bounds: of it.
        ranges: into which it is divided.
        chunks: files of rows.
        clean: whether all Gaussians of the source can be encoded.
        options: of the encoder.
    """

    bounds: Bounds
    ranges: tuple[Range, ...]
    chunks: int
    clean: bool
    options: EncodeOptions


@lru_cache(_CACHED)
def _read(work: WorkDir, name: str, _version: str) -> Any:
    return work.get(name)


def read_cached(work: WorkDir, name: str) -> Any:
    """An object that many tasks need, read again only when its file has changed."""
    return _read(work, name, str(file_version(work.path(name))))


def _scene(work: WorkDir) -> Scene:
    found: Scene = read_cached(work, SCENE)
    return found


def _overview(work: WorkDir) -> Overview:
    found: Overview = read_cached(work, OVERVIEW)
    return found


def _range(work: WorkDir, number: int) -> tuple[Range, GaussianScene]:
    scene = _scene(work)
    return scene.ranges[number], bins.load_range(work, scene.chunks, scene.bounds, number)


def bin_rows(work: WorkDir, chunk: Chunk) -> I64:
    """Write the rows of a chunk by range; as :func:`reference_encoder.out_of_core.bins.bin_chunk`."""
    scene = _scene(work)
    return bins.bin_chunk(work, chunk, scene.bounds, scene.clean, scene.ranges)


def summarise_range(work: WorkDir, number: int) -> None:
    """Keep the summary of a range."""
    scene, (part, rows) = _scene(work), _range(work, number)
    work.put(file_name("summaries", number), overview.summarise_range(rows, part, scene.bounds, scene.options))


def build_overview(work: WorkDir) -> tuple[int, ...]:
    """Keep the overview of all ranges; gives the numbers of the ranges by which results are judged."""
    scene = _scene(work)
    summaries = [work.get(file_name("summaries", part.number)) for part in scene.ranges]
    found = overview.build_overview(summaries, scene.ranges, scene.bounds, scene.options)
    work.put(OVERVIEW, found)
    return found.judging


def measure_range(work: WorkDir, number: int) -> None:
    """Keep the importance of the Gaussians of a range, and a sample of them."""
    part, rows = _range(work, number)
    found = measure.measure(_overview(work), part, rows)
    work.put(file_name("measured", number), found)
    work.put(file_name("samples", number), measure.sample_range(_overview(work), part, rows, found))


def render_range(work: WorkDir, number: int, view_set: ViewSet) -> None:
    """Keep pictures of the source to judge a range by."""
    (part, rows), measured = _range(work, number), work.get(file_name("measured", number))
    found = judge.render_pictures(_overview(work), part, rows, measured, view_set)
    work.put(file_name(f"pictures-{view_set.name.lower()}", number), found)


def judge_range(work: WorkDir, number: int, fit: str, view_set: ViewSet) -> F64:
    """Judge a range: what it adds to errors of pictures under a Fit of that name."""
    shown = work.get(file_name(f"pictures-{view_set.name.lower()}", number))
    return judge.judge(_overview(work), read_cached(work, fit), _scene(work).ranges[number], shown)


def apply_range(work: WorkDir, number: int) -> None:
    """Decide all integers of a range; keep its symbols, how often each comes, and the boxes of its tiles."""
    part, rows = _range(work, number)
    fit: Fit = read_cached(work, FIT)
    scene, losses = apply(_overview(work), fit, part, rows, work.get(file_name("measured", number)))
    counted, symbols = code.count_symbols(scene, losses)
    work.put(file_name("symbols", number), symbols)
    work.put(file_name("histograms", number), counted)
    work.put(file_name("boxes", number), opening.measure_range_boxes(scene))


def build_models(work: WorkDir, metadata: dict[str, Any]) -> None:
    """Keep the models of the file, from histograms of all its ranges, of which few are in memory at once."""
    found: list[Histograms] = []
    for part in _scene(work).ranges:
        found = [code.add_histograms([*found, work.get(file_name("histograms", part.number))])]
    work.put(MODELS, code.build_models(_overview(work), read_cached(work, FIT), found[0], metadata))


def code_range(work: WorkDir, number: int) -> Rows:
    """Keep the TILE blocks of a range, layer after layer; gives what the directory says of them."""
    models: Models = read_cached(work, MODELS)
    symbols, layers, sizes = work.get(file_name("symbols", number)), list[U8](), list[I64]()
    with work.write(file_name("segments", number)) as stream:
        for rows, stream_bytes, payload in code.code_layers(models, symbols):
            stream.write(payload)
            layers.append(rows)
            sizes.append(stream_bytes)
    return Rows(symbols[0], tuple(layers), np.stack(sizes))


def make_opening_blocks(work: WorkDir, size: int) -> tuple[Block, ...]:
    """The blocks that a client begins with, of a file whose other blocks have so many bytes."""
    numbers = range(len(_scene(work).ranges))
    sample = concatenate([work.get(file_name("summaries", number))[0] for number in numbers])
    boxes = opening.join_boxes([work.get(file_name("boxes", number)) for number in numbers])
    return opening.make_opening_blocks(_overview(work), sample, boxes, size)
