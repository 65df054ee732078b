"""Rate and distortion of every layer on every scene.

    python -m benchmarks.quality                            everything: about twenty minutes
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
from pathlib import Path
from typing import Any

from benchmarks import child
from benchmarks.encoded import encoded, file_key, key_of, source_key
from benchmarks.encoded import encoded_path as encoded_path
from benchmarks.report import add_arguments, dated, load_results, replace_section, save_results, table
from benchmarks.rivals import RIVALS, Rival
from benchmarks.scenes import REPOSITORY, SCENES, Scene, chosen
from scarfmt.cli.scenes import Subject, layer_table, load_subject
from scarfmt.container.source import open_source
from scarfmt.render.compare import compare, compare_with_photos
from scarfmt.tools.inspection import inspect

QUALITIES = (41.0, 47.0)
SHORT_SCENES, SHORT_QUALITY = ["plush-toys"], 45.0
NAME = "quality"
README = REPOSITORY / "README.md"
# The scenes README.md tells of, and at which PSNR, dB.
SUMMARY_SCENES = ("plush-toys", "plush-on-bed", "flowers", "plush-dog")
SUMMARY_DB = (41.0, 47.0)


def measure(scene: Scene, quality: float, effort: int) -> dict[str, Any]:
    """Encode and decode `scene` in processes of their own, then compare all layers with the source."""
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
        "profile": facts["profile"],
        "source_count": facts["source_count"],
        "source_bytes": scene.path.stat().st_size,
        "encode_seconds": file["seconds"],
        "encode_peak_bytes": file["peak_bytes"],
        "decode_seconds": decoded["seconds"],
        "decode_peak_bytes": decoded["peak_bytes"],
        **distortion(scene, path),
    }


def distortion(scene: Scene, path: Path) -> dict[str, Any]:
    """How far each layer of an encoded file is from its source: measured once for each file, then kept beside it.

    Returns:
        ``source_photos_psnr_db``, and ``layers``: bytes, PSNR and SSIM over the judged views of each.
    """
    how = source_key(("reference_decoder",)), file_key(REPOSITORY / "benchmarks" / "scenes.py")
    kept = path.with_name(f"{path.name}.{key_of(how)}.layers.json")
    if not kept.exists():
        original = load_subject(str(scene.path)).remembering()
        layers = [_layer(original, scene, path, row) for row in layer_table(str(path))]
        found = {"source_photos_psnr_db": _photos_psnr(original, scene), "layers": layers}
        kept.write_text(json.dumps(found), encoding="utf-8")
    return dict(json.loads(kept.read_text(encoding="utf-8")))


def _layer(original: Subject, scene: Scene, path: Path, row: dict[str, Any]) -> dict[str, Any]:
    decoded = load_subject(str(path), row["layer"])
    result = compare(original.view, decoded.view, scene.judged_cameras(original))
    return {
        "bytes": row["end_offset"],
        "bytes_per_source": row["bytes_per_source"],
        "anchors": row["anchors"],
        "streams": row["streams"],
        "psnr_db": result.mean_psnr_db,
        "worst_psnr_db": result.worst_psnr_db,
        "ssim": result.mean_ssim,
        "photos_psnr_db": _photos_psnr(decoded, scene),
    }


def _photos_psnr(subject: Subject, scene: Scene) -> float | None:
    if scene.photos is None:
        return None
    return compare_with_photos(subject.view, scene.photos, ssim=False).mean_psnr_db


def run_key(run: dict[str, Any]) -> str:
    """Name of a run among the results."""
    return f"{run['scene']} q{run['quality']:g} e{run['effort']}"


def tables(runs: list[dict[str, Any]]) -> str:
    """All sections of the page, scenes in the order of `SCENES`."""
    order = [scene.name for scene in SCENES]
    known = [run for run in runs if run["scene"] in order]
    known.sort(key=lambda run: (order.index(run["scene"]), run["quality"], run["effort"]))
    parts = []
    for name in order:
        mine = [run for run in known if run["scene"] == name]
        if mine:
            parts += [f"### {name}", _facts(mine[0]), _layers_table(mine), *_rivals_text(name, mine)]
    return "\n\n".join([*parts, "### Where the bits go", _streams_table(known), "### Time and memory", _costs(known)])


def _unit(run: dict[str, Any]) -> str:
    return "anchor" if run["profile"] == "anchor" else "Gaussian"


def _facts(run: dict[str, Any]) -> str:
    text = f"{run['source_count']:,} {_unit(run)}s, {run['source_bytes']:,} bytes; {run['note']}."
    if run["source_photos_psnr_db"] is not None:
        text += f" The source itself reaches {run['source_photos_psnr_db']:.2f} dB against the held-out photos."
    return text


def _layers_table(runs: list[dict[str, Any]]) -> str:
    photos = runs[0]["source_photos_psnr_db"] is not None
    head = ["quality", "layer", "bytes", f"B/{_unit(runs[0])}", "share of bytes", "PSNR dB", "worst view", "SSIM"]
    rows = []
    for run in runs:
        for number, layer in enumerate(run["layers"], start=1):
            rows.append(
                [
                    f"{run['quality']:g}",
                    str(number),
                    f"{layer['bytes']:,}",
                    f"{layer['bytes_per_source']:.2f}",
                    f"{layer['bytes'] / run['layers'][-1]['bytes']:.0%}",
                    f"{layer['psnr_db']:.2f}",
                    f"{layer['worst_psnr_db']:.2f}",
                    f"{layer['ssim']:.4f}",
                    *([f"{layer['photos_psnr_db']:.2f}"] if photos else []),
                ]
            )
    return table([*head, *(["against photos"] if photos else [])], rows, 2)


def summary(runs: list[dict[str, Any]]) -> str:
    """The table of README.md: first layers, and what it takes to reach a PSNR."""
    head = ["scene", "source", "first layer"]
    for goal in SUMMARY_DB:
        head += [f"{goal:g} dB reached at", f"smallest rival over {goal:g} dB"]
    rows = []
    for name in SUMMARY_SCENES:
        mine = [run for run in runs if run["scene"] == name]
        if not mine:
            continue
        first = max(mine, key=lambda run: float(run["quality"]))["layers"][0]
        layers = [layer for run in mine for layer in run["layers"]]
        count, size = mine[0]["source_count"], mine[0]["source_bytes"]
        cells = [
            f"{name}, {count:,} Gaussians",
            f"{size / 1e6:.1f} MB, {size / count:.0f} B/G",
            f"{first['bytes'] / 1e3:,.0f} kB: {first['psnr_db']:.1f} dB",
        ]
        for goal in SUMMARY_DB:
            cells += [_reached(layers, goal), _smallest_rival(name, goal)]
        rows.append(cells)
    return table(head, rows)


def _reached(layers: list[dict[str, Any]], goal: float) -> str:
    good = [layer for layer in layers if layer["psnr_db"] >= goal]
    if not good:
        return "not reached"
    best = min(good, key=lambda layer: float(layer["bytes_per_source"]))
    return f"{best['bytes_per_source']:.1f} B/G ({best['psnr_db']:.1f} dB)"


def _smallest_rival(name: str, goal: float) -> str:
    good = [rival for rival in RIVALS.get(name, ()) if rival.psnr_db >= goal]
    if not good:
        return "none measured"
    best = min(good, key=lambda rival: rival.bytes_per_gaussian)
    return f"{best.bytes_per_gaussian:.1f} B/G ({best.psnr_db:.1f} dB, {best.name})"


def _rivals_text(name: str, runs: list[dict[str, Any]]) -> list[str]:
    if name not in RIVALS:
        return []
    layers = [layer for run in runs for layer in run["layers"]]
    rows = [_rival_row(rival, layers) for rival in RIVALS[name]]
    head = ["rival", "B/Gaussian", "PSNR dB", "`.scar` layer at least as good", "its PSNR dB", "times smaller"]
    return [table(head, rows)]


def _rival_row(rival: Rival, layers: list[dict[str, Any]]) -> list[str]:
    cells = [rival.name, f"{rival.bytes_per_gaussian:.2f}", f"{rival.psnr_db:.2f}"]
    good = [layer for layer in layers if layer["psnr_db"] >= rival.psnr_db]
    if not good:
        return [*cells, "none measured", "", ""]
    best = min(good, key=lambda layer: float(layer["bytes_per_source"]))
    ratio = rival.bytes_per_gaussian / best["bytes_per_source"]
    return [*cells, f"{best['bytes_per_source']:.2f}", f"{best['psnr_db']:.2f}", f"{ratio:.2f}"]


def _streams_table(runs: list[dict[str, Any]]) -> str:
    kinds = [kind for kind in runs[0]["layers"][0]["streams"] if any(_stream_bytes(run, kind) for run in runs)]
    rows = [
        [
            run["scene"],
            f"{run['quality']:g}",
            *(f"{8 * _stream_bytes(run, kind) / run['source_count']:.1f}" for kind in kinds),
        ]
        for run in runs
    ]
    head = ["scene", "quality", *(kind.replace("_", " ") for kind in kinds)]
    return f"Bits per Gaussian (or anchor) of the source, all layers together.\n\n{table(head, rows)}"


def _stream_bytes(run: dict[str, Any], kind: str) -> int:
    return sum(int(layer["streams"].get(kind, 0)) for layer in run["layers"])


def _costs(runs: list[dict[str, Any]]) -> str:
    rows = [
        [
            run["scene"],
            f"{run['quality']:g}",
            str(run["effort"]),
            f"{run['encode_seconds']:.1f}",
            f"{run['encode_peak_bytes'] / 2**20:,.0f}",
            f"{run['decode_seconds']:.2f}",
            f"{run['decode_peak_bytes'] / 2**20:,.0f}",
        ]
        for run in runs
    ]
    head = ["scene", "quality", "effort", "encode s", "peak MiB", "decode s", "peak MiB"]
    return table(head, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--qualities", nargs="+", type=float)
    parser.add_argument("--effort", type=int)
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite the tables")
    arguments = parser.parse_args()
    short = arguments.short
    qualities = arguments.qualities or ([SHORT_QUALITY] if short else QUALITIES)
    effort = arguments.effort or (1 if short else 2)
    results = {} if arguments.no_write else load_results(NAME)
    scenes = [] if arguments.report else chosen(arguments.scenes or (SHORT_SCENES if short else None))
    for scene, quality in ((scene, quality) for scene in scenes for quality in qualities):
        print(f"{scene.name}, quality {quality:g}, effort {effort}", file=sys.stderr)
        run = measure(scene, quality, effort)
        results[run_key(run)] = run
        save_results(NAME, results, not arguments.no_write, [run_key(run)])
    runs = list(results.values())
    if arguments.no_write:
        print(dated(tables(runs), NAME, keep=False))
    elif runs:
        replace_section(NAME, dated(tables(runs), NAME))
        replace_section("results", dated(summary(runs), NAME), README)


if __name__ == "__main__":
    main()
