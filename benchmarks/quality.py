"""Rate and distortion on every scene, from everywhere it is judged from; the encoder runs with its default options.

    python -m benchmarks.quality                            everything: about half an hour on two cores
    python -m benchmarks.quality --scenes flowers plush-dog --qualities 41 47 --effort 2
    python -m benchmarks.quality --short --no-write         the example scene at effort 1, printed
    python -m benchmarks.quality --report                   only rewrite the tables from earlier results

Encoded files and what was measured of their pictures are kept in build/benchmarks/ for whoever needs them next.
Results are merged into benchmarks/results/quality.json, from which docs/benchmarks.md and README.md get their tables.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks import child
from benchmarks.encoded import encoded, judging_key, key_of, source_key
from benchmarks.encoded import encoded_path as encoded_path
from benchmarks.judged import judgement, photos_psnr_db
from benchmarks.quality_report import NAME, pages, tables
from benchmarks.report import add_arguments, dated, load_results, save_results
from benchmarks.scenes import Scene, chosen
from benchmarks.views import View
from scarfmt.cli.scenes import Subject, layer_table, load_subject
from scarfmt.container.source import open_source
from scarfmt.tools.inspection import inspect

QUALITIES = (41.0, 47.0)
"""Measured layer by layer."""
FINE = {
    **dict.fromkeys(("plush-toys", "plush-dog", "fruit-drops", "flower-tile"), 52.0),
    **dict.fromkeys(("biker", "plant", "angel", "massa"), 58.0),
}
"""By scene: also measured as a whole, near what rivals reach, for bytes at equal quality. Not the two large scenes."""
SHORT_SCENES, SHORT_QUALITY = ["plush-toys"], 45.0


def measure(scene: Scene, quality: float, effort: int, whole: bool = False) -> dict[str, Any]:
    """Encode and decode `scene` in processes of their own, then compare all layers, or the last, with the source."""
    file = encoded(scene, quality, effort)
    path = Path(file["path"])
    decoded = child.run(job="decode", file=str(path), threads=2)
    with open_source(path) as source:
        facts = inspect(source)
    return {
        "scene": scene.name,
        "note": scene.note,
        "quality": quality,
        "effort": effort,
        "whole": whole,
        "profile": facts["profile"],
        "source_count": facts["source_count"],
        "source_bytes": scene.path.stat().st_size,
        "encode_seconds": file["seconds"],
        "encode_peak_bytes": file["peak_bytes"],
        "decode_seconds": decoded["seconds"],
        "decode_peak_bytes": decoded["peak_bytes"],
        **distortion(scene, path, whole),
    }


def distortion(scene: Scene, path: Path, whole: bool = False) -> dict[str, Any]:
    """How far each layer of an encoded file is from its source: measured once for each file, then kept beside it.

    Returns:
        ``source_photos_psnr_db``, and ``layers``: of each, or with `whole` of the last, its bytes and its `judgement`.
    """
    key = key_of([source_key(("reference_decoder",)), judging_key(scene)])
    kept = path.with_name(f"{path.name}.{key}.{'whole' if whole else 'layers'}.json")
    if not kept.exists():
        original = load_subject(str(scene.path)).remembering()
        views = scene.judged_views(original)
        rows = layer_table(str(path))[-1 if whole else 0 :]
        layers = [_layer(original, views, scene, path, row) for row in rows]
        found = {"source_photos_psnr_db": photos_psnr_db(scene, original), "layers": layers}
        kept.write_text(json.dumps(found), encoding="utf-8")
    return dict(json.loads(kept.read_text(encoding="utf-8")))


def _layer(original: Subject, views: Sequence[View], scene: Scene, path: Path, row: dict[str, Any]) -> dict[str, Any]:
    decoded = load_subject(str(path), row["layer"])
    return {
        "bytes": row["end_offset"],
        "bytes_per_source": row["bytes_per_source"],
        "anchors": row["anchors"],
        "streams": row["streams"],
        **judgement(original, decoded, views),
        "photos_psnr_db": photos_psnr_db(scene, decoded),
    }


def run_key(run: dict[str, Any]) -> str:
    """Name of a run among the results."""
    return f"{run['scene']} q{run['quality']:g} e{run['effort']}"


def plan(arguments: argparse.Namespace) -> list[tuple[Scene, float, bool]]:
    """The plan of the measurements: scenes, qualities, and whether only as a whole."""
    if arguments.report:
        return []
    scenes = chosen(arguments.scenes or (SHORT_SCENES if arguments.short else None))
    qualities = arguments.qualities or ([SHORT_QUALITY] if arguments.short else QUALITIES)
    found = [(scene, quality, quality == FINE.get(scene.name)) for scene in scenes for quality in qualities]
    if not (arguments.qualities or arguments.short):
        found += [(scene, FINE[scene.name], True) for scene in scenes if scene.name in FINE]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--qualities", nargs="+", type=float)
    parser.add_argument("--effort", type=int)
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite the tables")
    arguments = parser.parse_args()
    effort = arguments.effort or (1 if arguments.short else 2)
    keep = not arguments.no_write
    results = load_results(NAME) if keep else {}
    for scene, quality, whole in plan(arguments):
        print(f"{scene.name}, quality {quality:g}, effort {effort}", file=sys.stderr)
        run = measure(scene, quality, effort, whole)
        results[run_key(run)] = run
        save_results(NAME, results, keep, [run_key(run)])
    if keep and results:
        pages(list(results.values()))
    elif results:
        print(dated(tables(list(results.values())), NAME, keep=False))


if __name__ == "__main__":
    main()
