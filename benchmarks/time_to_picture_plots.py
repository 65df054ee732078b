"""The plots of docs/time-to-picture.md: seconds to a picture against bandwidth, one plot for each scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.plots import COLOURS, new_plot, save_plot
from benchmarks.time_to_picture_files import FAMILIES, FIRST, GOOD, SCAR, SETTINGS
from benchmarks.time_to_picture_tables import BANDWIDTHS, image, seconds_to, title

Record = dict[str, Any]
_POINTS = 40
_CORES = "all"


def draw(records: Sequence[Record], keep: bool) -> list[Path]:
    """Draw each scene; without `keep` not into docs/."""
    return [_scene(record, keep) for record in records]


def _scene(record: Record, keep: bool) -> Path:
    figure, axes = new_plot("Mbit/s", "to the picture, s, all cores", log_x=True, log_y=True, title=record["scene"])
    mbits = np.geomspace(BANDWIDTHS[0], BANDWIDTHS[-1], _POINTS)
    for way in filter(_shown, record["ways"]):
        seconds = [seconds_to(way, _CORES, float(mbit)) for mbit in mbits]
        axes.plot(mbits, seconds, _style(way), color=_colour(way), label=f"{title(way)}, {way['goal']:g} dB")
    axes.set_xticks(BANDWIDTHS, [f"{mbit:g}" for mbit in BANDWIDTHS])
    axes.minorticks_off()
    return save_plot(figure, image(record), keep)


def _shown(way: Record) -> bool:
    """One setting of ours is enough of a first picture."""
    return bool(way["goal"] == GOOD or way["family"] != SCAR or way["name"] == next(iter(SETTINGS)))


def _style(way: Record) -> str:
    if way["goal"] == FIRST:
        return "--"
    return ("-", "-.", ":")[list(SETTINGS).index(way["name"])] if way["family"] == SCAR else "-"


def _colour(way: Record) -> str:
    return COLOURS[[SCAR, *FAMILIES].index(way["family"])]
