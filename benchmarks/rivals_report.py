"""The tables and plots of docs/rivals.md, from the results of `benchmarks.rivals_run`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.report import dated, replace_section, table
from benchmarks.scenes import REPOSITORY

NAME = "rivals"
PAGE = REPOSITORY / "docs" / "rivals.md"
IMAGES = REPOSITORY / "docs" / "images"
# Qualities of .scar that are set against rivals, and the first pictures that are waited for, dB.
GOALS = (41.0, 47.0)
FIRST_PICTURES = (25.0, 30.0)
# What this project aims at: bytes against those of the smallest rival.
AIM, FIRST_AIM = 0.5, 0.15
# Below, the aims are not meant to hold: nothing to save in spherical harmonics.
_SH_DEGREE = 2
# Lossless rivals lie far off the plots.
_PLOT_DB, _PLOT_BYTES = (15, 60), 70
_DEFAULTS = ("SPZ v3", "SPZ v4")
_MARKERS = {"spz": "o", "sog": "s", "compressed-ply": "^", "splat": "D"}
_TITLES = {"spz": "SPZ", "sog": "SOG", "compressed-ply": "compressed.ply", "splat": ".splat"}
_COLOURS = {"spz": "#0072b2", "sog": "#d55e00", "compressed-ply": "#009e73", "splat": "#cc79a7"}

Run = dict[str, Any]


def write_page(runs: Sequence[Run]) -> None:
    """Put all tables into docs/rivals.md."""
    for section, text in (("rivals-verdicts", verdicts(runs)), ("rivals-scenes", scenes(runs))):
        replace_section(section, dated(text, NAME), PAGE)


def tables(runs: Sequence[Run]) -> str:
    """Everything the page gets, as text."""
    return f"{verdicts(runs)}\n\n{scenes(runs)}"


def verdicts(runs: Sequence[Run]) -> str:
    """`.scar` against the smallest rival at each goal, and the first pictures."""
    full = [run for run in runs if run.get("scar") and run["rivals"]]
    parts = []
    for goal in GOALS:
        rows = [_verdict_row(run, goal) for run in full]
        head = ["scene", "SH", "`.scar`, B/G", "its dB", "smallest rival", "B/G", "its dB", "ratio"]
        head += ["`.scar` at its dB, B/G", "ratio"]
        parts += [f"**At about {goal:g} dB**", table(head, rows)]
    rows = [_first_row(run) for run in full]
    head = ["scene", "SH"]
    for goal in FIRST_PICTURES:
        head += [f"{goal:g} dB: `.scar`, kB", "smallest rival", "kB", "share"]
    return "\n\n".join([*parts, "**First picture**", table(head, rows)])


def smallest(run: Run, goal: float) -> Run | None:
    """The smallest rival's file with at least `goal` dB; None if there is none."""
    good = [rival for rival in run["rivals"] if rival["psnr_db"] >= goal]
    return min(good, key=lambda rival: int(rival["bytes"]), default=None)


def smallest_layer(run: Run, goal: float) -> Run | None:
    """The fewest bytes of any `.scar` file of the scene that give at least `goal` dB; None if none do."""
    layers = [layer for file in run["scar"] for layer in file["layers"] if layer["psnr_db"] >= goal]
    return min(layers, key=lambda layer: int(layer["bytes"]), default=None)


def at_goal(run: Run, goal: float) -> tuple[Run, Run | None]:
    """The whole `.scar` file encoded for `goal` dB, and the smallest rival that is at least as good.

    At least as good as the goal, or as ours if that missed the goal: so that missing it helps no ratio.
    """
    ours: Run = next(file for file in run["scar"] if file["quality"] == goal)["layers"][-1]
    return ours, smallest(run, min(goal, ours["psnr_db"]))


def _verdict_row(run: Run, goal: float) -> list[str]:
    ours, rival = at_goal(run, goal)
    count = run["count"]
    cells = [run["scene"], str(run["sh_degree"]), f"{ours['bytes'] / count:.2f}", f"{ours['psnr_db']:.1f}"]
    if rival is None:
        return [*cells, "none", "", "", "", "", ""]
    cells += [rival["name"], f"{rival['bytes'] / count:.2f}", _decibels(rival["psnr_db"])]
    cells.append(_ratio(run, ours["bytes"] / rival["bytes"], AIM))
    equal = smallest_layer(run, rival["psnr_db"])
    if equal is None:
        return [*cells, "not measured", ""]
    return [*cells, f"{equal['bytes'] / count:.2f}", f"{equal['bytes'] / rival['bytes']:.2f}"]


def _first_row(run: Run) -> list[str]:
    cells = [run["scene"], str(run["sh_degree"])]
    for goal in FIRST_PICTURES:
        ours, rival = smallest_layer(run, goal), smallest(run, goal)
        cells.append("not reached" if ours is None else f"{ours['bytes'] / 1e3:,.0f}")
        cells += ["none", ""] if rival is None else [rival["name"], f"{rival['bytes'] / 1e3:,.0f}"]
        known = ours is not None and rival is not None
        aim = FIRST_AIM if goal == FIRST_PICTURES[0] else None
        cells.append(_ratio(run, ours["bytes"] / rival["bytes"], aim, True) if known and ours and rival else "")
    return cells


