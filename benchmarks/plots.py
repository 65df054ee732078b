"""The look of all plots, and how they are kept: small SVG files that a second run writes alike."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

from benchmarks.report import SHORT_RESULTS
from benchmarks.scenes import REPOSITORY

matplotlib.use("svg")
import matplotlib.pyplot as pyplot

IMAGES = REPOSITORY / "docs" / "images"
MOST_BYTES = 40_000
COLOURS = ("#0b6e99", "#d1603d", "#4c9f70", "#7b5ea7", "#b58900", "#555555")
MARKERS = ("o", "s", "^", "D", "v", "P")
_STYLE: Any = {
    "figure.figsize": (6.4, 4.0),
    "font.size": 9,
    "font.family": "sans-serif",
    "svg.fonttype": "none",
    "svg.hashsalt": "scarfmt",
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
}


def new_plot(x: str, y: str, *, log_x: bool = False, log_y: bool = False, title: str = "") -> tuple[Any, Any]:
    """A figure and its axes, labelled."""
    with pyplot.rc_context(_STYLE):
        figure, axes = pyplot.subplots(layout="constrained")
        axes.set(xlabel=x, ylabel=y, title=title)
        if log_x:
            axes.set_xscale("log")
        if log_y:
            axes.set_yscale("log")
    return figure, axes


def line(axes: Any, xs: Sequence[float], ys: Sequence[float], label: str, number: int) -> None:
    """A line with its points, in the colour and with the marker of a `number`."""
    colour, marker = COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)]
    axes.plot(xs, ys, color=colour, marker=marker, label=label)


def save_plot(figure: Any, name: str, keep: bool = True) -> Path:
    """Write docs/images/NAME.svg; without `keep`, only under build/bench/.

    Raises:
        ValueError: it is larger than a file of the repository should be.
    """
    folder = IMAGES if keep else SHORT_RESULTS
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.svg"
    with pyplot.rc_context(_STYLE):
        handles, _ = figure.axes[0].get_legend_handles_labels()
        if handles:
            figure.axes[0].legend(fontsize=8)
        figure.savefig(path, metadata={"Date": None, "Creator": None})
    pyplot.close(figure)
    if path.stat().st_size > MOST_BYTES:
        raise ValueError(f"{path} has {path.stat().st_size:,} bytes, at most {MOST_BYTES:,} are wanted")
    return path
