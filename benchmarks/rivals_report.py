"""The tables and plots of docs/rivals.md, from the results of `benchmarks.rivals_run` and of `benchmarks.quality`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.judged import kinds_text, levels_text
from benchmarks.quality_report import FIRST_SHARE, equal_cells, ordered, title
from benchmarks.quality_report import NAME as QUALITY
from benchmarks.report import dated, load_results, replace_section, table
from benchmarks.scenes import REPOSITORY
from benchmarks.verdicts import LEVELS, best, smallest
from benchmarks.views import KINDS

NAME = "rivals"
PAGE = REPOSITORY / "docs" / "rivals.md"
IMAGES = REPOSITORY / "docs" / "images"
LEAST_DB = 36.0
"""Rivals from this mean on are set against `.scar`."""
FIRST_PICTURES = (25.0, 30.0)
"""First pictures that are waited for, mean dB over all views."""
_PLOTTED = 2
"""Scenes of this degree of spherical harmonics and more have a plot."""
# Lossless rivals lie far off the plots.
_PLOT_DB, _PLOT_BYTES = (15, 65), 70
_DEFAULTS = ("SPZ v3", "SPZ v4")
_MARKERS = {"spz": "o", "sog": "s", "compressed-ply": "^", "splat": "D"}
_TITLES = {"spz": "SPZ", "sog": "SOG", "compressed-ply": "compressed.ply", "splat": ".splat"}
_COLOURS = {"spz": "#0072b2", "sog": "#d55e00", "compressed-ply": "#009e73", "splat": "#cc79a7"}

Run = dict[str, Any]


def gathered(runs: Sequence[Run]) -> list[Run]:
    """Runs of rivals with the files of `benchmarks.quality` of the same scenes, effort 2, under ``scar``."""
    files = [run for run in ordered(list(load_results(QUALITY).values())) if run["effort"] == 2]
    return [{**run, "scar": [file for file in files if file["scene"] == run["scene"]]} for run in runs]


def write_page(runs: Sequence[Run]) -> None:
    """Put all tables into docs/rivals.md."""
    for section, text in (("rivals-verdicts", verdicts(runs)), ("rivals-scenes", scenes(runs))):
        stated = f"{dated(text, NAME)}\n\n`.scar`: {dated('', QUALITY).strip()}"
        replace_section(section, stated, PAGE)


def tables(runs: Sequence[Run]) -> str:
    """Everything the page gets, as text."""
    return f"{verdicts(runs)}\n\n{scenes(runs)}"


def verdicts(runs: Sequence[Run]) -> str:
    """The bytes that `.scar` needs to be as good as each rival that no other beats, and the first pictures."""
    full = [run for run in runs if run.get("scar") and run["rivals"]]
    head = ["scene", "SH", "rival", "B/G", "mean / 5 % / worst, dB", "`.scar` at its mean, B/G", "ratio"]
    head += ["`.scar` at all three, B/G", "ratio"]
    rows = [_verdict_row(run, rival) for run in full for rival in best(run["rivals"], LEAST_DB)]
    parts = ["**At equal quality**", table(head, rows, 3)]
    head = ["scene", "SH"]
    for goal in FIRST_PICTURES:
        head += [f"{goal:g} dB: `.scar`, kB", "smallest rival", "kB", "share"]
    return "\n\n".join([*parts, "**First picture**", table(head, [_first_row(run) for run in full])])


def smallest_layer(run: Run, goal: float) -> Run | None:
    """The fewest bytes of any `.scar` file of the scene with a mean of at least `goal` dB; None if none have it."""
    return smallest([layer for file in run["scar"] for layer in file["layers"]], goal)


def _verdict_row(run: Run, rival: Run) -> list[str]:
    cells = [title(run["scene"]), str(run["sh_degree"]), rival["name"]]
    cells += [f"{rival['bytes'] / run['count']:.2f}", levels_text(rival)]
    files = [file["layers"][-1] for file in run["scar"]]
    return [*cells, *equal_cells(run, files, rival, LEVELS[:1]), *equal_cells(run, files, rival)]


def _first_row(run: Run) -> list[str]:
    cells = [title(run["scene"]), str(run["sh_degree"])]
    for goal in FIRST_PICTURES:
        ours, rival = smallest_layer(run, goal), smallest(run["rivals"], goal)
        cells.append("not reached" if ours is None else f"{ours['bytes'] / 1e3:,.0f}")
        cells += ["none", ""] if rival is None else [rival["name"], f"{rival['bytes'] / 1e3:,.0f}"]
        share = ours["bytes"] / rival["bytes"] if ours and rival else None
        met = share is not None and goal == FIRST_PICTURES[0] and share <= FIRST_SHARE
        cells.append("" if share is None else f"**{share:.0%}**" if met else f"{share:.0%}")
    return cells


def scenes(runs: Sequence[Run]) -> str:
    """One section for each scene, with every file."""
    parts: list[str] = []
    for run in runs:
        parts += [f"### {run['scene']}", _facts(run), table(_head(run), _rows(run))]
        if run["skipped"]:
            parts.append("Skipped: " + "; ".join(f"{skip['name']} ({skip['why']})" for skip in run["skipped"]) + ".")
        if run["sh_degree"] >= _PLOTTED and run.get("scar"):
            parts.append(f"![PSNR against bytes](images/{_image(run)})")
    return "\n\n".join(parts)


def _facts(run: Run) -> str:
    return f"{run['count']:,} Gaussians, SH {run['sh_degree']}, {run['source_bytes']:,} bytes; {run['note']}."


def _head(run: Run) -> list[str]:
    head = ["file", "bytes", "B/G", "mean / 5 % / worst, dB", *_kinds(run), "SSIM", "encode s", "decode s"]
    return [*head, "peak MiB, encode", "decode", *(["against photos"] if _has_photos(run) else [])]


def _kinds(run: Run) -> list[str]:
    return [kind for kind in KINDS if any(kind in rival["kinds"] for rival in run["rivals"])]


def _has_photos(run: Run) -> bool:
    return any(rival["photos_psnr_db"] is not None for rival in run["rivals"])


def _rows(run: Run) -> list[list[str]]:
    files = [(int(rival["bytes"]), _row(run, rival, rival["name"], rival)) for rival in shown(run["rivals"])]
    for file in run.get("scar", ()):
        last = file["layers"][-1]
        files.append((int(last["bytes"]), _row(run, file, f"**`.scar`, quality {file['quality']:g}**", last)))
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


def _row(run: Run, costs: Run, name: str, whole: Run) -> list[str]:
    photos = whole["photos_psnr_db"]
    return [
        name,
        f"{whole['bytes']:,}",
        f"{whole['bytes'] / run['count']:.2f}",
        levels_text(whole),
        *(cell for cell in kinds_text(whole) if cell),
        f"{whole['ssim']:.4f}",
        f"{costs['encode_seconds']:.2f}",
        f"{costs['decode_seconds']:.3f}",
        f"{costs['encode_peak_bytes'] / 2**20:,.0f}",
        f"{costs['decode_peak_bytes'] / 2**20:,.0f}",
        *(["" if photos is None else f"{photos:.2f}"] if _has_photos(run) else []),
    ]


def _image(run: Run) -> str:
    return f"{NAME}-{run['scene']}.svg"


def plots(runs: Sequence[Run], folder: Path = IMAGES) -> None:
    """One picture for each scene with view-dependent colours: `.scar` layers as lines, rivals as points."""
    for run in runs:
        if run["sh_degree"] >= _PLOTTED and run.get("scar"):
            _plot(run, folder / _image(run))


def _plot(run: Run, path: Path) -> None:
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    # Text stays text and ids do not change from run to run: small files, small differences.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": NAME, "font.size": 9}):
        figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
        layered = [file for file in run["scar"] if not file["whole"]]
        for file, style in zip(layered, ("-", "--"), strict=False):
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