def _ratio(run: Run, value: float, aim: float | None, percent: bool = False) -> str:
    """The number, bold where it is what this project aims at."""
    text = f"{value:.0%}" if percent else f"{value:.2f}"
    return f"**{text}**" if aim is not None and value <= aim and run["sh_degree"] >= _SH_DEGREE else text


def _decibels(level: float) -> str:
    return "equal" if level >= 100 else f"{level:.1f}"


def scenes(runs: Sequence[Run]) -> str:
    """One section for each scene, with every file."""
    parts: list[str] = []
    for run in runs:
        parts += [f"### {run['scene']}", _facts(run), table(_head(run), _rows(run))]
        if run["skipped"]:
            parts.append("Skipped: " + "; ".join(f"{skip['name']} ({skip['why']})" for skip in run["skipped"]) + ".")
        if run["sh_degree"] >= _SH_DEGREE and run.get("scar"):
            parts.append(f"![PSNR against bytes](images/{_image(run)})")
    return "\n\n".join(parts)


def _facts(run: Run) -> str:
    text = f"{run['count']:,} Gaussians, SH {run['sh_degree']}, {run['source_bytes']:,} bytes; {run['note']}."
    if run.get("source_photos_psnr_db") is not None:
        text += f" The source itself reaches {run['source_photos_psnr_db']:.2f} dB against the held-out photos."
    return text


def _head(run: Run) -> list[str]:
    head = ["file", "bytes", "B/G", "PSNR dB", "SSIM", "encode s", "decode s", "peak MiB, encode", "decode"]
    head += [f"{goal:g} dB after" for goal in FIRST_PICTURES]
    return [*head, *(["against photos"] if _has_photos(run) else [])]


def _has_photos(run: Run) -> bool:
    return any(rival["photos_psnr_db"] is not None for rival in run["rivals"])


def _rows(run: Run) -> list[list[str]]:
    files = [(int(rival["bytes"]), _row(run, rival, rival["name"], [rival], rival)) for rival in shown(run["rivals"])]
    for file in run.get("scar", ()):
        last = file["layers"][-1]
        row = _row(run, file, f"**`.scar`, quality {file['quality']:g}**", file["layers"], last)
        files.append((int(last["bytes"]), row))
    return [row for _, row in sorted(files, key=lambda pair: pair[0])]


def shown(rivals: Sequence[Run]) -> list[Run]:
    """All but the settings of SPZ that another file of SPZ beats in both bytes and PSNR; its defaults in any case."""
    return [
        rival
        for rival in rivals
        if rival["family"] != "spz"
        or rival["name"] in _DEFAULTS
        or not any(
            other["family"] == "spz" and other["bytes"] < rival["bytes"] and other["psnr_db"] >= rival["psnr_db"]
            for other in rivals
        )
    ]


def _row(run: Run, costs: Run, name: str, layers: Sequence[Run], whole: Run) -> list[str]:
    first = [
        next((f"{layer['bytes']:,}" for layer in layers if layer["psnr_db"] >= goal), "") for goal in FIRST_PICTURES
    ]
    photos = whole["photos_psnr_db"]
    return [
        name,
        f"{whole['bytes']:,}",
        f"{whole['bytes'] / run['count']:.2f}",
        _decibels(whole["psnr_db"]) if whole["psnr_db"] >= 100 else f"{whole['psnr_db']:.2f}",
        f"{whole['ssim']:.4f}",
        f"{costs['encode_seconds']:.2f}",
        f"{costs['decode_seconds']:.3f}",
        f"{costs['encode_peak_bytes'] / 2**20:,.0f}",
        f"{costs['decode_peak_bytes'] / 2**20:,.0f}",
        *first,
        *(["" if photos is None else f"{photos:.2f}"] if _has_photos(run) else []),
    ]


def _image(run: Run) -> str:
    return f"{NAME}-{run['scene']}.svg"


def plots(runs: Sequence[Run], folder: Path = IMAGES) -> None:
    """One picture for each scene with view-dependent colours: `.scar` layers as lines, rivals as points."""
    for run in runs:
        if run["sh_degree"] >= _SH_DEGREE and run.get("scar"):
            _plot(run, folder / _image(run))


def _plot(run: Run, path: Path) -> None:
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    # Text stays text and ids do not change from run to run: small files, small differences.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": NAME, "font.size": 9}):
        figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
        for file, style in zip(run["scar"], ("-", "--"), strict=False):
            x = [layer["bytes"] / run["count"] for layer in file["layers"]]
            y = [layer["psnr_db"] for layer in file["layers"]]
            label = f".scar layers, quality {file['quality']:g}"
            axes.plot(x, y, style, color="black", marker=".", label=label)
        for family, marker in _MARKERS.items():
            points = [rival for rival in run["rivals"] if rival["family"] == family and rival["psnr_db"] < _PLOT_DB[1]]
            if points:
                x, y = ([point[key] for point in points] for key in ("bytes", "psnr_db"))
                x = [size / run["count"] for size in x]
                axes.plot(x, y, marker, color=_COLOURS[family], label=_TITLES[family])
        axes.set(xlabel="bytes a Gaussian of the source", ylabel="PSNR, dB", title=run["scene"])
        axes.set(xlim=(1, _PLOT_BYTES), ylim=_PLOT_DB, xscale="log")
        ticks = [1, 2, 5, 10, 20, 50]
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        axes.grid(True, linewidth=0.4)
        axes.legend(loc="upper left", fontsize=8)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)
