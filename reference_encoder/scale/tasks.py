"""The steps of one range as tasks: each reads what it needs from the work directory and leaves there what it makes.

Arguments and results are small. What a process reads for one task it keeps for the next, as long as it is the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from reference_encoder.judge.views import Sight
from reference_encoder.options import EncodeOptions
from reference_encoder.scale.applied import apply
from reference_encoder.scale.bins import bin_chunk, load_range
from reference_encoder.scale.coded import code, histograms, reduce, together
from reference_encoder.scale.fit import Fit
from reference_encoder.scale.glance import Overview, glance, overlook
from reference_encoder.scale.judged import judge, pictures
from reference_encoder.scale.measured import measure
from reference_encoder.scale.places import version
from reference_encoder.scale.sample import sample
from reference_encoder.scale.source import Chunk
from reference_encoder.scale.steps import Bounds, Judged, Models, Range, RangeContent, Sample, Segment
from reference_encoder.scale.trained import some_tiles, train
from reference_encoder.scale.work import Work
from scarfmt.arrays import I64
from scarfmt.container.directory import Tile
from scarfmt.scene.gaussians import GaussianScene

SCENE, OVERVIEW, FIT, TRAINED, MODELS = "scene", "overview", "fit", "trained", "models"
"""Names of files of which there is one."""
FOLDERS = (
    *("bins", "glances", "measured", "samples", "pictures-loop", "pictures-report", "fits"),
    *("contents", "drawn", "histograms", "symbols", "sums", "segments"),
)
"""Folders of files of which there are several; those of counts are named by their depth."""
_KEPT = 4


@dataclass(frozen=True)
class Scene:
    """A scene as tasks know it, once it is cut.

    Attributes:
        bounds: of it.
        ranges: into which it is cut.
        chunks: files of rows.
        clean: whether all Gaussians of the source can be encoded.
        options: of the encoder.
    """

    bounds: Bounds
    ranges: tuple[Range, ...]
    chunks: int
    clean: bool
    options: EncodeOptions


@dataclass(frozen=True)
class LayerRows:
    """The TILE blocks of one layer of a range, without their bytes; attributes as those of `steps.LayerSegment`."""

    tiles: I64
    lengths: I64
    counts: I64
    checksums: I64
    stream_bytes: tuple[int, ...]


@dataclass(frozen=True)
class Rows:
    """A range as the file has it, without the bytes of its blocks; attributes as those of `steps.Segment`."""

    tiles: tuple[Tile, ...]
    layers: tuple[LayerRows, ...]


def numbered(folder: str, number: int) -> str:
    """The name of a file of which every range has one."""
    return f"{folder}/{number:06}"


@lru_cache(_KEPT)
def _read(work: Work, name: str, _version: str) -> Any:
    return work.get(name)


def kept(work: Work, name: str) -> Any:
    """An object that many tasks need, read again only when its file has changed."""
    return _read(work, name, str(version(work.path(name))))


def scene_of(work: Work) -> Scene:
    """Load what is known of the scene."""
    found: Scene = kept(work, SCENE)
    return found


def _overview(work: Work) -> Overview:
    found: Overview = kept(work, OVERVIEW)
    return found


def _fit(work: Work, name: str = FIT) -> Fit:
    found: Fit = kept(work, name)
    return found


def _range(work: Work, number: int) -> tuple[Range, GaussianScene]:
    scene = scene_of(work)
    return scene.ranges[number], load_range(work, scene.chunks, scene.bounds, number)


def bin_rows(work: Work, chunk: Chunk) -> I64:
    """Write the rows of a chunk by range; as :func:`reference_encoder.scale.bins.bin_chunk`."""
    scene = scene_of(work)
    return bin_chunk(work, chunk, scene.bounds, scene.clean, scene.ranges)


def glance_range(work: Work, number: int) -> None:
    """Keep what a range tells of the whole."""
    scene, (part, rows) = scene_of(work), _range(work, number)
    work.put(numbered("glances", number), glance(rows, part, scene.bounds, scene.options))


def overlook_scene(work: Work) -> tuple[int, ...]:
    """Keep what all ranges tell; gives the numbers of the ranges by which results are judged."""
    scene = scene_of(work)
    glances = [work.get(numbered("glances", part.number)) for part in scene.ranges]
    overview = overlook(glances, scene.ranges, scene.bounds, scene.options)
    work.put(OVERVIEW, overview)
    return overview.judging


def measure_range(work: Work, number: int) -> None:
    """Keep what the Gaussians of a range weigh, and a sample of them."""
    part, rows = _range(work, number)
    found = measure(_overview(work), part, rows)
    work.put(numbered("measured", number), found)
    work.put(numbered("samples", number), sample(_overview(work), part, rows, found))


def samples_of(work: Work) -> list[Sample]:
    """The samples of all ranges."""
    return [work.get(numbered("samples", part.number)) for part in scene_of(work).ranges]


def picture_range(work: Work, number: int, sight: Sight) -> None:
    """Keep pictures of the source to judge a range by."""
    (part, rows), measured = _range(work, number), work.get(numbered("measured", number))
    work.put(numbered(f"pictures-{sight.name.lower()}", number), pictures(_overview(work), part, rows, measured, sight))


def judge_range(work: Work, number: int, fit: str, sight: Sight) -> Judged:
    """Judge a range: what it adds to errors of pictures under a Fit of that name."""
    shown = work.get(numbered(f"pictures-{sight.name.lower()}", number))
    return judge(_overview(work), _fit(work, fit), scene_of(work).ranges[number], shown)


def apply_range(work: Work, number: int) -> int:
    """Decide all integers of a range; gives its number of anchors.

    Where predictors will be trained, the integers are kept, and some tiles by themselves; else the symbols at once.
    """
    part, rows = _range(work, number)
    overview = _overview(work)
    content = apply(overview, _fit(work), part, rows, work.get(numbered("measured", number)))
    if overview.options.trains_networks:
        work.put(numbered("contents", number), content)
        work.put(numbered("drawn", number), some_tiles(overview, part, content))
    else:
        _keep_symbols(work, number, content)
    return sum(len(tile) for tile in content.contents)


def train_scene(work: Work, ranges: int, anchors: int) -> None:
    """Keep the Fit with the predictors of the file."""
    tiles = [work.get(numbered("drawn", number)) for number in range(ranges)]
    work.put(TRAINED, train(_overview(work), _fit(work), tiles, anchors))


def count_symbols(work: Work, number: int) -> None:
    """Keep the symbols of a range whose integers were kept, and how often each comes."""
    _keep_symbols(work, number, work.get(numbered("contents", number)))


def _coding_fit(work: Work) -> Fit:
    """The Fit with the predictors of the file, if there are any."""
    return _fit(work, TRAINED if scene_of(work).options.trains_networks else FIT)


def _keep_symbols(work: Work, number: int, content: RangeContent) -> None:
    counted, symbols = histograms(_coding_fit(work), content)
    work.put(numbered("symbols", number), symbols)
    work.put(numbered("histograms", number), counted)


def add_histograms(work: Work, name: str, numbers: Sequence[int]) -> None:
    """Keep the histograms of some ranges as one."""
    work.put(name, together([work.get(numbered("histograms", number)) for number in numbers]))


def reduce_scene(work: Work, names: Sequence[str], metadata: dict[str, Any]) -> None:
    """Keep the models of the file, from histograms of all its ranges."""
    work.put(MODELS, reduce(_overview(work), _coding_fit(work), [work.get(name) for name in names], metadata))


def code_range(work: Work, number: int) -> Rows:
    """Keep the TILE blocks of a range, layer after layer; gives what the directory says of them."""
    models: Models = kept(work, MODELS)
    return keep_segment(work, number, code(models, work.get(numbered("symbols", number))))


def keep_segment(work: Work, number: int, segment: Segment) -> Rows:
    """Keep the bytes of a range's blocks; gives the rest."""
    with work.write(numbered("segments", number)) as stream:
        for layer in segment.layers:
            stream.write(layer.payload)
    rows = (LayerRows(one.tiles, one.lengths, one.counts, one.checksums, one.stream_bytes) for one in segment.layers)
    return Rows(segment.tiles, tuple(rows))
