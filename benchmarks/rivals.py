"""Rival formats: the same scenes, judged from the same views.

    python -m benchmarks.rivals                                 all scenes: a quarter of an hour once cached
    python -m benchmarks.rivals --short --no-write              the example scene, printed
    python -m benchmarks.rivals --scenes flowers --fresh
    python -m benchmarks.rivals --report                        only rewrite tables and plots from earlier results

Needs node and npm for SPZ, SOG and compressed.ply; without them those are listed as skipped. Programs and the rivals'
files stay in `$SCAR_BENCH_CACHE` (build/rivals/ without it) with what writing them took; --fresh writes them again.
Results are merged into benchmarks/results/rivals.json; docs/results.md gets its tables and plots from them and from
those of `benchmarks.quality`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from benchmarks.child import note_path
from benchmarks.encode_cache import DRAWING, file_key, judging_key, source_key
from benchmarks.judge import LEVELS, LOSSLESS_DB, Row, equal_bytes, format_levels, judge, measure_photos_psnr, smallest
from benchmarks.plots import COLOURS, MARKERS, new_plot, save_plot
from benchmarks.quality import DEFAULT_EFFORT, SHOWN_RIVALS, sort_runs, title
from benchmarks.quality import NAME as QUALITY
from benchmarks.report import RESULTS_PAGE, add_provenance, load_results, make_parser, replace_section, save_results
from benchmarks.report import table as make_table
from benchmarks.rivals_formats import Format, list_formats, measure_reading, read
from benchmarks.rivals_tools import CACHE, ToolFailed, install, install_readers, run_command, tool_key
from benchmarks.scenes import Scene, select_scenes
from benchmarks.views import View
from scarfmt.cli.scenes import Subject, load_subject
from scarfmt.formats import inria_ply, load
from scarfmt.formats.clean import clean
from scarfmt.formats.export_ply import ply_header, ply_rows
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import GaussianScene

NAME = "rivals"
SCENES = (
    *("plush-on-bed", "flowers", "plush-dog", "plush-toys", "fruit-drops", "flower-tile"),
    *("biker", "plant", "angel", "massa"),
)
AIMS = (0.6, 0.6, 0.5, 0.5)
"""This project's target by SH degree: bytes at equal quality, relative to a rival's."""
FIRST_DB, FIRST_SHARE = 25.0, 0.1
"""A first picture, mean dB over all views; and the share of a rival's bytes that it should take at most."""
PLOTTED = ("plush-on-bed", "flowers")
_PLOT_DB = 65.0
"""Lossless rivals lie far off the plots."""
_TITLES = {"spz": "SPZ", "sog": "SOG", "compressed-ply": "compressed.ply"}

Run = dict[str, Any]
Judge = tuple[Subject, list[View]]
"""The source, which remembers its pictures, and the views it is judged from."""


# Measuring


def measure(scene: Scene, few: bool, fresh: bool, missing: str | None) -> dict[str, Any]:
    """Everything of one scene.

    Args:
        few: only some settings of SPZ.
        fresh: write cached files again.
        missing: why no rival can be written; None if all can.
    """
    original = load_subject(str(scene.path)).remembering()
    views = scene.views(original)
    source = source_ply(scene, original.placed)
    rivals, skipped = [], []
    for rival in list_formats(original.placed, few):
        print(f"{scene.name}, {rival.name}", file=sys.stderr)
        try:
            if missing:
                raise ToolFailed(missing)
            rivals.append(_measure_rival(scene, (original, views), source, rival, fresh))
        except ToolFailed as error:
            skipped.append({"name": rival.name, "family": rival.family, "why": str(error)})
    return {
        "scene": scene.name,
        "note": scene.note,
        "count": len(original.placed),
        "sh_degree": original.placed.sh_degree,
        "source_bytes": scene.path.stat().st_size,
        "rivals": sorted(rivals, key=lambda rival: int(rival["bytes"])),
        "skipped": skipped,
    }


def source_ply(scene: Scene, gaussians: GaussianScene) -> Path:
    """The scene as INRIA's PLY, which all rivals are written from: its own file, if it is one without invalid rows."""
    origin = Source(scene.path)
    plain = inria_ply.sniff(origin) and not scene.path.name.endswith(".compressed.ply")
    if plain and len(load(origin.read())) == len(gaussians):
        return scene.path
    path = CACHE / "files" / f"{_stem(scene.name)}-{file_key(scene.path)[:12]}.ply"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(ply_header(len(gaussians), gaussians.sh.shape[1] - 1) + ply_rows(gaussians).tobytes())
    return path


