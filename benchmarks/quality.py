"""Rate and distortion on every scene, from all views it is judged from; the encoder runs with its default options.

    python -m benchmarks.quality                            everything: about an hour on two cores
    python -m benchmarks.quality --scenes flowers plush-dog --qualities 41 47 --effort 2
    python -m benchmarks.quality --short --no-write         the example scene at effort 1, printed
    python -m benchmarks.quality --example                  only the record of the example scene
    python -m benchmarks.quality --report                   only rewrite the tables from earlier results

Encoded files and what was measured on them stay in build/benchmarks/ for later runs. Results are merged into
benchmarks/results/quality.json; README.md, docs/results.md and examples/README.md get their tables from it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from benchmarks import child
from benchmarks.encode_cache import encode_scene, judging_key, key_of, source_key
from benchmarks.judge import (
    EQUAL_DB,
    LEVELS,
    PERCENTILE,
    Row,
    equal_bytes,
    judge,
    measure_photos_psnr,
    smallest,
    worst_kind,
)
from benchmarks.provenance import statement
from benchmarks.report import (
    RESULTS_PAGE,
    add_provenance,
    load_document,
    load_results,
    make_parser,
    replace_section,
    save_results,
    table,
)
from benchmarks.scenes import FITTED_MARK, REPOSITORY, SCENES, Scene, load_gaussians, select_scenes
from benchmarks.views import View
from reference_decoder.decode import decode_scene
from reference_encoder.options import EncodeOptions
from scarfmt.api import encode
from scarfmt.cli.scenes import Subject, layer_table, load_subject
from scarfmt.container.source import open_source
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.tools.inspection import inspect

NAME, RIVALS, EXAMPLE = "quality", "rivals", "example"
README, EXAMPLES = REPOSITORY / "README.md", REPOSITORY / "examples"
QUALITIES, HEADLINE = (41.0, 47.0), 47.0
"""Measured layer by layer; README.md and the table of first layers show the second."""
DEFAULT_EFFORT = EncodeOptions().effort
HEADLINE_NAMES = f" q{HEADLINE:g} e{DEFAULT_EFFORT}"
"""How the names of the files in README.md end in the results."""
FINE = {
    **dict.fromkeys(("plush-toys", "plush-dog", "fruit-drops", "flower-tile"), 52.0),
    **dict.fromkeys(("biker", "plant", "angel", "massa"), 58.0),
}
"""By scene: a quality near what rivals reach, measured for the whole file only. Not for the two large scenes."""
SHORT_SCENES, SHORT_QUALITY = ["plush-toys"], 45.0
EXAMPLE_QUALITY, EXAMPLE_EFFORTS = 41.0, (1, 2)
SHOWN_RIVALS = ("SPZ v4", "SOG")
"""Rivals in README.md, each with its default settings."""
RIVAL_DB = 41.0
"""Rivals are compared at equal quality from this mean on, dB."""
MEAN_WITHIN, LOW_BELOW, KIND_BELOW, PROMISE_WITHIN = 1.0, 5.0, 3.0, 1.5
"""How far from the quality asked for the mean, the 5th percentile and the worst kind should be at most, dB; and how far
the mean should be from what was asked, or said."""

Run = dict[str, Any]


# Measuring


def measure(scene: Scene, quality: float, effort: int, whole: bool = False) -> Run:
    """Encode and decode `scene` in processes of their own, then compare all layers, or the last, with the source."""
    file = encode_scene(scene, quality, effort)
    path = Path(file["path"])
    decoded = child.run(job="decode", file=str(path), threads=2)
    with open_source(path) as source:
        facts = inspect(source, metadata=True)
    return {
        "scene": scene.name,
        "note": scene.note,
        "quality": quality,
        "effort": effort,
        "whole": whole,
        "profile": facts["profile"],
        "source_count": facts["source_count"],
        "source_bytes": scene.path.stat().st_size,
        "said_db": facts["metadata"]["quality"]["mean_db"],
        "encode_seconds": file["seconds"],
        "encode_peak_bytes": file["peak_bytes"],
        "decode_seconds": decoded["seconds"],
        "decode_peak_bytes": decoded["peak_bytes"],
        **measure_layers(scene, path, whole),
    }


def measure_layers(scene: Scene, path: Path, whole: bool = False) -> dict[str, Any]:
    """How far each layer of an encoded file is from its source. Measured once for each file, then cached beside it.

    Returns:
        ``source_photos_psnr_db``, and ``layers``: of each layer, or with `whole` of the last, its bytes and the
        figures of :func:`benchmarks.judge.judge`.
    """
    key = key_of([source_key(("reference_decoder",)), judging_key(scene)])
    cached = path.with_name(f"{path.name}.{key}.{'whole' if whole else 'layers'}.json")
    if not cached.exists():
        original = load_subject(str(scene.path)).remembering()
        views = scene.views(original)
        rows = layer_table(str(path))[-1 if whole else 0 :]
        layers = [_measure_layer(original, views, scene, path, row) for row in rows]
        found = {"source_photos_psnr_db": measure_photos_psnr(scene, original), "layers": layers}
        cached.write_text(json.dumps(found), encoding="utf-8")
    return dict(json.loads(cached.read_text(encoding="utf-8")))


def _measure_layer(original: Subject, views: Sequence[View], scene: Scene, path: Path, row: Row) -> Row:
    decoded = load_subject(str(path), row["layer"])
    return {
        "bytes": row["end_offset"],
        "bytes_per_source": row["bytes_per_source"],
        "anchors": row["anchors"],
        **judge(original, decoded, views),
        "photos_psnr_db": measure_photos_psnr(scene, decoded),
    }


def measure_example(effort: int) -> dict[str, Any]:
    """Encode the example scene with its cameras and look at it from its other cameras. A test holds to these figures.

    Returns:
        ``bytes`` and ``first_layer_bytes``, up to the end of that layer; ``mean_psnr_db`` and ``worst_psnr_db`` of
        the views of examples/plush-toys.views.json; ``first_layer_psnr_db``, their mean for layer 1.
    """
    source = load_gaussians(EXAMPLES / "plush-toys.ply")
    assert isinstance(source, GaussianScene)
    known, views = (load_cameras(EXAMPLES / f"plush-toys.{name}.json") for name in ("cameras", "views"))
    data = encode(source, EncodeOptions(quality=EXAMPLE_QUALITY, effort=effort, cameras=known))
    expected = [render(source, view) for view in views]
    first, last = (_levels(data, views, expected, layers) for layers in (1, None))
    return {
        "bytes": len(data),
        "first_layer_bytes": layer_table(bytes(data))[0]["end_offset"],
        "mean_psnr_db": round(fmean(last), 3),
        "worst_psnr_db": round(min(last), 3),
        "first_layer_psnr_db": round(fmean(first), 3),
    }


def _levels(data: bytes, views: Sequence[Camera], expected: Sequence[Any], layers: int | None) -> list[float]:
    """PSNR of every view against the source's picture, dB."""
    scene = decode_scene(data, layers=layers)
    assert isinstance(scene, GaussianScene)
    return [psnr(picture, render(scene, view)) for picture, view in zip(expected, views, strict=True)]


