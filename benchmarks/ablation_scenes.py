"""Scenes of the ablations: quantised once by the encoder, with any quantiser, and kept between runs.

The encoder is run as it is, but for the place where it asks for a latent and its codewords: there, this module
notes what was asked and can put another quantiser. All else, rates and layers included, is the encoder's own choice.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from benchmarks.latent import Problem, thinned
from benchmarks.report import SCRATCH
from benchmarks.scenes import Scene, chosen
from reference_encoder import pipeline
from reference_encoder.latent.fit import FittedLatent, Wanted, codebook_size, fit_latent
from reference_encoder.latent.linear import linear_latent
from reference_encoder.latent.rvq import RvqOptions, Vectors, quantise
from reference_encoder.networks.clusters import Clusters, arrange
from reference_encoder.networks.dataset import ContextOptions, IndexRows, index_rows, lattice_positions
from reference_encoder.networks.train import code_uses
from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.profiles import anchors, explicit
from reference_encoder.tuning import CONTEXT, CONTEXT_LATENTS
from scarfmt.arrays import I64
from scarfmt.blocks.tables import fit_table, pack_tables
from scarfmt.codecs.indices import put_indices
from scarfmt.coding.writer import QuantisedScene, Report
from scarfmt.container.bytefields import compress
from scarfmt.container.directory import local_bits, tile_frame
from scarfmt.entropy.emitters import SymbolCounter
from scarfmt.formats import load
from scarfmt.formats.clean import clean
from scarfmt.scene.codebooks import Codebooks

OWN = "the encoder's own"
QUANTISERS = {"RVQ, 2 stages of 1024": (1024, 2), "RVQ, 3 stages of 256": (256, 3), "VQ, 1 stage of 4096": (4096, 1)}
"""Codewords of a book and stages."""
QUALITY = 41.0
_VECTORS = 40_000
"""Vectors kept of a scene's latent problem."""


@dataclass(frozen=True)
class Encoded:
    """The encoder's decisions for a scene.

    Attributes:
        scene: with static tables.
        problem: what the latent had to represent; at most `_VECTORS` vectors, drawn evenly.
        quantiser: codewords of a book and stages.
        error: squared picture error of the latents of the last layer, what the LATENT channel adds included.
    """

    scene: QuantisedScene
    problem: Problem
    quantiser: tuple[int, int]
    error: float


@dataclass(frozen=True)
class Sample:
    """Rows of a scene to train on, and others to judge by.

    Attributes:
        train, held: rows, codes in the order of the clusters.
        train_positions, held_positions: (n, 3) lattice positions of each.
        books, clusters: of the scene, clusters' sizes per book.
        columns: inputs that say nothing of the surroundings: class and own attributes come first.
    """

    train: IndexRows
    held: IndexRows
    train_positions: I64
    held_positions: I64
    books: Codebooks
    clusters: tuple[tuple[int, ...], ...]
    columns: int


def encoded(name: str, quantiser: str = OWN) -> Encoded:
    """Scene `name` at `QUALITY`, effort 2: from an earlier run, or encoded now."""
    stem = "".join(c if c.isalnum() else "_" for c in f"{name} {quantiser}")
    path = SCRATCH / "ablation" / f"{stem}.pickle"
    if not path.exists():
        found = _encode(chosen([name])[0], quantiser)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_bytes(pickle.dumps(found))
        part.rename(path)
    kept: Encoded = pickle.loads(path.read_bytes())
    return kept


def _encode(scene: Scene, quantiser: str) -> Encoded:
    if quantiser != OWN:
        own = encoded(scene.name)
        if own.quantiser == QUANTISERS[quantiser]:
            return own
    source, _ = clean(load(scene.path), drop_invalid=True)
    options = scene.options(quality=QUALITY)
    with _watched(QUANTISERS.get(quantiser)) as asked:
        found = pipeline.quantised(source, options)
    problem, used = asked[0]
    error = 0.0 if found.targets is None else found.targets.error(found.scene)
    return Encoded(found.scene, thinned(problem, _VECTORS), used, error)


