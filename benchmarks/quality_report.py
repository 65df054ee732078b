"""The tables of docs/benchmarks.md and README.md: results of `benchmarks.quality`, against `benchmarks.rivals_run`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.judged import PERCENTILE, kinds_text, levels_text, worst_kind
from benchmarks.report import dated, load_results, replace_section, table
from benchmarks.scenes import FITTED_MARK, REPOSITORY, SCENES
from benchmarks.verdicts import AIMS, LEVELS, Row, equal_bytes, smallest
from benchmarks.views import KINDS

NAME = "quality"
RIVALS = "rivals"
README = REPOSITORY / "README.md"
HEADLINE = 47.0
"""README.md tells of one file a scene: the one encoded for this many dB."""
RIVAL_DB, FIRST_DB = 41.0, 25.0
"""Rivals from this mean on, dB, are set against files; a first layer should show this much."""
MEAN_WITHIN, LOW_BELOW, KIND_BELOW = 1.0, 5.0, 3.0
"""How far from what was asked, dB, mean, 5th percentile and worst kind should be at most."""
FIRST_SHARE = 0.1

Run = dict[str, Any]


def pages(runs: Sequence[Run]) -> None:
    """Rewrite the sections of docs/benchmarks.md and README.md."""
    replace_section(NAME, dated(tables(runs), NAME))
    rivals = load_results(RIVALS)
    text = f"{summary(runs, rivals)}\n\n{dated('', NAME).strip()}\n\nRivals: {dated('', RIVALS).strip()}"
    replace_section("results", text, README)


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
    """What a scene of this profile consists of."""
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
    """The tables of README.md: one file a scene, seen from everywhere, and against the smallest rival."""
    known = [run for run in ordered(runs) if run["quality"] == HEADLINE and run["effort"] == 2]
    files = {name: [run["layers"][-1] for run in ordered(runs) if run["scene"] == name] for name in rivals}
    ours = [_headline(run) for run in known if unit(run) == "Gaussian"]
    head = ["scene", "source, B/G", "`.scar`, B/G", f"mean / {PERCENTILE} % / worst, dB", *KINDS]
    against = [_against(run, rivals[run["scene"]], files[run["scene"]]) for run in known if run["scene"] in rivals]
    other = ["scene", "SH", "smallest rival", "B/G", "its mean / 5 % / worst", "`.scar` at its mean, B/G", "ratio"]
    other += ["as good in all three, B/G", "ratio"]
    other += ["first layer, kB", "its mean, dB", "share of the rival"]
    return "\n\n".join([table(head, ours), table(other, against), _mark_note()])


def _headline(run: Run) -> list[str]:
    last = run["layers"][-1]
    source = run["source_bytes"] / run["source_count"]
    size = f"{last['bytes_per_source']:.2f}"
    return [title(run["scene"]), f"{source:.0f}", size, levels_text(last), *kinds_text(last)]


def _against(run: Run, rivals: Run, files: Sequence[Row]) -> list[str]:
    cells = [title(run["scene"]), str(rivals["sh_degree"])]
    rival = smallest(rivals["rivals"], RIVAL_DB)
    if rival is None:
        return [*cells, "none", *[""] * 9]
    count, first = run["source_count"], run["layers"][0]
    cells += [rival["name"], f"{rival['bytes'] / count:.2f}", levels_text(rival)]
    cells += [*equal_cells(rivals, files, rival, LEVELS[:1]), *equal_cells(rivals, files, rival)]
    least = smallest(rivals["rivals"], FIRST_DB) or rival
    share = first["bytes"] / least["bytes"]
    met = share <= FIRST_SHARE and first["psnr_db"] >= FIRST_DB
    share_text = f"**{share:.0%}**" if met else f"{share:.0%}"
    return [*cells, f"{first['bytes'] / 1e3:,.0f}", f"{first['psnr_db']:.1f}", share_text]


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