# Tables


def write_pages(runs: Sequence[Run]) -> None:
    """Rewrite the sections of docs/results.md and README.md."""
    replace_section(NAME, add_provenance(make_tables(runs), NAME), RESULTS_PAGE)
    ours, theirs = statement(load_document(NAME), ending=HEADLINE_NAMES), statement(load_document(RIVALS))
    text = f"{make_headline(runs, load_results(RIVALS))}\n\n`.scar`: {ours}\n\nRivals: {theirs}"
    replace_section("results", text, README)


def sort_runs(runs: Sequence[Run]) -> list[Run]:
    """Runs of known scenes, in the order of `SCENES`."""
    order = [scene.name for scene in SCENES]
    known = [run for run in runs if run["scene"] in order]
    return sorted(known, key=lambda run: (order.index(run["scene"]), run["quality"], run["effort"]))


def make_tables(runs: Sequence[Run]) -> str:
    """The section of docs/results.md."""
    known = [run for run in sort_runs(runs) if not run["whole"]]
    layered = [run for run in known if run["quality"] in (HEADLINE, SHORT_QUALITY)]
    asked = f"{make_asked_table(known)}\n\n{count_kept(known)}"
    return f"{asked}\n\nFirst layers:\n\n{make_first_layers_table(layered)}"


