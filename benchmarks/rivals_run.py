"""The measurements of rival formats: the same scenes, judged from the same views.

    python -m benchmarks.rivals_run                                 all scenes: a quarter of an hour once cached
    python -m benchmarks.rivals_run --short --no-write              the example scene, printed
    python -m benchmarks.rivals_run --scenes flowers --formats spz sog --fresh
    python -m benchmarks.rivals_run --report                        only rewrite docs/rivals.md from earlier results

Needs node and npm for SPZ, SOG and compressed.ply; without them those are listed as skipped. Programs and the rivals'
files are kept in `$SCAR_BENCH_CACHE` (build/rivals/ without it) with what writing them took; --fresh writes them
again. Results are merged into benchmarks/results/rivals.json; with those of `benchmarks.quality`, docs/rivals.md gets
its tables and plots from it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from benchmarks.encoded import DRAWING, file_key, judging_key, source_key
from benchmarks.judged import judgement, photos_psnr_db
from benchmarks.report import add_arguments, load_results, save_results
from benchmarks.rivals_formats import FAMILIES, Format, formats, read
from benchmarks.rivals_read import reading_cost
from benchmarks.rivals_report import NAME, gathered, plots, tables, write_page
from benchmarks.rivals_tools import CACHE, ToolFailed, install, install_readers, measured, tool_key
from benchmarks.scenes import REPOSITORY, Scene, chosen
from benchmarks.views import View
from scarfmt.cli.scenes import Subject, load_subject
from scarfmt.formats import inria_ply, load
from scarfmt.formats.clean import clean
from scarfmt.formats.export_ply import write_inria_ply
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import GaussianScene

SCENES = (
    *("plush-on-bed", "flowers", "plush-dog", "plush-toys", "fruit-drops", "flower-tile"),
    *("biker", "plant", "angel", "massa"),
)

Judge = tuple[Subject, list[View]]
"""The source, which remembers its pictures, and the views it is judged from."""


@dataclass(frozen=True)
class Plan:
    """The plan of the measurements of each scene.

    Attributes:
        families: formats, see `FAMILIES`.
        few: only some settings of SPZ.
        fresh: write files again that are kept.
        missing: why no format of npm can be written; None if all can.
    """

    families: Sequence[str]
    few: bool = False
    fresh: bool = False
    missing: str | None = None


def measure(scene: Scene, plan: Plan) -> dict[str, Any]:
    """Everything of one scene."""
    original = load_subject(str(scene.path)).remembering()
    views = scene.judged_views(original)
    source = source_ply(scene, original.placed)
    rivals, skipped = [], []
    for rival in formats(original.placed, plan.few):
        if rival.family not in plan.families:
            continue
        print(f"{scene.name}, {rival.name}", file=sys.stderr)
        try:
            if rival.of_npm and plan.missing:
                raise ToolFailed(plan.missing)
            rivals.append(_rival(scene, (original, views), source, rival, plan.fresh))
        except ToolFailed as error:
            skipped.append({"name": rival.name, "family": rival.family, "why": str(error)})
    return {
        "scene": scene.name,
        "note": scene.note,
        "count": len(original.placed),
        "sh_degree": original.placed.sh_degree,
        "source_bytes": scene.path.stat().st_size,
        "rivals": rivals,
        "skipped": skipped,
    }


def source_ply(scene: Scene, gaussians: GaussianScene) -> Path:
    """The scene as INRIA's PLY, which all rivals are written from: its own file, if it is one without invalid rows."""
    origin = Source(scene.path)
    if inria_ply.sniff(origin) and not scene.path.name.endswith(".compressed.ply") and _all_valid(origin, gaussians):
        return scene.path
    path = CACHE / "files" / f"{_stem(scene.name)}-{file_key(scene.path)[:12]}.ply"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_inria_ply(gaussians, path)
    return path


def _all_valid(origin: Source, gaussians: GaussianScene) -> bool:
    return len(load(origin.read())) == len(gaussians)


