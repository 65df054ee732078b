"""The folder of a training: its log with a plot, and its checkpoints.

The log has a JSON object a line; the plot shows PSNR, bytes and anchors over the iterations. Checkpoints are written
whole or not at all, and nothing in them is run (:mod:`reference_encoder.kept_values`). The last two are kept: a disk
that loses the newest leaves the one before.
"""

from __future__ import annotations

import json
import math
import re
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import torch

from reference_encoder import kept_values
from reference_encoder.training.capture import Capture
from reference_encoder.training.options import DEVICES, Progress, TrainOptions
from reference_encoder.training.presets import PRESETS
from scarfmt.atomic import atomic_write
from scarfmt.errors import InputWarning, InvalidInput

LOG, PLOT, DRAFT, HELD_OUT = "log.jsonl", "plot.png", "draft.scar", "held-out.txt"
DRAW_EVERY_SECONDS = 180.0
_PANELS = (("psnr", "PSNR, held out (dB)"), ("bytes", "bytes"), ("anchors", "anchors"))


class RunLog:
    """The log of one training, to which lines are added; a context manager that draws the plot at the end.

    Args:
        folder: of the training; made if it is not there.
        iteration: after which training goes on, 0 for its start. Lines about later ones, from before an interruption,
            are dropped: they are about to happen again.
        held_out: names of the photos that are not learnt from, kept in a file beside the log, one a line.
    """

    def __init__(self, folder: Path, iteration: int = 0, held_out: Sequence[str] = ()) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        if held_out:
            with atomic_write(folder / HELD_OUT, force=True) as stream:
                stream.write("".join(f"{name}\n" for name in held_out).encode())
        entries = [entry for entry in read_log(folder) if entry["iteration"] <= iteration]
        with atomic_write(folder / LOG, force=True) as stream:
            stream.writelines(_line(entry) for entry in entries)
        self._stream = (folder / LOG).open("ab")
        self._drawn = time.monotonic()

    def note(self, progress: Progress, **more: float | str | None) -> None:
        """Add a line, whole before this returns; every few minutes the plot is drawn again."""
        self._stream.write(_line(asdict(progress) | more))
        self._stream.flush()
        if time.monotonic() - self._drawn >= DRAW_EVERY_SECONDS:
            draw_log(self._folder)
            self._drawn = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stream.close()
        draw_log(self._folder)


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
        values = [(one["iteration"], one[name]) for one in entries if one.get(name) is not None]
        panel.plot(*zip(*values, strict=True), marker="." if len(values) < 30 else None)
        panel.set_ylabel(label)
        panel.grid(alpha=0.3)
    panels[-1].set_xlabel("iteration")
    with atomic_write(folder / PLOT, force=True) as stream:
        figure.savefig(stream, format="png")


def _line(entry: dict[str, Any]) -> bytes:
    """JSON has no infinity and no NaN: they are null."""
    endless = {key for key, value in entry.items() if isinstance(value, float) and not math.isfinite(value)}
    return json.dumps(entry | dict.fromkeys(endless), allow_nan=False).encode() + b"\n"


State = dict[str, Any]
"""Tensors, numbers, texts, records (:mod:`reference_encoder.kept_values`) and None, by name, in dicts and lists as deep
as one likes."""

KEPT = 2
_LAYOUT = 5
"""Which parts a state has: one more whenever those change, so that no training goes on from parts it lacks."""
_NAME = re.compile(r"checkpoint-(\d{8})\.pt")


def identity(capture: Capture, options: TrainOptions) -> str:
    """A text that two trainings share if one may go on from the other's checkpoint: on whatever device."""
    fields = asdict(replace(options, device=DEVICES[0]))
    return f"{_LAYOUT} {capture.digest} {sorted(fields.items())} {sorted(asdict(PRESETS[options.preset]).items())}"