def title(name: str) -> str:
    """A scene's name, marked where constants were fitted on it."""
    return next((scene.title for scene in SCENES if scene.name == name), name)


def make_asked_table(runs: Sequence[Run]) -> str:
    """Mean, 5th percentile and worst kind of every file against the quality asked for; bold where the aim is met."""
    levels = ["said", "mean", f"{PERCENTILE} %", "worst", "worst kind, its mean"]
    head = ["scene", "asked", "B/G", *levels, "against photos"]
    rows = []
    for run in runs:
        last, goal = run["layers"][-1], run["quality"]
        kind, level = worst_kind(last)
        photos = last["photos_psnr_db"]
        rows.append(
            [
                title(run["scene"]),
                f"{goal:g}" + ("" if run["effort"] == DEFAULT_EFFORT else f", effort {run['effort']}"),
                f"{last['bytes_per_source']:.2f}",
                f"{run['said_db']:.1f}",
                _bold(last["psnr_db"], abs(last["psnr_db"] - goal) <= MEAN_WITHIN),
                _bold(last["p5_psnr_db"], last["p5_psnr_db"] >= goal - LOW_BELOW),
                f"{last['worst_psnr_db']:.1f}",
                f"{kind} {_bold(level, level >= goal - KIND_BELOW)}",
                "" if photos is None else f"{photos:.2f} of {run['source_photos_psnr_db']:.2f}",
            ]
        )
    return f"{table(head, rows)}\n{_mark_note()}"


def count_kept(runs: Sequence[Run]) -> str:
    """How many files have the mean that was asked for, and the one that `encode` said."""
    asked, said = (
        sum(abs(run["layers"][-1]["psnr_db"] - run[goal]) <= PROMISE_WITHIN for run in runs)
        for goal in ("quality", "said_db")
    )
    return (
        f"The mean came within {PROMISE_WITHIN:g} dB of what was asked in {asked} of {len(runs)} files, and of what the"
        f" command said in {said}."
    )


def _bold(level: float, met: bool) -> str:
    return f"**{level:.1f}**" if met else f"{level:.1f}"


def _mark_note() -> str:
    return f"{FITTED_MARK.strip()} The encoder was tuned on this scene."


def make_first_layers_table(runs: Sequence[Run]) -> str:
    """What the first layer of each file shows, and its share of the file."""
    rows = []
    for run in runs:
        first, last = run["layers"][0], run["layers"][-1]
        share = f"{100 * first['bytes'] / last['bytes']:.0f} %"
        levels = (f"{first[name]:.1f}" for name in LEVELS)
        rows.append([title(run["scene"]), f"{run['quality']:g}", _kilobytes(first["bytes"]), share, *levels])
    return table(["scene", "asked", "kB", "of the file", "mean", f"{PERCENTILE} %", "worst"], rows)


def make_headline(runs: Sequence[Run], rivals: dict[str, Run]) -> str:
    """The table of README.md, one file a scene beside two rivals, and the ratios at equal quality."""
    headlines = [run for run in sort_runs(runs) if run["quality"] == HEADLINE and run["effort"] == DEFAULT_EFFORT]
    known = [run for run in headlines if run["profile"] != "anchor" and run["scene"] in rivals]
    head = ["scene", "SH", "source, kB", "`.scar`, kB", "mean / worst, dB"]
    for name in SHOWN_RIVALS:
        head += [f"{name}, kB", "mean / worst, dB"]
    rows = [_headline_cells(run, rivals[run["scene"]]) for run in known]
    return "\n\n".join([table(head, rows).rstrip(), _mark_note(), _equal_quality(runs, rivals)])


def _headline_cells(run: Run, rivals: Run) -> list[str]:
    last = run["layers"][-1]
    cells = [title(run["scene"]), str(rivals["sh_degree"]), _kilobytes(run["source_bytes"])]
    cells += [_kilobytes(last["bytes"]), _mean_and_worst(last)]
    for name in SHOWN_RIVALS:
        found = next((rival for rival in rivals["rivals"] if rival["name"] == name), None)
        cells += ["", ""] if found is None else [_kilobytes(found["bytes"]), _mean_and_worst(found)]
    return cells


def _kilobytes(size: int) -> str:
    return f"{size / 1e3:,.0f}"