def _stem(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-." else "_" for c in name)


def _measure_rival(scene: Scene, how: Judge, source: Path, rival: Format, fresh: bool) -> dict[str, Any]:
    path, cost = write_rival(scene, source, rival, fresh)
    reading = measure_reading(path, rival.scale)
    return {
        "name": rival.name,
        "family": rival.family,
        "bytes": path.stat().st_size,
        "encode_seconds": round(cost["seconds"], 3),
        "encode_peak_bytes": cost["peak_bytes"],
        "decode_seconds": round(reading["seconds"], 5),
        "decode_peak_bytes": reading["peak_bytes"],
        "reader": reading["reader"],
        **_pictures(scene, how, path, rival),
    }


def write_rival(scene: Scene, source: Path, rival: Format, fresh: bool) -> tuple[Path, dict[str, Any]]:
    """The rival's file, and what writing it took when it was written."""
    path = cache_path(scene, source, rival)
    note = note_path(path)
    if fresh or not note.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        seconds, peak_bytes = run_command(rival.command(source, path))
        note.write_text(json.dumps({"seconds": seconds, "peak_bytes": peak_bytes}), encoding="utf-8")
    return path, json.loads(note.read_text(encoding="utf-8"))


def cache_path(scene: Scene, source: Path, rival: Format) -> Path:
    """The path of a rival's file, which changes as soon as anything it depends on changes."""
    command = rival.command(Path("source.ply"), Path("out"))
    depths = sorted((name, value) for name, value in command.environment.items() if name.startswith("SPZ_"))
    key = sha256(repr((tool_key(), command.words[2:], depths, file_key(source))).encode()).hexdigest()[:12]
    return CACHE / "files" / f"{_stem(scene.name)}-{_stem(rival.name)}-{key}{rival.suffix}"


def _pictures(scene: Scene, how: Judge, path: Path, rival: Format) -> dict[str, Any]:
    """How far its pictures are from the source's; kept beside the file until a picture could change."""
    drawn = source_key(DRAWING), file_key(path)
    key = sha256(repr((drawn, judging_key(scene))).encode()).hexdigest()[:12]
    cached = path.with_name(f"{path.name}.{key}.pictures.json")
    if not cached.exists():
        gaussians = clean(read(path, rival.scale), drop_invalid=True)[0]
        assert isinstance(gaussians, GaussianScene)
        subject = Subject(gaussians, gaussians)
        source, views = how
        facts = {**judge(source, subject, views), "photos_psnr_db": measure_photos_psnr(scene, subject)}
        cached.write_text(json.dumps(facts), encoding="utf-8")
    return dict(json.loads(cached.read_text(encoding="utf-8")))


# Tables and plots


def join_quality(runs: Sequence[Run]) -> list[Run]:
    """Runs of rivals with the default files of `benchmarks.quality` of the same scenes under ``scar``."""
    files = [run for run in sort_runs(list(load_results(QUALITY).values())) if run["effort"] == DEFAULT_EFFORT]
    return [{**run, "scar": [file for file in files if file["scene"] == run["scene"]]} for run in runs]


def make_tables(runs: Sequence[Run]) -> str:
    """The section of docs/results.md: bytes at equal quality, first pictures, time at default settings."""
    full = [run for run in runs if run["scar"] and run["rivals"]]
    head = ["scene", "SH", "rival", "B/G", "mean / 5 % / worst, dB", "`.scar` at its mean, B/G", "ratio"]
    head += ["`.scar` at all three, B/G", "ratio"]
    parts = [make_table(head, [_equal_row(run, rival) for run in full for rival in _show(run)], 3)]
    head = ["scene", f"{FIRST_DB:g} dB: `.scar`, kB", "smallest rival, kB", "share"]
    head += [f"{name}: {what} s" for name in (*SHOWN_RIVALS, "`.scar`") for what in ("encode", "decode")]
    rows = [[run["scene"], *_first_cells(run), *_time_cells(run)] for run in full]
    parts += ["First picture, and seconds to write and to read:", make_table(head, rows)]
    return "\n\n".join(parts)


def _show(run: Run) -> list[Run]:
    """Lossy files of default settings."""
    return [rival for rival in run["rivals"] if rival["name"] in SHOWN_RIVALS and rival["psnr_db"] < LOSSLESS_DB]


def _equal_row(run: Run, rival: Run) -> list[str]:
    cells = [title(run["scene"]), str(run["sh_degree"]), rival["name"]]
    cells += [f"{rival['bytes'] / run['count']:.2f}", format_levels(rival)]
    files = [file["layers"][-1] for file in run["scar"]]
    return [*cells, *equal_cells(run, files, rival, LEVELS[:1]), *equal_cells(run, files, rival)]


def equal_cells(run: Run, files: Sequence[Row], rival: Row, levels: Sequence[str] = LEVELS) -> list[str]:
    """Bytes a Gaussian of a file as good as a rival's, and their ratio.

    With ≤ where the smallest file measured is better; bold where the ratio reaches the aim.
    """
    size = equal_bytes(files, rival, levels)
    if size is None:
        return ["not reached", ""]
    sign = "≤ " if size == min(int(file["bytes"]) for file in files) else ""
    ratio = size / rival["bytes"]
    text = f"{sign}{ratio:.2f}"
    return [f"{sign}{size / run['count']:.2f}", f"**{text}**" if ratio <= AIMS[run["sh_degree"]] else text]


def _first_cells(run: Run) -> list[str]:
    """Bytes to a first picture, of any `.scar` file of the scene and of any setting of a rival."""
    ours = smallest([layer for file in run["scar"] for layer in file["layers"]], FIRST_DB)
    rival = smallest(run["rivals"], FIRST_DB)
    cells = ["none" if found is None else f"{found['bytes'] / 1e3:,.0f}" for found in (ours, rival)]
    if ours is None or rival is None:
        return [*cells, ""]
    share = ours["bytes"] / rival["bytes"]
    return [*cells, f"**{share:.0%}**" if share <= FIRST_SHARE else f"{share:.0%}"]


def _time_cells(run: Run) -> list[str]:
    """Seconds to encode and decode; of several `.scar` files, from the least to the most."""
    cells = []
    groups = [[rival for rival in run["rivals"] if rival["name"] == name] for name in SHOWN_RIVALS]
    for files in (*groups, run["scar"]):
        for kind in ("encode_seconds", "decode_seconds"):
            times = [float(file[kind]) for file in files]
            ends = (min(times), max(times)) if times else ()
            texts = (f"{time:.0f}" if time >= 10 else f"{time:.2g}" for time in ends)
            cells.append(" to ".join(dict.fromkeys(texts)))
    return cells


def draw_plots(runs: Sequence[Run], keep: bool) -> None:
    """A plot for each scene of `PLOTTED`: `.scar` layers as lines, rivals as points."""
    for run in (run for run in runs if run["scene"] in PLOTTED and run["scar"]):
        figure, axes = new_plot("bytes a Gaussian of the source", "PSNR, dB", log_x=True, title=run["scene"])
        for file, style in zip([file for file in run["scar"] if not file["whole"]], ("-", "--"), strict=False):
            x = [layer["bytes"] / run["count"] for layer in file["layers"]]
            y = [layer["psnr_db"] for layer in file["layers"]]
            axes.plot(x, y, style, color="black", marker=".", label=f".scar layers, quality {file['quality']:g}")
        for number, (family, name) in enumerate(_TITLES.items()):
            points = [rival for rival in run["rivals"] if rival["family"] == family and rival["psnr_db"] < _PLOT_DB]
            if points:
                x, y = [point["bytes"] / run["count"] for point in points], [point["psnr_db"] for point in points]
                axes.plot(x, y, MARKERS[number], color=COLOURS[number], label=name)
        save_plot(figure, f"{NAME}-{run['scene']}", keep)


# The command


def main() -> None:
    """The command line."""
    parser = make_parser(__doc__)
    parser.add_argument("--fresh", action="store_true", help="write the rivals' files again and time it")
    arguments = parser.parse_args()
    short, keep = arguments.short, not arguments.no_write
    results = load_results(NAME) if keep or arguments.report else {}
    names = arguments.scenes or (["plush-toys"] if short else SCENES)
    missing = None if arguments.report else install()
    for note in filter(None, () if arguments.report else (missing, install_readers())):
        print(note, file=sys.stderr)
    for scene in () if arguments.report else select_scenes(names):
        results[scene.name] = measure(scene, short, arguments.fresh, missing)
        save_results(NAME, results, keep, [scene.name])
    runs = join_quality([results[name] for name in SCENES if name in results])
    draw_plots(runs, keep)
    if keep:
        text = f"{add_provenance(make_tables(runs), NAME)}\n\n`.scar`: {add_provenance('', QUALITY).strip()}"
        replace_section(NAME, text, RESULTS_PAGE)
    else:
        print(make_tables(runs))


if __name__ == "__main__":
    main()
