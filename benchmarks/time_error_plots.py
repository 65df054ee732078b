"""The plots of docs/time-and-error.md: seconds and bytes against error."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.plots import line, new_plot, save_plot

Record = dict[str, Any]
NAMES = ("time-error-decode", "time-error-encode", "time-error-bytes")


def draw(results: dict[str, Any], keep: bool) -> list[Path]:
    """Draw what there are results for; without `keep` not into docs/."""
    layers, efforts = list(results.get("layers", {}).values()), list(results.get("efforts", {}).values())
    out = []
    if layers:
        out += [_decode(layers, keep), _bytes(layers, keep)]
    if efforts:
        out.append(_encode(efforts, keep))
    return out


def _decode(records: Sequence[Record], keep: bool) -> Path:
    figure, axes = new_plot("decode to arrays, s, 2 threads", "PSNR, dB", log_x=True)
    for number, record in enumerate(records):
        xs = [layer["decode"]["2"]["median"] for layer in record["layers"]]
        _line(axes, xs, record, number)
    return save_plot(figure, NAMES[0], keep)


def _bytes(records: Sequence[Record], keep: bool) -> Path:
    figure, axes = new_plot("bytes a Gaussian of the source", "PSNR, dB")
    for number, record in enumerate(records):
        xs = [layer["bytes"] / record["count"] for layer in record["layers"]]
        _line(axes, xs, record, number)
    return save_plot(figure, NAMES[2], keep)


def _line(axes: Any, xs: Sequence[float], record: Record, number: int) -> None:
    ys = [layer["psnr_db"] for layer in record["layers"]]
    line(axes, xs, ys, f"{record['scene']}, quality {record['quality']:g}", number)


def _encode(records: Sequence[Record], keep: bool) -> Path:
    figure, axes = new_plot("encode, s", "bytes", log_x=True, log_y=True)
    number = 0
    for record in records:
        for quality in sorted({run["quality"] for run in record["runs"]}):
            runs = [run for run in record["runs"] if run["quality"] == quality]
            xs, ys = [run["seconds"] for run in runs], [run["bytes"] for run in runs]
            line(axes, xs, ys, f"{record['scene']}, quality {quality:g}", number)
            number += 1
            for run in runs:
                axes.annotate(str(run["effort"]), (run["seconds"], run["bytes"]), fontsize=7, xytext=(4, 3),
                              textcoords="offset points")  # fmt: skip
    return save_plot(figure, NAMES[1], keep)