def _mean_and_worst(found: Row) -> str:
    if found["worst_psnr_db"] >= EQUAL_DB:
        return "equal"
    return f"{found['psnr_db']:.1f} / {found['worst_psnr_db']:.1f}"


def _equal_quality(runs: Sequence[Run], rivals: dict[str, Run]) -> str:
    """How much smaller than the smallest rival at equal mean, and at equal 5th percentile and worst view."""
    ratios: dict[int, list[float]] = {1: [], len(LEVELS): []}
    for name, found in rivals.items():
        rival = smallest(found["rivals"], RIVAL_DB)
        if rival is None:
            continue
        files = [run["layers"][-1] for run in sort_runs(runs) if run["scene"] == name]
        for count, ratio in ratios.items():
            size = equal_bytes(files, rival, LEVELS[:count])
            ratio += [] if size is None else [size / rival["bytes"]]
    means, every = (_factors(found, len(rivals)) for found in ratios.values())
    return (
        f"At equal mean PSNR, `.scar` is {means} than the smallest SPZ, SOG or compressed PLY of at least "
        f"{RIVAL_DB:g} dB, tuned settings included. At equal mean, 5th percentile and worst view it is {every}. "
        "On the other scenes no file measured is as good."
    )


def _factors(ratios: Sequence[float], scenes: int) -> str:
    if not ratios:
        return f"smaller on 0 of {scenes} scenes"
    return f"{1 / max(ratios):.1f} to {1 / min(ratios):.1f} times smaller on {len(ratios)} of {scenes} scenes"


def make_example_table(results: dict[str, Any]) -> str:
    """The table of examples/README.md."""
    head = ["effort", "bytes", "first layer, bytes", "its mean PSNR dB", "mean PSNR dB", "worst view dB"]
    levels = ("first_layer_psnr_db", "mean_psnr_db", "worst_psnr_db")
    rows = []
    for name, found in results.items():
        sizes = (f"{found[field]:,}" for field in ("bytes", "first_layer_bytes"))
        rows.append([name.removeprefix("effort "), *sizes, *(f"{found[field]:.2f}" for field in levels)])
    return table(head, rows)


# The command


def run_key(run: Run) -> str:
    """Name of a run among the results."""
    return f"{run['scene']} q{run['quality']:g} e{run['effort']}"


def plan(arguments: argparse.Namespace) -> list[tuple[Scene, float, bool]]:
    """Scenes, qualities, and whether only the whole file is measured."""
    scenes = select_scenes(arguments.scenes or (SHORT_SCENES if arguments.short else None))
    qualities = arguments.qualities or ([SHORT_QUALITY] if arguments.short else QUALITIES)
    found = [(scene, quality, quality == FINE.get(scene.name)) for scene in scenes for quality in qualities]
    if not (arguments.qualities or arguments.short):
        found += [(scene, FINE[scene.name], True) for scene in scenes if scene.name in FINE]
    return found


def record_example(keep: bool) -> None:
    """Measure the example scene; with `keep` rewrite its results and its page, else print."""
    results = {f"effort {effort}": measure_example(effort) for effort in EXAMPLE_EFFORTS}
    save_results(EXAMPLE, results, keep)
    text = add_provenance(make_example_table(results), EXAMPLE, keep)
    if keep:
        replace_section(EXAMPLE, text, EXAMPLES / "README.md")
    else:
        print(text)


def main() -> None:
    """The command line."""
    parser = make_parser(__doc__)
    parser.add_argument("--qualities", nargs="+", type=float)
    parser.add_argument("--effort", type=int)
    parser.add_argument("--example", action="store_true", help="only record the example scene")
    arguments = parser.parse_args()
    effort = DEFAULT_EFFORT if arguments.effort is None else arguments.effort
    keep = not arguments.no_write
    if arguments.example:
        record_example(keep)
        return
    results = load_results(NAME) if keep or arguments.report else {}
    for scene, quality, whole in [] if arguments.report else plan(arguments):
        print(f"{scene.name}, quality {quality:g}, effort {effort}", file=sys.stderr)
        run = measure(scene, quality, effort, whole)
        results[run_key(run)] = run
        save_results(NAME, results, keep, [run_key(run)])
    if keep and results:
        write_pages(list(results.values()))
    elif results:
        print(make_tables(list(results.values())))


if __name__ == "__main__":
    main()
