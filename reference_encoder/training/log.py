"""The log of a training, a JSON object a line, and its plot: PSNR, bytes and anchors over the iterations."""

from __future__ import annotations

import json
import math
import time
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from reference_encoder.training.options import Progress
from scarfmt.atomic import atomic_write

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOG, PLOT = "log.jsonl", "plot.png"
DRAW_EVERY_SECONDS = 180.0
_PANELS = (("psnr", "PSNR, held out (dB)"), ("bytes", "bytes"), ("anchors", "anchors"))


class RunLog:
    """The log of one training, to which lines are added; a context manager that draws the plot at the end.

    Args:
        folder: of the training; made if it is not there.
        iteration: after which training goes on, 0 for its start. Lines about later ones, from before an interruption,
            are dropped: they are about to happen again.
    """

    def __init__(self, folder: Path, iteration: int = 0) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        kept = [entry for entry in read_log(folder) if entry["iteration"] <= iteration]
        with atomic_write(folder / LOG, force=True) as stream:
            stream.writelines(_line(entry) for entry in kept)
        self._stream = (folder / LOG).open("ab")
        self._drawn = time.monotonic()

    def note(self, progress: Progress, **more: float | str | None) -> None:
        """Add a line, whole before this returns; every few minutes the plot is drawn again.

        Args:
            progress: its fields are the line's members.
            more: further members.
        """
        self._stream.write(_line(asdict(progress) | more))
        self._stream.flush()
        if time.monotonic() - self._drawn >= DRAW_EVERY_SECONDS:
            self.draw()

    def draw(self) -> None:
        """Draw the plot of all lines so far."""
        draw_log(self._folder)
        self._drawn = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stream.close()
        self.draw()


def read_log(folder: Path) -> list[dict[str, Any]]:
    """The lines of a log, first to last; a last line cut short by a kill is left out. Empty where there is no log."""
    path = folder / LOG
    if not path.is_file():
        return []
    whole, _, _ = path.read_bytes().rpartition(b"\n")
    return [json.loads(line) for line in whole.splitlines() if line]


def draw_log(folder: Path) -> None:
    """Write the plot of a log beside it, whole or not at all."""
    from matplotlib.figure import Figure

    entries = read_log(folder)
    figure = Figure(figsize=(7, 7), layout="constrained")
    panels = figure.subplots(len(_PANELS), sharex=True)
    for panel, (name, label) in zip(panels, _PANELS, strict=True):
        _draw(panel, [(one["iteration"], one[name]) for one in entries if one.get(name) is not None], label)
    panels[-1].set_xlabel("iteration")
    with atomic_write(folder / PLOT, force=True) as stream:
        figure.savefig(stream, format="png")


def _draw(panel: Axes, values: list[tuple[int, float]], label: str) -> None:
    panel.plot([one[0] for one in values], [one[1] for one in values], marker="." if len(values) < 30 else None)
    panel.set_ylabel(label)
    panel.grid(alpha=0.3)


def _line(entry: dict[str, Any]) -> bytes:
    """JSON has no infinity and no NaN: they are null."""
    endless = {key for key, value in entry.items() if isinstance(value, float) and not math.isfinite(value)}
    return json.dumps(entry | dict.fromkeys(endless), allow_nan=False).encode() + b"\n"