def _stem(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-." else "_" for c in name)


def _rival(scene: Scene, judge: Judge, source: Path, rival: Format, fresh: bool) -> dict[str, Any]:
    path, cost = written(scene, source, rival, fresh)
    reading = reading_cost(path, rival.scale)
    return {
        "name": rival.name,
        "family": rival.family,
        "bytes": path.stat().st_size,
        "encode_seconds": round(cost["seconds"], 3),
        "encode_peak_bytes": cost["peak_bytes"],
        "decode_seconds": round(reading["seconds"], 5),
        "decode_peak_bytes": reading["peak_bytes"],
        "reader": reading["reader"],
        **_pictures(scene, judge, path, rival),
    }


def written(scene: Scene, source: Path, rival: Format, fresh: bool) -> tuple[Path, dict[str, Any]]:
    """The rival's file, and what writing it took when it was written."""
    path = kept_file(scene, source, rival)
    note = path.with_name(path.name + ".json")
    if fresh or not note.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        cost = measured(rival.command(source, path))
        note.write_text(json.dumps(asdict(cost)), encoding="utf-8")
    return path, json.loads(note.read_text(encoding="utf-8"))


def kept_file(scene: Scene, source: Path, rival: Format) -> Path:
    """The path of a rival's file, which changes as soon as anything it depends on changes."""
    told = rival.command(Path("source.ply"), Path("out"))
    how = tool_key() if rival.of_npm else file_key(REPOSITORY / "benchmarks" / "rivals_formats.py")
    arguments = told.words[2:] if rival.of_npm else told.words[3:]
    told_bits = sorted((name, value) for name, value in told.environment.items() if name.startswith("SPZ_"))
    key = sha256(repr((how, arguments, told_bits, file_key(source))).encode()).hexdigest()[:12]
    return CACHE / "files" / f"{_stem(scene.name)}-{_stem(rival.name)}-{key}{rival.suffix}"


def _pictures(scene: Scene, judge: Judge, path: Path, rival: Format) -> dict[str, Any]:
    """How far its pictures are from the source's; kept beside the file until a picture could change."""
    drawn = source_key(DRAWING), file_key(path)
    key = sha256(repr((drawn, judging_key(scene))).encode()).hexdigest()[:12]
    kept = path.with_name(f"{path.name}.{key}.pictures.json")
    if not kept.exists():
        gaussians = clean(read(path, rival.scale), drop_invalid=True)[0]
        assert isinstance(gaussians, GaussianScene)
        subject = Subject(gaussians, gaussians)
        facts = {**judgement(judge[0], subject, judge[1]), "photos_psnr_db": photos_psnr_db(scene, subject)}
        kept.write_text(json.dumps(facts), encoding="utf-8")
    return dict(json.loads(kept.read_text(encoding="utf-8")))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--formats", nargs="+", choices=FAMILIES, default=FAMILIES)
    parser.add_argument("--fresh", action="store_true", help="write the rivals' files again and time it")
    parser.add_argument("--report", action="store_true", help="measure nothing, rewrite the page")
    arguments = parser.parse_args()
    short, keep = arguments.short, not arguments.no_write
    results = load_results(NAME) if keep else {}
    names = arguments.scenes or (["plush-toys"] if short else SCENES)
    missing = None if arguments.report else install()
    for note in filter(None, () if arguments.report else (missing, install_readers())):
        print(note, file=sys.stderr)
    plan = Plan(arguments.formats, short, arguments.fresh, missing)
    for scene in () if arguments.report else chosen(names):
        found = measure(scene, plan)
        results[scene.name] = merged(results.get(scene.name, {}), found, arguments.formats)
        save_results(NAME, results, keep, [scene.name])
    runs = gathered([results[name] for name in SCENES if name in results])
    if keep:
        write_page(runs)
        plots(runs)
    else:
        print(tables(runs))


def merged(old: dict[str, Any], new: dict[str, Any], families: Sequence[str]) -> dict[str, Any]:
    """New results of a scene, with the old ones of the formats that were not measured this time."""
    both = {
        part: [*(entry for entry in old.get(part, ()) if entry["family"] not in families), *new[part]]
        for part in ("rivals", "skipped")
    }
    both["rivals"].sort(key=lambda rival: int(rival["bytes"]))
    return {**old, **new, **both}


if __name__ == "__main__":
    main()
