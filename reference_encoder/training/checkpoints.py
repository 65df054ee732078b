"""Checkpoints of a training: written whole or not at all, read without running code from them.

A file is 8 bytes that name the format, the SHA-256 of what follows, and a state as torch saves it. The last two are
kept: a disk that loses the newest leaves the one before.
"""

from __future__ import annotations

import hashlib
import io
import re
import warnings
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch

from reference_encoder.training.capture import Capture
from reference_encoder.training.options import DEVICES, TrainOptions
from reference_encoder.training.recipe import Recipe
from scarfmt.atomic import atomic_write
from scarfmt.errors import InputWarning, InvalidInput

State = dict[str, Any]
"""Tensors, numbers, texts and None, by name, in dicts and lists as deep as one likes."""

KEPT = 2
_LAYOUT = 2
"""Which parts a state has: one more whenever those change, so that no training goes on from parts it lacks."""
_MAGIC = b"scarckp1"
_DIGEST_BYTES = 32
_NAME = re.compile(r"checkpoint-(\d{8})\.pt")


def identity(capture: Capture, options: TrainOptions, recipe: Recipe) -> str:
    """A text that two trainings share if one may go on from the other's checkpoint: on whatever device."""
    said = asdict(replace(options, device=DEVICES[0]))
    return f"{_LAYOUT} {capture.digest} {sorted(said.items())} {sorted(asdict(recipe).items())}"


def save_checkpoint(folder: Path, iteration: int, state: State, whose: str) -> None:
    """Write the state after `iteration` iterations to `folder`, which is made, and remove all but the last two.

    Args:
        folder: of the training.
        iteration: below 10^8.
        state: tensors of any device; they are read back onto the processor.
        whose: the training's :func:`identity`.

    Raises:
        InvalidInput: ``output-path``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    torch.save({"whose": whose, "iteration": iteration, "state": _on_processor(state)}, buffer)
    content = buffer.getvalue()
    with atomic_write(folder / f"checkpoint-{iteration:08}.pt", force=True) as stream:
        stream.write(_MAGIC + hashlib.sha256(content).digest())
        stream.write(content)
    _keep(folder, KEPT)


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
    found = _checkpoints(folder)
    for _, path in found:
        content = _content(path)
        if content is None:
            warnings.warn(f"{path} is damaged: using the one before, if any", InputWarning, stacklevel=2)
            continue
        if content["whose"] != whose:
            message = "holds an unfinished training of another capture, with other options or by another version"
            raise _refused(folder, f"{message}; use its options and version, give another folder, or delete it")
        return content["iteration"], content["state"]
    if found:
        raise _refused(folder, "no checkpoint can be read; delete the folder to start again")
    return None


def _on_processor(part: Any) -> Any:
    """A copy of the value with all tensors on the processor, in dicts and lists of any depth."""
    if isinstance(part, torch.Tensor):
        return part.cpu()
    if isinstance(part, dict):
        return {name: _on_processor(inner) for name, inner in part.items()}
    return [_on_processor(inner) for inner in part] if isinstance(part, list) else part


def last_iteration(folder: Path) -> int | None:
    """The iteration of the newest checkpoint by name, damaged or not; None if there is none."""
    return next((iteration for iteration, _ in _checkpoints(folder)), None)


def discard_checkpoints(folder: Path) -> None:
    """Remove the checkpoints of a training that has ended; its log and plot stay."""
    _keep(folder, 0)


def _keep(folder: Path, count: int) -> None:
    """Remove all but the newest `count`, and what a kill left of one that was being written."""
    unfinished = list(folder.glob(".checkpoint-*.part"))
    for path in [*unfinished, *(path for _, path in _checkpoints(folder)[count:])]:
        path.unlink(missing_ok=True)


def _checkpoints(folder: Path) -> list[tuple[int, Path]]:
    """(iteration, path) of each, the newest first."""
    named = [(_NAME.fullmatch(path.name), path) for path in folder.glob("checkpoint-*.pt")]
    return sorted(((int(name[1]), path) for name, path in named if name is not None), reverse=True)


def _content(path: Path) -> State | None:
    """The content of the file; None if it is not a checkpoint that was written whole."""
    data = memoryview(path.read_bytes())
    head = len(_MAGIC) + _DIGEST_BYTES
    if data[: len(_MAGIC)] != _MAGIC or hashlib.sha256(data[head:]).digest() != data[len(_MAGIC) : head]:
        return None
    content: State = torch.load(io.BytesIO(data[head:]), map_location="cpu", weights_only=True)
    return content


def _refused(folder: Path, message: str) -> InvalidInput:
    return InvalidInput("input-checkpoint", f"{folder}: {message}")
