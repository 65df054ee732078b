"""The tables of docs/benchmarks.md and README.md: results of `benchmarks.quality`, against `benchmarks.rivals_run`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.judged import EQUAL_DB, PERCENTILE, kinds_text, levels_text, worst_kind
from benchmarks.provenance import statement
from benchmarks.report import dated, load_document, load_results, replace_section, table
from benchmarks.scenes import FITTED_MARK, REPOSITORY, SCENES
from benchmarks.verdicts import AIMS, LEVELS, Row, equal_bytes, smallest
from benchmarks.views import KINDS

NAME = "quality"
RIVALS = "rivals"
README = REPOSITORY / "README.md"
HEADLINE = "47"
"""README.md shows one file a scene: the one encoded for this many dB, as names of runs have it."""
HEADLINE_NAMES = f" q{HEADLINE} e2"
"""How the names of these files end in the results."""
SHOWN_RIVALS = ("SPZ v4", "SOG")
"""Rivals that README.md sets beside the files, each with its default settings."""
RIVAL_DB = 41.0
"""Rivals from this mean on, dB, are compared at equal quality."""
MEAN_WITHIN, LOW_BELOW, KIND_BELOW = 1.0, 5.0, 3.0
"""How far from what was asked, dB, mean, 5th percentile and worst kind should be at most."""
FIRST_SHARE = 0.1

Run = dict[str, Any]


def pages(runs: Sequence[Run]) -> None:
    """Rewrite the sections of docs/benchmarks.md and README.md."""
    replace_section(NAME, dated(tables(runs), NAME))
    rivals = load_results(RIVALS)
    ours, theirs = statement(load_document(NAME), ending=HEADLINE_NAMES), statement(load_document(RIVALS))
    replace_section("results", f"{summary(runs, rivals)}\n\n{ours}\n\nRivals: {theirs}", README)


def ordered(runs: Sequence[Run]) -> list[Run]:
    """Runs of known scenes, in the order of `SCENES`."""
    order = [scene.name for scene in SCENES]
    known = [run for run in runs if run["scene"] in order]
    return sorted(known, key=lambda run: (order.index(run["scene"]), run["quality"], run["effort"]))


def tables(runs: Sequence[Run]) -> str:
    """All sections of the page."""
    known = ordered(runs)
    parts = ["### What was asked, and what came out", asked(known)]
    for name in dict.fromkeys(run["scene"] for run in known):
        mine = [run for run in known if run["scene"] == name]
        parts += [f"### {name}", _facts(mine[0]), _layers_table(mine)]
    return "\n\n".join([*parts, "### Where the bits go", _streams_table(known), "### Time and memory", _costs(known)])


def title(name: str) -> str:
    """A scene as headlines name it: marked where constants were fitted on it."""
    return next((scene.title for scene in SCENES if scene.name == name), name)


def asked(runs: Sequence[Run]) -> str:
    """Mean, low end and worst kind of every file against what was asked for; bold where the aim is met."""
    head = ["scene", "asked", "B/G", "mean", f"{PERCENTILE} %", "worst", "worst kind, its mean", "against photos"]
    rows = []
    for run in runs:
        last, goal = run["layers"][-1], run["quality"]
        kind, level = worst_kind(last)
        photos = last["photos_psnr_db"]
        rows.append(
            [
                title(run["scene"]),
                f"{goal:g}" + ("" if run["effort"] == 2 else f", effort {run['effort']}"),
                f"{last['bytes_per_source']:.2f}",
                _bold(last["psnr_db"], abs(last["psnr_db"] - goal) <= MEAN_WITHIN),
                _bold(last["p5_psnr_db"], last["p5_psnr_db"] >= goal - LOW_BELOW),
                f"{last['worst_psnr_db']:.1f}",
                f"{kind} {_bold(level, level >= goal - KIND_BELOW)}",
                "" if photos is None else f"{photos:.2f} of {run['source_photos_psnr_db']:.2f}",
            ]
        )
    return f"{table(head, rows)}\n{_mark_note()}"


def _bold(level: float, met: bool) -> str:
    return f"**{level:.1f}**" if met else f"{level:.1f}"


def _mark_note() -> str:
    return (
        f"{FITTED_MARK.strip()} Constants of decisions 0023 to 0028 were chosen by trials on this scene, among others; "
        "older ones were fitted on all scenes."
    )


def unit(run: Run) -> str:
    """The unit of which a scene of this profile consists."""
    return "anchor" if run["profile"] == "anchor" else "Gaussian"


def _facts(run: Run) -> str:
    text = f"{run['source_count']:,} {unit(run)}s, {run['source_bytes']:,} bytes; {run['note']}."
    if run["source_photos_psnr_db"] is not None:
        text += f" The source itself reaches {run['source_photos_psnr_db']:.2f} dB against the held-out photos."
    return text


def _layers_table(runs: Sequence[Run]) -> str:
    photos = runs[0]["source_photos_psnr_db"] is not None
    kinds = [kind for kind in KINDS if kind in runs[0]["layers"][-1]["kinds"]]
    head = ["quality", "layer", "bytes", f"B/{unit(runs[0])}", "share", f"mean / {PERCENTILE} % / worst, dB", *kinds]
    rows = []
    for run in runs:
        for number, layer in enumerate(run["layers"], start=1):
            rows.append(
                [
                    f"{run['quality']:g}",
                    "all" if run["whole"] else str(number),
                    f"{layer['bytes']:,}",
                    f"{layer['bytes_per_source']:.2f}",
                    f"{layer['bytes'] / run['layers'][-1]['bytes']:.0%}",
                    levels_text(layer),
                    *(cell for cell in kinds_text(layer) if cell),
                    f"{layer['ssim']:.4f}",
                    *([f"{layer['photos_psnr_db']:.2f}"] if photos else []),
                ]
            )
    return table([*head, "SSIM", *(["against photos"] if photos else [])], rows, 2)


def summary(runs: Sequence[Run], rivals: dict[str, Run]) -> str:
    """The table of README.md, one file a scene beside the rivals a user would take, and what equal quality costs."""
    headlines = [run for run in ordered(runs) if f"{run['quality']:g}" == HEADLINE and run["effort"] == 2]
    known = [run for run in headlines if unit(run) == "Gaussian"]
    head = ["scene", "SH", "source, kB", "`.scar`, kB", "mean / worst, dB"]
    for name in SHOWN_RIVALS:
        head += [f"{name}, kB", "mean / worst, dB"]
    rows = [_headline(run, rivals[run["scene"]]) for run in known if run["scene"] in rivals]
    return "\n\n".join([table(head, rows).rstrip(), _mark_note(), _equal_quality(runs, rivals)])


def _headline(run: Run, rivals: Run) -> list[str]:
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
    """The range of bytes against the smallest rival's at equal mean, and at equal low end and worst view, too."""
    ratios: dict[int, list[float]] = {1: [], len(LEVELS): []}
    for name, found in rivals.items():
        rival = smallest(found["rivals"], RIVAL_DB)
        if rival is None:
            continue
        files = [run["layers"][-1] for run in ordered(runs) if run["scene"] == name]
        for count, ratio in ratios.items():
            size = equal_bytes(files, rival, LEVELS[:count])
            ratio += [] if size is None else [size / rival["bytes"]]
    means, every = (_range(found, len(rivals)) for found in ratios.values())
    return (
        f"The smallest rival is the smallest SPZ, SOG or compressed PLY of at least {RIVAL_DB:g} dB, tuned settings "
        f"included. A `.scar` file with its mean takes {means}. A `.scar` file as good in the mean, the 5th percentile "
        f"and the worst view takes {every}. On the other scenes no file measured is as good."
    )


