"""The bytes that integer networks save: the same symbols under static tables, with predictors, with the index network.

    python -m benchmarks.gain                              the scenes of `SCENES`, quality 41
    python -m benchmarks.gain --scenes plush-dog --qualities 47
    python -m benchmarks.gain --short --no-write           the example scene, hardly trained, printed
    python -m benchmarks.gain --report                     only rewrite the table

All model bytes are counted: tables, predictors, network, grid. Codewords are not chosen again, so the decoded scene
is the same in every column. Results are merged into benchmarks/results/gain.json; the table is in docs/benchmarks.md.
The files are kept; what they cost to decode is told by `benchmarks.time_error`.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from benchmarks import child
from benchmarks.child import note_path
from benchmarks.encoded import kept_path
from benchmarks.report import add_arguments, dated, load_results, replace_section, save_results, table
from benchmarks.scenes import Scene, chosen
from reference_encoder import pipeline
from reference_encoder.networks import candidates as neural
from reference_encoder.networks import defaults
from reference_encoder.networks.candidates import with_index_network, with_predictors
from reference_encoder.networks.clusters import Clusters
from reference_encoder.networks.file_costs import index_bytes
from reference_encoder.networks.train import TrainOptions
from reference_encoder.options import EncodeOptions
from scarfmt.coding.writer import QuantisedScene, silent, write_scene
from scarfmt.engines import best_engine
from scarfmt.formats import load
from scarfmt.formats.clean import clean
from scarfmt.scene.codebooks import Codebooks

NAME = "gain"
SCENES = ["plush-toys", "plush-on-bed", "plush-dog", "plush-on-bed, anchors"]
"""Measured unless scenes are named: one of each size and profile, for training takes its time."""
QUALITIES = (41.0,)
STATIC, PREDICTED, NEURAL, FLAT = "static", "predictors", "network", "network, flat head"
_SHORT_EPOCHS = 1


def quantised(scene: Scene, options: EncodeOptions) -> QuantisedScene:
    """The encoder's decisions for a scene, before any network."""
    source, _ = clean(load(scene.path), drop_invalid=True)
    return pipeline.quantised(source, options).scene


@contextmanager
def flat_heads() -> Iterator[None]:
    """Inside, the encoder makes index networks that code a codeword at once, without clusters."""

    def unarranged(books: Codebooks, _uses: Any) -> tuple[Codebooks, tuple[Clusters, Clusters]]:
        flat = [Clusters(np.arange(len(book)), ()) for book in (books.coarse, books.residual)]
        return books, (flat[0], flat[1])

    with mock.patch.object(neural, "arrange", unarranged):
        yield


@contextmanager
def hardly_trained() -> Iterator[None]:
    """Inside, index networks are trained for an epoch: files of the right form, sooner."""
    whole = defaults.training_for

    def little(rows: int, effort: int, seed: int) -> TrainOptions:
        return replace(whole(rows, effort, seed), epochs=_SHORT_EPOCHS)

    with mock.patch.object(neural, "training_for", little):
        yield


def make(job: dict[str, Any]) -> dict[str, Any]:
    """Child job: write the files of a scene that are missing, and how long each kind took to make beside them."""
    scene = chosen([job["scene"]])[0]
    options = scene.options(quality=job["quality"], effort=job["effort"], archive=True)
    with hardly_trained() if job["effort"] == 1 else nullcontext():
        plain = quantised(scene, options)
        began = time.perf_counter()
        predicted = with_predictors(plain, options, silent) or plain
        _keep(job["paths"][STATIC], plain, len_of(plain), 0.0)
        _keep(job["paths"][PREDICTED], predicted, len_of(plain), time.perf_counter() - began)
        for kind, heads in ((NEURAL, nullcontext()), (FLAT, flat_heads())):
            if kind in job["paths"]:
                began = time.perf_counter()
                with heads:
                    learned = with_index_network(predicted, options, silent)
                made = predicted if learned is None else learned.scene
                _keep(job["paths"][kind], made, len_of(plain), time.perf_counter() - began)
    return {}