def save_checkpoint(folder: Path, iteration: int, state: State, whose: str) -> None:
    """Write the state after `iteration` iterations to `folder`, which is made, and remove all but the last two.

    Args:
        iteration: below 10^8.
        state: tensors of any device; they are read back onto the processor.
        whose: the training's :func:`identity`.

    Raises:
        InvalidInput: ``output-path``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    content = {"whose": whose, "iteration": iteration, "state": _convert(state, _as_array)}
    with atomic_write(folder / f"checkpoint-{iteration:08}.pt", force=True) as stream:
        stream.writelines(kept_values.pack(content))
    _keep(folder, KEPT)


def save_draft(folder: Path, data: bytes) -> None:
    """Write a file that is whole, but not the smallest yet: who is cut off while that is sought has this one."""
    with atomic_write(folder / DRAFT, force=True) as stream:
        stream.write(data)


def load_checkpoint(folder: Path, whose: str) -> tuple[int, State] | None:
    """Iteration and state of the newest checkpoint that can be read; None where there is none.

    Args:
        folder: of the training; it need not exist.
        whose: the training's :func:`identity`.

    Raises:
        InvalidInput: ``input-checkpoint``: all that are there are damaged, or they are another training's.

    Warns:
        InputWarning: a damaged one was passed over.
    """
    existing = _checkpoints(folder)
    for _, path in existing:
        content = _content(path)
        if content is None:
            warnings.warn(f"{path} is damaged: using the one before, if any", InputWarning, stacklevel=2)
            continue
        if content["whose"] != whose:
            message = "holds an unfinished training of another capture, with other options or by another version"
            raise _refusal(folder, f"{message}; use its options and version, give another folder, or delete it")
        return content["iteration"], _convert(content["state"], _as_tensor)
    if existing:
        raise _refusal(folder, "no checkpoint can be read; delete the folder to start again")
    return None


def _convert(part: Any, convert: Callable[[Any], Any]) -> Any:
    """The value with what is in dicts and lists of any depth converted."""
    if isinstance(part, dict):
        return {name: _convert(inner, convert) for name, inner in part.items()}
    return [_convert(inner, convert) for inner in part] if isinstance(part, list) else convert(part)


def _as_array(part: Any) -> Any:
    """An array in place of a tensor of whatever device."""
    return part.detach().cpu().numpy() if isinstance(part, torch.Tensor) else part


def _as_tensor(part: Any) -> Any:
    """The inverse of :func:`_as_array`, on the processor."""
    return torch.from_numpy(part) if isinstance(part, np.ndarray) else part


def last_iteration(folder: Path) -> int | None:
    """The iteration of the newest checkpoint by name, damaged or not; None if there is none."""
    return next((iteration for iteration, _ in _checkpoints(folder)), None)


def discard_checkpoints(folder: Path) -> None:
    """Remove the checkpoints and the draft of a training that has ended; its log and plot stay."""
    _keep(folder, 0)
    (folder / DRAFT).unlink(missing_ok=True)


def _keep(folder: Path, count: int) -> None:
    """Remove all but the newest `count`, and what a kill left of one that was being written."""
    unfinished = [*folder.glob(".checkpoint-*.part"), *folder.glob(f".{DRAFT}*.part")]
    for path in [*unfinished, *(path for _, path in _checkpoints(folder)[count:])]:
        path.unlink(missing_ok=True)


def _checkpoints(folder: Path) -> list[tuple[int, Path]]:
    """(iteration, path) of each, the newest first."""
    named = [(_NAME.fullmatch(path.name), path) for path in folder.glob("checkpoint-*.pt")]
    return sorted(((int(name[1]), path) for name, path in named if name is not None), reverse=True)


def _content(path: Path) -> State | None:
    """The content of the file; None if it is not a checkpoint that was written whole."""
    try:
        content = kept_values.unpack(path.read_bytes())
    except ValueError:
        return None
    match content:
        case {"whose": str(), "iteration": int(), "state": dict()}:
            return dict(content)
    return None


def _refusal(folder: Path, message: str) -> InvalidInput:
    return InvalidInput("input-checkpoint", f"{folder}: {message}")