def _range(ratios: Sequence[float], scenes: int) -> str:
    if not ratios:
        return "none"
    return f"{min(ratios):.2f} to {max(ratios):.2f} of its bytes on {len(ratios)} scenes of {scenes}"


def equal_cells(run: Run, files: Sequence[Row], rival: Row, levels: Sequence[str] = LEVELS) -> list[str]:
    """Bytes per Gaussian of a file as good as a rival's, and their ratio.

    With ≤ where the smallest file measured is better; bold where the ratio is what is aimed at.
    """
    size = equal_bytes(files, rival, levels)
    if size is None:
        return ["not reached", ""]
    sign = "≤ " if size == min(int(file["bytes"]) for file in files) else ""
    ratio = size / rival["bytes"]
    text = f"{sign}{ratio:.2f}"
    return [f"{sign}{size / run['count']:.2f}", f"**{text}**" if ratio <= AIMS[run["sh_degree"]] else text]


def _streams_table(runs: Sequence[Run]) -> str:
    layered = [run for run in runs if not run["whole"]]
    kinds = [kind for kind in layered[0]["layers"][0]["streams"] if any(_stream_bytes(run, kind) for run in layered)]
    rows = [
        [
            run["scene"],
            f"{run['quality']:g}",
            *(f"{8 * _stream_bytes(run, kind) / run['source_count']:.1f}" for kind in kinds),
        ]
        for run in layered
    ]
    head = ["scene", "quality", *(kind.replace("_", " ") for kind in kinds)]
    return f"Bits per Gaussian (or anchor) of the source, all layers together.\n\n{table(head, rows)}"


def _stream_bytes(run: Run, kind: str) -> int:
    return sum(int(layer["streams"].get(kind, 0)) for layer in run["layers"])


def _costs(runs: Sequence[Run]) -> str:
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