def len_of(scene: QuantisedScene) -> int:
    """Anchors of a scene."""
    return sum(len(content) for content in scene.contents)


def _keep(path: str, scene: QuantisedScene, anchors: int, seconds: float) -> None:
    note = {"anchors": anchors, "seconds": seconds}
    note_path(Path(path)).write_text(json.dumps(note), encoding="utf-8")
    Path(path).write_bytes(write_scene(scene, engine=best_engine()))


def files(scene: Scene, quality: float, effort: int = 2, kinds: Sequence[str] = (NEURAL,)) -> dict[str, dict[str, Any]]:
    """Files of one scene's symbols, by kind: static tables, with predictors, and with the networks of `kinds`.

    Those that are there are used again; with effort 1, networks are hardly trained.

    Returns:
        By kind: ``path``, ``bytes``, ``anchors``, and ``seconds`` that its own models took.
    """
    wanted = (STATIC, PREDICTED, *kinds)
    paths = {kind: kept_path(scene, f"gain {kind} q{quality:g} e{effort}") for kind in wanted}
    if not all(path.exists() for path in paths.values()):
        there = {kind: str(path) for kind, path in paths.items()}
        child.run(job="benchmarks.gain:make", scene=scene.name, quality=quality, effort=effort, paths=there)
    notes = {kind: json.loads(note_path(path).read_text(encoding="utf-8")) for kind, path in paths.items()}
    return {k: {**notes[k], "path": str(path), "bytes": path.stat().st_size} for k, path in paths.items()}


def measure(scene: Scene, quality: float, effort: int = 2) -> dict[str, Any]:
    """Bytes of the static file and of what networks make of it."""
    found = files(scene, quality, effort)
    static, whole = (Path(found[kind]["path"]).read_bytes() for kind in (STATIC, NEURAL))
    return {
        "scene": scene.name,
        "quality": quality,
        "anchors": found[STATIC]["anchors"],
        "static_bytes": found[STATIC]["bytes"],
        "predicted_bytes": found[PREDICTED]["bytes"],
        "neural_bytes": found[NEURAL]["bytes"],
        "static_index_bytes": index_bytes(static),
        "neural_index_bytes": index_bytes(whole),
        "predictor_seconds": found[PREDICTED]["seconds"],
        "network_seconds": found[NEURAL]["seconds"],
    }


def gain_table(results: dict[str, Any]) -> str:
    """The table of docs/benchmarks.md."""
    head = ["scene", "quality", "anchors", "static, bytes", "predictors", "and network", "indices, static", "indices"]
    head += ["train, s"]
    rows = []
    for r in results.values():
        first, static = r["static_index_bytes"], r["static_bytes"]
        rows.append(
            [
                r["scene"],
                f"{r['quality']:g}",
                f"{r['anchors']:,}",
                f"{static:,}",
                _change(r["predicted_bytes"], static),
                _change(r["neural_bytes"], static),
                f"{first:,}" if first else "none",
                _change(r["neural_index_bytes"], first) if first else "",
                f"{r['predictor_seconds'] + r['network_seconds']:.0f}",
            ]
        )
    return table(head, rows)


def _change(now: int, before: int) -> str:
    return f"{100 * (now / before - 1):+.1f} %"


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--qualities", nargs="+", type=float, default=QUALITIES)
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite the table")
    arguments = parser.parse_args()
    results = {} if arguments.no_write else load_results(NAME)
    names = arguments.scenes or (["plush-toys"] if arguments.short else SCENES)
    for scene in [] if arguments.report else chosen(names):
        for quality in arguments.qualities:
            print(f"{scene.name}, quality {quality:g}", file=sys.stderr, flush=True)
            name = f"{scene.name} q{quality:g}"
            results[name] = measure(scene, quality, 1 if arguments.short else 2)
            save_results(NAME, results, not arguments.no_write, [name])
    show = print if arguments.no_write else partial(replace_section, NAME)
    show(dated(gain_table(results), NAME, not arguments.no_write))


if __name__ == "__main__":
    main()