@contextmanager
def _watched(wanted: tuple[int, int] | None) -> Iterator[list[tuple[Problem, tuple[int, int]]]]:
    """Inside, the encoder's latents get `wanted` codewords and stages; yields what was asked for, to be filled."""
    asked: list[tuple[Problem, tuple[int, int]]] = []

    def fit(task: Wanted, options: EncodeOptions, report: Report) -> FittedLatent | None:
        problem = Problem(task.vectors, task.weight, task.classes, task.lambda_, task.metric)
        own = codebook_size(len(task.classes)), EFFORTS[options.effort].stages + task.extra_stages
        asked.append((problem, wanted or own))
        return fit_latent(task, options, report) if wanted is None else _fit(problem, options, *wanted)

    with mock.patch.object(explicit, "fit_latent", fit), mock.patch.object(anchors, "fit_latent", fit):
        yield asked


def _fit(problem: Problem, options: EncodeOptions, codewords: int, stages: int) -> FittedLatent | None:
    """The linear latent fitted as by `fit_latent`, with a quantiser of any size."""
    latent = linear_latent(problem.vectors, problem.weight, problem.rate * len(problem.classes), problem.metric)
    if latent is None:
        return None
    effort = EFFORTS[options.effort]
    rvq = RvqOptions(codewords, stages, problem.rate, effort.sample, effort.epochs, options.seed)
    return FittedLatent(latent, quantise(Vectors(latent.values, latent.weight, problem.classes), rvq))


@lru_cache(maxsize=1)
def sample(name: str, quantiser: str, rows: int | None, held: int) -> Sample:
    """Rows of a scene, at most `rows` to train on and `held` others, a quarter at most; without `rows`, nine tenths."""
    scene = encoded(name, quantiser).scene
    assert scene.codebooks is not None
    model = replace(scene.model, context=CONTEXT)
    latents = min(CONTEXT_LATENTS, scene.codebooks.dimension)
    seen = ContextOptions(CONTEXT.passes_log2, CONTEXT.occupancies, latents=latents)
    bits = [local_bits(scene.fields, tile) for tile in scene.tiles]
    most = None if rows is None else rows + held
    every = index_rows(model, scene.contents, bits, scene.codebooks, seen, most)
    books, clusters = arrange(scene.codebooks, _uses(every, scene.codebooks))
    every = replace(every, codes=_renumbered(every, clusters))
    positions = lattice_positions(every, scene.contents, [tile_frame(scene.fields, tile) for tile in scene.tiles])
    order = np.random.default_rng(0).permutation(len(every))
    last = np.sort(order[: min(held, len(order) // (10 if rows is None else 4))])
    first = np.setdiff1d(order, last)[:rows]
    own = sum(model.channels[index].components for index in model.attributes)
    sizes = tuple(found.sizes for found in clusters)
    parts = every.take(first), every.take(last), positions[first], positions[last]
    return Sample(*parts, books, sizes, model.layers[-1].class_count + own)


def _uses(rows: IndexRows, books: Codebooks) -> tuple[I64, I64]:
    coarse, residual = code_uses(rows, books.sizes)
    return coarse, residual


def _renumbered(rows: IndexRows, clusters: tuple[Clusters, Clusters]) -> NDArray[np.int16]:
    """(n, M) codes by the clusters' new numbers."""
    columns = [clusters[min(stage, 1)].ranks[rows.codes[:, stage]] for stage in range(rows.codes.shape[1])]
    return np.stack(columns, axis=1).astype(np.int16)


def static_bytes(scene: QuantisedScene) -> tuple[float, int, int]:
    """Bytes of all indices of a scene under the static tables a file would hold, bytes of those tables; indices."""
    counter, last, symbols = SymbolCounter(), len(scene.model.layers), 0
    for content in scene.contents:
        stages = scene.model.stages(last, content.classes)
        symbols += int(stages.sum())
        put_indices(counter, content.indices, content.classes, np.zeros_like(stages), stages)
    tables = {key: fit_table(*pair) for key, pair in counter.histograms().items()}
    bits = sum(tables[key].cost_of_counts(*pair) for key, pair in counter.histograms().items())
    return bits / 8, len(compress(pack_tables(tables))), symbols
